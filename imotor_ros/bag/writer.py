"""The bag of a run, being written."""

from __future__ import annotations

import json
import time as clocks
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from imotor_ros.bag import layout
from imotor_ros.bag.facts import RunFacts, StreamCounts, stream_counts, to_json
from imotor_ros.bag.storage import RunBagWriter, sync
from imotor_ros.bag.types import BagTypes, installed_types
from imotor_ros.contracts.blocks import StreamLedger
from imotor_ros.contracts.messages import block_from_message
from imotor_ros.contracts.topics import ALL_TOPICS, DEFAULT_NAMESPACE, Topic, is_sampled
from imotor_ros.errors import BadInputError, RecordingError, SamplesLostError

COMMIT_INTERVAL = 1.0
"""Longest time that a message waits for its chunk to be written (s)."""


class RunWriter:
    """
    Writes the bag of one run; see `imotor_ros.bag.layout` for its form.

    A recorder that is killed loses the messages of the open chunk: at most 1 MiB, and at most
    those of the last `commit_interval`, if `commit_if_due` is called often enough. What was
    committed stands in the file system; only `close` makes it survive a power failure.

    Parameters
    ----------
    directory : Path
        Folder of the bag, which must not exist yet.
    run_id : str
        Name of the run.
    run_info : mapping
        All that is needed to repeat the run, as plain JSON.
    provenance : mapping, optional
        Versions, host and start: what differs when the run is repeated.
    topics : sequence of Topic
        Topics of the bag; all are in it, also those without messages.
    namespace : str
        Namespace of the stand.
    is_simulated : bool
        Whether log times follow the sample index.
    types : BagTypes, optional
        Message types; by default the installed ones.
    is_compressed : bool
        Whether chunks are compressed (zstd level 1, with checksum).
    commit_interval : float
        Longest time that a message waits in the open chunk (s).
    clock : callable
        Steady clock (s) that bounds this time.

    Raises
    ------
    BadInputError
        If the folder exists, or `run_info` is not plain JSON.
    RecordingError
        If the bag cannot be made.

    """

    def __init__(
        self,
        directory: Path | str,
        *,
        run_id: str,
        run_info: Mapping[str, Any],
        provenance: Mapping[str, Any] | None = None,
        topics: Sequence[Topic] = ALL_TOPICS,
        namespace: str = DEFAULT_NAMESPACE,
        is_simulated: bool = True,
        types: BagTypes | None = None,
        is_compressed: bool = True,
        commit_interval: float = COMMIT_INTERVAL,
        clock: Callable[[], float] = clocks.monotonic,
    ) -> None:
        self.path = Path(directory)
        self.run_id = run_id
        self.types = types or installed_types()
        self.failure: RecordingError | None = None
        self.ledgers = {t.name: StreamLedger(t.name) for t in topics if is_sampled(t)}
        self.rejected = dict.fromkeys((topic.name for topic in topics), 0)
        self._committed = self._copied_ledgers()
        self._facts = RunFacts(run_id, run_info, provenance or {}, is_simulated)
        marker = json.dumps(self._facts.to_texts())
        self._last_time = self._committed_time = -1
        self._clock = clock
        self._interval = commit_interval
        self._last_commit = clock()
        self._is_closed = False
        if self.path.exists():
            raise BadInputError("exists already", where=str(self.path), bound="a new folder")
        self._writer = RunBagWriter(self.path, is_compressed=is_compressed)
        try:
            self._open(marker, topics, namespace)
        except OSError as error:
            self._writer.abort()
            raise self._recording_error(error) from error

    def _open(self, marker: str, topics: Sequence[Topic], namespace: str) -> None:
        self._writer.open()
        (self.path / layout.UNFINISHED).write_text(marker, encoding="utf-8")
        sync(self.path / layout.UNFINISHED)
        self._connections = {
            topic.name: self._writer.add_connection(
                layout.absolute_name(namespace, topic.name),
                topic.type_name,
                msgdef=self.types.definition(topic.type_name),
                rihs01=self.types.type_hash(topic.type_name),
                offered_qos_profiles=[layout.offered_qos(topic)],
            )
            for topic in topics
        }
        self._writer.run_storage.write_definitions()

    @property
    def file(self) -> Path:
        """The MCAP file."""
        return self.path / f"{self.path.name}.mcap"

    def write(self, topic: str, data: bytes, time: int) -> None:
        """
        Write a message.

        Missing samples are counted, not refused. A message that does not decode, or belongs to
        another run or another sample rate, is counted as rejected and not written. What is
        written has the canonical bytes, see `BagTypes.canonical`.

        Parameters
        ----------
        topic : str
            Name of its topic, as in the contracts.
        data : bytes
            The message as CDR.
        time : int
            Log time (ns since 1970), larger than that of the message before.

        Raises
        ------
        BadInputError
            If the topic is not one of the bag, or the time does not increase.
        RecordingError
            If the bag cannot be written.

        """
        self._check(topic, time)
        connection = self._connections[topic]
        try:
            message = self.types.deserialize(data, connection.msgtype)
            self._count(topic, message)
            content = self.types.serialize(message)
        except BadInputError:
            self.rejected[topic] += 1
            return
        self._last_time = time
        with self._recording():
            self._writer.write(connection, time, content)
        if not self._writer.run_storage.has_pending:
            self._note_commit()
        self.commit_if_due()

    def _check(self, topic: str, time: int) -> None:
        if self.failure is not None:
            raise self.failure
        if self._is_closed or topic not in self._connections:
            what = "is closed" if self._is_closed else "has no such topic"
            raise BadInputError(what, where=str(self.path), value=topic)
        if time <= self._last_time:
            bound = f"> {self._last_time} ns"
            raise BadInputError(
                "does not increase", where=f"{topic}: time", value=time, bound=bound
            )

    def _count(self, topic: str, message: Any) -> None:
        """Count a message; raise BadInputError if it does not belong into the bag."""
        run_id = getattr(message, "run_id", self.run_id)
        if run_id != self.run_id:
            raise BadInputError("is of another run", where=topic, value=run_id)
        if topic in self.ledgers:
            with suppress(SamplesLostError):
                self.ledgers[topic].accept(block_from_message(message))

    def commit(self) -> None:
        """
        Write the open chunk, so that a killed recorder does not lose it.

        Raises
        ------
        RecordingError
            If the bag cannot be written.

        """
        if self._is_closed or not self._writer.run_storage.has_pending:
            return
        with self._recording():
            self._writer.run_storage.close_chunk()
        self._note_commit()

    def commit_if_due(self) -> None:
        """Write the open chunk if the last one was written a `commit_interval` ago."""
        if self._clock() - self._last_commit >= self._interval:
            self._last_commit = self._clock()
            self.commit()

    def _note_commit(self) -> None:
        self._last_commit = self._clock()
        self._committed = self._copied_ledgers()
        self._committed_time = self._last_time

    def _copied_ledgers(self) -> dict[str, StreamLedger]:
        return {name: replace(ledger) for name, ledger in self.ledgers.items()}

    def close(self, end_state: str, result: Mapping[str, Any] | None = None) -> None:
        """
        End the bag; closing it again does nothing.

        A bag that could not be written is closed with its whole chunks, if the disk lets it
        be, and keeps `unfinished.json` for `recover` if not.

        Parameters
        ----------
        end_state : str
            How the run ended, e.g. "completed", "cancelled" or "failed: ...".
        result : mapping, optional
            What came out, as plain JSON.

        Raises
        ------
        RecordingError
            If the bag could not be written, now or before.
        BadInputError
            If `result` is not plain JSON; the bag is closed all the same, without it.

        """
        if self._is_closed:
            return
        refusal = None
        try:
            to_json(result, "result")
        except BadInputError as error:
            result, refusal = None, error
        with suppress(RecordingError):
            self.commit()
        self._is_closed = True
        if self.failure is not None:
            end_state = f"failed: {self.failure}"
            self._fall_back()
        self._end(end_state, result)
        if self.failure is not None:
            raise self.failure
        if refusal is not None:
            raise refusal

    def _fall_back(self) -> None:
        """Go back to what was committed, because the open chunk cannot be written."""
        self._writer.drop_chunk(max(0, self._committed_time))
        self.ledgers = self._committed

    def _end(self, end_state: str, result: Mapping[str, Any] | None) -> None:
        streams = self.stream_counts
        facts = replace(self._facts, end_state=end_state, result=result, streams=streams)
        for key, text in facts.to_texts().items():
            self._writer.set_custom_data(key, text)
        try:
            self._writer.close()
            for path in (self.file, self.path / layout.METADATA):
                sync(path)
            (self.path / layout.UNFINISHED).unlink()
            sync(self.path)
        except OSError as error:
            self.failure = self.failure or self._recording_error(error)
        finally:
            with suppress(OSError):
                self._writer.abort()

    @property
    def stream_counts(self) -> StreamCounts:
        """What came of each stream."""
        return stream_counts(self.ledgers, self.rejected)

    @contextmanager
    def _recording(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.failure = self._recording_error(error)
            raise self.failure from error

    def _recording_error(self, error: OSError) -> RecordingError:
        cause = error.strerror or str(error)
        return RecordingError(f"{self.path}: cannot be written: {cause}")

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bag if it is open; an exception becomes the end state."""
        if error is None:
            self.close("completed")
            return
        with suppress(RecordingError):
            self.close(f"failed: {type(error).__name__}: {error}")

"""The bag of a run, being read."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from imotor_ros.bag import layout
from imotor_ros.bag.facts import RunFacts, StreamCounts, metadata_texts, stream_counts
from imotor_ros.bag.records import McapFile, StoredMessage
from imotor_ros.bag.storage import is_locked
from imotor_ros.bag.types import BagTypes
from imotor_ros.contracts.blocks import SampleBlock, StreamLedger
from imotor_ros.contracts.messages import (
    block_from_message,
    channel_from_message,
    performance_from_message,
    program_from_message,
)
from imotor_ros.contracts.topics import (
    CHANNELS,
    DRIVE_PROGRAM,
    DRIVE_VOLTAGE,
    PERFORMANCE,
    RUN_INFO,
)
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.indicators import Performance
from imotor_ros.errors import BadInputError, SamplesLostError, UnreadableFileError

_BLOCK = DRIVE_VOLTAGE.type_name
_PACKAGE = "imotor_msgs/"
_FIRST_MESSAGES = 1000


@dataclass(frozen=True)
class BagMessage:
    """
    One message of a bag.

    Attributes
    ----------
    topic : str
        Name of its topic, as in the contracts.
    type_name : str
        Its type, e.g. "imotor_msgs/msg/SampleBlock".
    time : int
        Log time (ns since 1970).
    data : bytes
        The message as CDR.

    """

    topic: str
    type_name: str
    time: int
    data: bytes


class RunBag:
    """
    The bag of one run, open for reading until `close`, or to the end of a `with` block.

    Needs no message package: a bag holds the definitions of its messages.

    Parameters
    ----------
    path : Path
        The bag's folder, or its MCAP or metadata.yaml file.
    allow_damaged : bool
        Whether to read what there is of a bag that was not closed; its end state is then
        "unfinished".

    Attributes
    ----------
    facts : RunFacts
        What the bag says of its run beside the messages.

    Raises
    ------
    UnreadableFileError
        If there is no such bag, it was not closed, it is that of something else than a run, or
        it was written by a newer version.

    """

    def __init__(self, path: Path | str, *, allow_damaged: bool = False) -> None:
        self.path = Path(path)
        self.file = layout.find_mcap(self.path)
        self._names: dict[int, str] = {}
        self._mcap = McapFile(self.file)
        try:
            if self._mcap.damage and not allow_damaged:
                if is_locked(self.file):
                    raise UnreadableFileError("is being recorded", where=str(self.file))
                what = f"is damaged: {self._mcap.damage}"
                raise UnreadableFileError(what, where=str(self.file), bound=_ADVICE)
            self.facts = self._read_facts()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the bag."""
        self._mcap.close()

    def __enter__(self) -> Self:
        """Return the bag."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bag."""
        self.close()

    def distrust(self, reason: str) -> None:
        """Read on as from a damaged file, although its end is whole."""
        self._mcap.distrust(reason)

    # ---- facts of the run ----------------------------------------------------------------------

    @property
    def damage(self) -> str:
        """What is wrong with the file; empty if nothing."""
        return self._mcap.damage

    @property
    def run_id(self) -> str:
        """Name of the run."""
        return self.facts.run_id

    @property
    def run_info(self) -> Mapping[str, Any]:
        """All that is needed to repeat the run."""
        return self.facts.run_info

    @property
    def end_state(self) -> str:
        """How the run ended."""
        return self.facts.end_state

    @property
    def result(self) -> Mapping[str, Any] | None:
        """What came out of the run, if it was stated."""
        return self.facts.result

    @cached_property
    def stream_counts(self) -> StreamCounts:
        """What came of each stream; counted anew if the bag was not closed."""
        if self.facts.streams is not None and not self.damage:
            return self.facts.streams
        ledgers = {n: StreamLedger(n) for n, kind in self.topics.items() if kind == _BLOCK}
        for block in self.blocks():
            with suppress(SamplesLostError):
                ledgers[block.stream].accept(block)
        return stream_counts(ledgers, {})

    @property
    def namespace(self) -> str:
        """Namespace of the stand, e.g. "/stand"."""
        return layout.namespace_of({c.topic: c.type_name for c in self._mcap.channels.values()})

    @cached_property
    def topics(self) -> dict[str, str]:
        """Message type by topic, named as in the contracts."""
        return {self._name(key): c.type_name for key, c in self._mcap.channels.items()}

    @cached_property
    def message_counts(self) -> dict[str, int]:
        """Number of messages by topic, named as in the contracts."""
        counts = self._mcap.counts
        if self.damage:
            counts = dict.fromkeys(self._mcap.channels, 0)
            for message in self._mcap.messages():
                counts[message.channel] += 1
        return {self._name(key): counts.get(key, 0) for key in self._mcap.channels}

    @cached_property
    def times(self) -> tuple[int, int]:
        """Log times (ns since 1970) of the first and the last message; zeros if there is none."""
        if not self.damage:
            return self._mcap.times if any(self._mcap.counts.values()) else (0, 0)
        times = [message.time for message in self._mcap.messages()]
        return (min(times), max(times)) if times else (0, 0)

    @cached_property
    def program(self) -> DriveProgram:
        """
        What was played: the last program, because a cancelled run has a second, shorter one.

        Raises
        ------
        UnreadableFileError
            If the bag holds none.

        """
        return program_from_message(self._last(DRIVE_PROGRAM.name))

    @cached_property
    def performance(self) -> Performance:
        """
        The last performance that was published in the run.

        Raises
        ------
        UnreadableFileError
            If the bag holds none.

        """
        return performance_from_message(self._last(PERFORMANCE.name))

    @cached_property
    def channels(self) -> dict[str, ChannelDescription]:
        """The measured channels by name."""
        messages = map(self.decode, self.messages(CHANNELS.name))
        return {m.name: channel_from_message(m) for m in messages}

    # ---- messages ------------------------------------------------------------------------------

    def messages(self, *topics: str) -> Iterator[BagMessage]:
        """
        Yield messages in the order of the bag.

        Parameters
        ----------
        *topics : str
            Names of the topics wanted, as in the contracts; none for all.

        Raises
        ------
        UnreadableFileError
            If the bag is damaged inside.

        """
        for message in self._mcap.messages(self._numbers(topics) if topics else None):
            yield self._named(message)

    def decode(self, message: BagMessage) -> Any:
        """
        Return the content of a message.

        Raises
        ------
        UnreadableFileError
            If it is not of its type.

        """
        try:
            return self.types.deserialize(message.data, message.type_name)
        except BadInputError as error:
            raise UnreadableFileError(str(error), where=f"{self.file}: {message.topic}") from error

    def blocks(self, *streams: str) -> Iterator[SampleBlock]:
        """
        Yield blocks of samples in the order of the bag.

        Parameters
        ----------
        *streams : str
            Names of the streams wanted; none for all.

        """
        wanted = streams or tuple(n for n, kind in self.topics.items() if kind == _BLOCK)
        if wanted:
            for message in self.messages(*wanted):
                yield _own_samples(block_from_message(self.decode(message)))

    def samples(
        self, stream: str, *, allow_gaps: bool = False
    ) -> tuple[NDArray[np.float64], float, int]:
        """
        Return all samples of a stream, their rate (Hz) and the index of the first.

        Parameters
        ----------
        stream : str
            Name of the stream.
        allow_gaps : bool
            Whether missing samples are filled with NaN.

        Raises
        ------
        BadInputError
            If the bag has no such stream.
        SamplesLostError
            If samples are missing between others and `allow_gaps` is False.

        """
        parts: list[NDArray[np.float64]] = []
        rate, first, end = 0.0, 0, 0
        for block in self.blocks(stream):
            if not parts:
                rate, first, end = block.sample_rate, block.first_index, block.first_index
            if block.first_index != end:
                if not allow_gaps or block.first_index < end:
                    raise SamplesLostError(stream, end, block.first_index)
                parts.append(np.full(block.first_index - end, np.nan))
            parts.append(block.samples)
            end = block.end_index
        return np.concatenate(parts or [np.empty(0)]), rate, first

    # ---- inside --------------------------------------------------------------------------------

    def _name(self, number: int) -> str:
        return layout.relative_name(self.namespace, self._mcap.channels[number].topic)

    def _named(self, message: StoredMessage) -> BagMessage:
        if message.channel not in self._names:  # a damaged file tells its channels on the way
            self._names[message.channel] = self._name(message.channel)
        kind = self._mcap.channels[message.channel].type_name
        return BagMessage(self._names[message.channel], kind, message.time, bytes(message.data))

    def _numbers(self, topics: Collection[str]) -> set[int]:
        for topic in topics:
            if topic not in self.topics:
                raise BadInputError(
                    "is not a topic of the bag",
                    where=str(self.path),
                    value=topic,
                    bound="one of " + ", ".join(sorted(self.topics)),
                )
        return {key for key in self._mcap.channels if self._name(key) in topics}

    def _last(self, topic: str) -> Any:
        last = None
        for message in self.messages(topic) if topic in self.topics else ():
            last = message
        if last is None:
            raise UnreadableFileError(f"holds no message on {topic}", where=str(self.path))
        return self.decode(last)

    @cached_property
    def types(self) -> BagTypes:
        """The message types that the bag defines."""
        return BagTypes.from_definitions(
            {c.type_name: c.definition for c in self._mcap.channels.values()}
        )

    def _read_facts(self) -> RunFacts:
        where = str(self.path)
        if not self.damage:
            return RunFacts.from_texts(metadata_texts(self._mcap.metadata, where), where)
        for _ in self._mcap.messages():  # finds the channels
            break
        try:
            text = (self.file.parent / layout.UNFINISHED).read_text(encoding="utf-8")
        except OSError:
            return self._facts_from_messages()
        return RunFacts.from_texts(_json_object(text), where)

    def _facts_from_messages(self) -> RunFacts:
        """Return what the run info tells, or any message of the run: one of the first."""
        facts = None
        for message in islice(self.messages(), _FIRST_MESSAGES):
            if message.topic == RUN_INFO.name:
                content = self.decode(message)
                return RunFacts(content.run_id, _json_object(content.json))
            if facts is None and message.type_name.startswith(_PACKAGE):
                facts = RunFacts(self.decode(message).run_id)
        if facts is None:
            raise UnreadableFileError("holds nothing of a run", where=str(self.path))
        return facts


_ADVICE = "a bag that was closed; `imotor recover` mends one that was not"


def _json_object(text: str) -> dict[str, Any]:
    """Return the JSON object in a text; an empty one if there is none."""
    try:
        content = json.loads(text)
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}


def _own_samples(block: SampleBlock) -> SampleBlock:
    """Return the block with samples of its own: aligned and writable, as those from a topic."""
    return replace(block, samples=np.array(block.samples, dtype=np.float64))

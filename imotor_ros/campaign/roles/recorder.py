"""The recorder: the bag of a run, from its first message to the final indicators."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from imotor_ros.bag.ordering import MessageOrder
from imotor_ros.bag.types import BagTypes, installed_types
from imotor_ros.bag.writer import RunWriter
from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import sample_time
from imotor_ros.contracts.messages import (
    block_from_message,
    message_time,
    performance_from_message,
    program_from_message,
)
from imotor_ros.contracts.outcomes import CANCELLED, COMPLETED
from imotor_ros.contracts.topics import Intent, Topic, is_sampled, topic_named
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.indicators import Performance

ABORTED = "aborted"


class RecorderRole:
    """
    Takes the serialised messages of one run in any order and writes its bag.

    Parameters
    ----------
    path : Path
        Folder of the bag, which must not exist yet.
    program : DriveProgram
        The run.
    run_info, provenance : mapping
        For the bag; see `RunWriter`. Whoever gives run info also publishes it on run/info.
    topics : tuple of Topic
        Topics that are recorded; those that are streams must all come to their end.
    channel_count : int
        Number of channel descriptions to expect.
    report_interval : float
        Stream time between provisional indicators (s), 0 for none.
    namespace : str
        Namespace of the stand.
    is_simulated : bool
        False for a run on hardware, whose log times are those of reception.

    Raises
    ------
    RecordingError
        If the bag cannot be made.

    """

    def __init__(
        self,
        path: Path,
        program: DriveProgram,
        *,
        run_info: Mapping[str, Any],
        provenance: Mapping[str, Any],
        recorded: tuple[Topic, ...] = topics.ALL_TOPICS,
        channel_count: int = len(topics.MEASURED_TOPICS),
        report_interval: float = 0.0,
        namespace: str = topics.DEFAULT_NAMESPACE,
        is_simulated: bool = True,
        types: BagTypes | None = None,
    ) -> None:
        self.program = program
        self.performance: Performance | None = None
        self.messages = 0
        self._types = types or installed_types()
        self._was_cut = False
        self._consumed = 0
        streams = [topic for topic in recorded if topic.intent is Intent.STREAM]
        self._ends = {topic.name: 0 for topic in streams if is_sampled(topic)}
        self._order = MessageOrder(
            [*(topic.name for topic in streams), topics.PERFORMANCE.name],
            {
                topics.RUN_INFO.name: 1 if run_info else 0,
                topics.DRIVE_PROGRAM.name: 1,
                topics.CHANNELS.name: channel_count,
            },
            is_simulated=is_simulated,
        )
        self._report_step = round(report_interval * program.sample_rate)
        self._order.promise(topics.PERFORMANCE.name, self._next_report(0))
        self._writer = RunWriter(
            path,
            run_id=program.run_id,
            run_info=run_info,
            provenance=provenance,
            topics=recorded,
            namespace=namespace,
            is_simulated=is_simulated,
            types=self._types,
        )

    @property
    def path(self) -> Path:
        """Folder of the bag."""
        return self._writer.path

    @property
    def lost(self) -> int:
        """Number of samples found missing, over all streams."""
        return sum(ledger.lost for ledger in self._writer.ledgers.values())

    @property
    def is_complete(self) -> bool:
        """Whether every stream has come to the program's end, and the final indicators are in."""
        end = min([*self._ends.values(), self._consumed])
        return end >= self.program.length and self.performance is not None

    def add(self, topic: str, data: bytes, received: int) -> None:
        """
        Take a message.

        Parameters
        ----------
        topic : str
            Name of its topic, as in the contracts.
        data : bytes
            The message as CDR.
        received : int
            Time of reception (ns since 1970): the log time of a run on hardware, and of messages
            without a time of the run.

        Raises
        ------
        RecordingError
            If the bag cannot be written.

        """
        message = self._types.deserialize(data, topic_named(topic).type_name)
        run_id = getattr(message, "run_id", self.program.run_id)
        if run_id != self.program.run_id:
            return
        time, end = received, None
        if self._order.is_simulated and topic != topics.DIAGNOSTICS.name:
            time = message_time(message)
        if topic in self._ends:
            block = block_from_message(message)
            self._ends[topic] = max(self._ends[topic], block.end_index)
            end = self._time(block.end_index)
        elif topic == topics.DRIVE_PROGRESS.name:
            self._consumed = max(self._consumed, int(message.consumed))
        elif topic == topics.DRIVE_PROGRAM.name:
            self._note_program(program_from_message(message))
        elif topic == topics.PERFORMANCE.name:
            if message.is_final:
                self.performance = performance_from_message(message)
            end = self._next_report(int(message.end_index))
        self._order.add(topic, data, time, end)
        self._write(self._order.ready())

    def _next_report(self, last: int) -> int:
        """Return the time before which no indicators come after those of `last` samples."""
        length = self.program.length
        following = last + self._report_step if self._report_step else length
        return self._time(min(following, length) if last < length else length + 1)

    def _time(self, index: int) -> int:
        return sample_time(self.program.epoch, index, self.program.sample_rate)

    def _note_program(self, program: DriveProgram) -> None:
        self._was_cut = self._was_cut or program != self.program
        self.program = program

    def _write(self, messages: Any) -> None:
        for message in messages:
            self._writer.write(message.topic, message.data, message.time)
            self.messages += 1

    @property
    def troubles(self) -> dict[str, object]:
        """What was not as it should be: streams waited for in vain, late and rejected messages."""
        return {
            "stalled": " ".join(self._order.given_up),
            "late": self._order.late_count,
            "rejected": sum(self._writer.rejected.values()),
        }

    def commit_if_due(self) -> None:
        """Write what waits too long; to be called now and then."""
        self._writer.commit_if_due()

    def close(self, reason: str = "") -> str:
        """
        Write what is left and close the bag.

        Parameters
        ----------
        reason : str
            Why the run ended before it was complete, if known.

        Returns
        -------
        str
            The end state: "completed", "cancelled", or "aborted" with the reason.

        Raises
        ------
        RecordingError
            If the bag could not be written.

        """
        if self.is_complete:
            state = CANCELLED if self._was_cut else COMPLETED
        else:
            state = f"{ABORTED}: {reason}" if reason else ABORTED
        result = None if self.performance is None else self.performance.to_mapping()
        try:
            self._write(self._order.flush())
        finally:  # a bag that cannot take more is closed with what it has
            self._writer.close(state, result)
        return state

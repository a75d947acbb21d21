"""What a driver did in one run, as the one who plays the generator's part saw it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from imotor_ros.contracts.blocks import SampleBlock
from imotor_ros.contracts.topics import MEASURED_TOPICS, VOLTAGE_MONITOR
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.samples import Samples


@dataclass(frozen=True)
class Published:
    """A block of a stream, and when (ns, clock of its writer's host) it was published."""

    moment: int
    block: SampleBlock


@dataclass(frozen=True)
class Acknowledgement:
    """A message on drive/progress, when (ns) it was published, and what had been sent by then."""

    moment: int
    sent: int
    stamp: int
    consumed: int
    flags: int
    fault: str


@dataclass(frozen=True)
class Description:
    """A message on channels: for which run, and since when sample 0 counts (ns)."""

    run_id: str
    epoch: int
    channel: ChannelDescription


@dataclass
class RunRecord:
    """
    One run.

    Attributes
    ----------
    program : DriveProgram
        What was announced last.
    voltage : list of ndarray
        The voltage (V) that was sent.
    sent : int
        Samples sent.
    blocks : dict
        What came of each measured stream.
    progress : list of Acknowledgement
        What came on drive/progress.
    descriptions : dict
        What came on channels, by channel.

    """

    program: DriveProgram
    voltage: list[Samples] = field(default_factory=list)
    sent: int = 0
    blocks: dict[str, list[Published]] = field(default_factory=dict)
    progress: list[Acknowledgement] = field(default_factory=list)
    descriptions: dict[str, Description] = field(default_factory=dict)

    @property
    def consumed(self) -> int:
        """Samples acknowledged, at most."""
        return max((one.consumed for one in self.progress), default=0)

    @property
    def fault(self) -> str:
        """The first fault told on drive/progress, or nothing."""
        return next((one.fault for one in self.progress if one.fault), "")

    @property
    def flags(self) -> int:
        """Flags of all acknowledgements and of the monitor's blocks."""
        value = 0
        for one in self.progress:
            value |= one.flags
        for published in self.blocks.get(VOLTAGE_MONITOR.name, ()):
            value |= published.block.flags
        return value

    def end_index(self, stream: str) -> int:
        """Return the sample up to which a stream has come."""
        published = self.blocks.get(stream)
        return published[-1].block.end_index if published else 0

    def is_complete(self, streams: tuple[str, ...]) -> bool:
        """Whether all of the program is acknowledged and measured."""
        length = self.program.length
        ends = (self.end_index(stream) for stream in streams)
        return self.consumed >= length and all(end >= length for end in ends)

    def samples(self, stream: str) -> Samples:
        """Return all samples of a stream that came (unit), one after the other."""
        published = self.blocks.get(stream, [])
        return np.concatenate([np.empty(0), *(one.block.samples for one in published)])

    def asked(self) -> Samples:
        """Return all of the voltage that was sent (V)."""
        return np.concatenate([np.empty(0), *self.voltage])


MEASURED = tuple(topic.name for topic in MEASURED_TOPICS)
"""Names of the measured streams."""

"""What has been measured of a run up to some sample, channel by channel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.alignment import BEFORE
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.evaluator_parameters import EvaluatorParameters
from imotor_ros.core.measured_stream import MeasuredStream
from imotor_ros.core.periods import PeriodGrid

Array = NDArray[np.float64]


class NotAvailable(Exception):
    """Why an indicator cannot be given: an outcome, no error; it never leaves the evaluation."""


class RunView:
    """
    A run as of some sample.

    Parameters
    ----------
    parameters : EvaluatorParameters
        How to evaluate.
    program : DriveProgram
        The run.
    grid : PeriodGrid
        Its drive periods.
    streams : mapping of str to MeasuredStream
        What was measured, by channel name.
    until : int
        Samples from this one on are not looked at.

    Attributes
    ----------
    rows : int
        Number of drive periods that every usable channel has.
    first : int
        First whole period at full drive that every channel shows.
    warnings : list of str
        What came up on the way.
    doubts : mapping of str to str
        Why channels cannot be what they say, by channel; see `plausibility`.

    """

    def __init__(
        self,
        parameters: EvaluatorParameters,
        program: DriveProgram,
        grid: PeriodGrid,
        streams: Mapping[str, MeasuredStream],
        until: int,
    ) -> None:
        self.parameters = parameters
        self.program = program
        self.grid = grid
        self.until = until
        self.warnings: list[str] = []
        self.doubts: Mapping[str, str] = {}
        self._streams = streams
        usable = [one for name, one in streams.items() if one.folded and not self.missing(name)]
        self.rows = min((min(one.rows_until(until), grid.count) for one in usable), default=0)
        leads = [-one.folded.delay for one in streams.values() if one.folded]
        earliest = BEFORE + max([0.0, *leads])
        self.first = grid.row_at(max(program.span("hold")[0], earliest))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return tuple(self._streams)

    @property
    def frequency(self) -> float:
        """Fundamental frequency of the drive (Hz)."""
        return self.program.fundamental_frequency

    @property
    def period(self) -> float:
        """Drive period (s)."""
        return self.grid.period / self.program.sample_rate

    def warn(self, text: str) -> None:
        """Take note of what the reader of the indicators should know."""
        self.warnings.append(text)

    def missing(self, name: str) -> str:
        """Return why a channel cannot be used; empty if it can."""
        stream = self._streams.get(name)
        if stream is None:
            return f"the run has no channel {name}"
        return stream.reason(self.until) or self.doubts.get(name, "")

    def require(self, *names: str) -> None:
        """
        Make sure that channels can be used.

        Raises
        ------
        NotAvailable
            If one cannot.

        """
        for name in names:
            reason = self.missing(name)
            if reason:
                raise NotAvailable(reason)

    def channel(self, name: str) -> ChannelDescription:
        """Return the description of a channel."""
        return self._streams[name].description

    def flags(self, name: str) -> int:
        """Return the flags of a channel."""
        return self._streams[name].flags(self.until)

    def start(self, name: str) -> Array:
        """Return the samples kept from the start of the run."""
        return self._streams[name].start(self.until)

    def means(self, name: str) -> Array:
        """Return the period means of a channel, shape (rows,)."""
        folded = self._streams[name].folded
        assert folded is not None
        return folded.means[: self.rows]

    def waveforms(self, name: str) -> Array:
        """Return the periods of a channel, shape (rows, points)."""
        folded = self._streams[name].folded
        assert folded is not None
        return folded.waveforms[: self.rows]

    def times(self, first: int, end: int) -> Array:
        """Return the middles of periods, in seconds since the start of the drive."""
        return self.grid.middle(np.arange(first, end)) / self.program.sample_rate

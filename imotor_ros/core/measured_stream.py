"""
What has arrived of one measured channel of a run: its drive periods, and all that went wrong.

Everything can be asked for as of any earlier sample, `until`: what came later, or in which
pieces it came, then makes no difference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.channel import ChannelDescription, SampleFlag
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.indicators import StreamCount
from imotor_ros.core.periods import FoldedChannel, PeriodGrid
from imotor_ros.core.step_probe import PROBED, StepProbe
from imotor_ros.errors import BadInputError

Samples = NDArray[np.float64]


@dataclass(frozen=True)
class _Event:
    """Something that happened at sample `index` and concerns the samples up to `end`."""

    index: int
    end: int
    amount: int = 0


class MeasuredStream:
    """
    One channel of a run.

    Parameters
    ----------
    description : ChannelDescription
        The channel.
    program : DriveProgram
        The run.
    grid : PeriodGrid or None
        Its drive periods; None if it has none.
    keeps_waveforms : bool
        False to keep period means only.
    keeps_start : int
        Number of samples at the start of the run that are kept as they are.

    """

    def __init__(
        self,
        description: ChannelDescription,
        program: DriveProgram,
        grid: PeriodGrid | None,
        *,
        keeps_waveforms: bool = True,
        keeps_start: int = 0,
    ) -> None:
        self.description = description
        self.folded: FoldedChannel | None = None
        if grid is not None:
            delay = description.delay * program.sample_rate
            self.folded = FoldedChannel(grid, delay, keeps_waveforms=keeps_waveforms)
        self._program = program
        self._start: Samples = np.empty(keeps_start)
        self._next = 0
        self._gaps: list[_Event] = []
        self._repeats: list[_Event] = []
        self._not_finite: list[_Event] = []
        self._flagged: list[_Event] = []
        self._other_rate: list[tuple[int, float]] = []
        self._stamp_errors: list[tuple[int, int]] = []
        self._steps = StepProbe(description.resolution, _probed(program))
        self._limited: list[NDArray[np.int64]] = []
        self._is_broken = False

    @property
    def end_index(self) -> int:
        """Number of samples of the run up to the last that came."""
        return self._next

    def change_program(self, program: DriveProgram) -> None:
        """Take note that the program was cut short."""
        self._program = program

    def add(
        self,
        first_index: int,
        samples: ArrayLike,
        flags: int,
        sample_rate: float | None,
        stamp_error: int = 0,
    ) -> None:
        """
        Take a block; see `RunEvaluator.add_samples`.

        Raises
        ------
        BadInputError
            If the samples are not one-dimensional or the index is negative.

        """
        block = np.ascontiguousarray(samples, dtype=np.float64)
        if np.ndim(samples) != 1 or first_index < 0:
            raise BadInputError(
                "is no block of samples", where=self.description.name,
                value=(first_index, np.shape(samples)), bound="first index >= 0, shape (n,)",
            )  # fmt: skip
        if flags:
            self._flagged.append(_Event(first_index, first_index + block.size, int(flags)))
        if sample_rate is not None and sample_rate != self._program.sample_rate:
            self._other_rate.append((first_index, sample_rate))
        if stamp_error:
            self._stamp_errors.append((first_index, stamp_error))
        block = self._in_order(first_index, block)
        if block.size:
            self._take(block)

    def _in_order(self, first_index: int, block: Samples) -> Samples:
        """Count what is missing and what came twice; return what is new."""
        if first_index > self._next:
            self._gaps.append(_Event(self._next, first_index))
            self._is_broken = True
            self._next = min(first_index, max(self._program.length, self._next))
        repeated = min(self._next - first_index, block.size)
        if repeated:
            self._repeats.append(_Event(first_index, first_index + repeated))
            self._is_broken = True
        end = max(self._program.length - first_index, 0)
        return block[repeated:end]

    def _take(self, block: Samples) -> None:
        first = self._next
        self._next += block.size
        is_finite = np.isfinite(block)
        if not is_finite.all():
            bad = np.flatnonzero(~is_finite)
            self._not_finite += [_Event(first + int(i), first + int(i) + 1) for i in bad]
            self._is_broken = True
        self._note_limits(first, block)
        self._steps.add(first, block)
        kept = self._start[first : self._next]
        kept[:] = block[: kept.size]
        # A broken stream needs no more periods: from here on nothing is read from it.
        if self.folded is not None and not self._is_broken:
            self.folded.add(block)

    def _note_limits(self, first: int, block: Samples) -> None:
        """Note samples at the end of the range, where a digitiser saturates."""
        limit = self.description.range - 1.5 * self.description.resolution
        if not 0.0 < limit < math.inf:
            return
        # two reductions are cheaper than a mask of all samples, and mostly enough
        if block.max() >= limit or block.min() <= -limit:
            found = np.flatnonzero(np.abs(block) >= limit)
            if found.size:
                self._limited.append(first + found)

    def rows_until(self, end: int) -> int:
        """Return how many drive periods rest on samples before `end` alone."""
        return 0 if self.folded is None else min(self.folded.rows, self.folded.rows_until(end))

    def start(self, end: int) -> Samples:
        """Return the samples kept from the start of the run, up to `end`."""
        return self._start[: min(self._start.size, end, self._next)]

    def flags(self, end: int) -> int:
        """Return the flags of all blocks that begin before `end`."""
        flags = 0
        for event in self._flagged:
            if event.index < end:
                flags |= event.amount
        return flags

    def count(self, end: int) -> StreamCount:
        """Return what came and what is missing of the samples before `end`."""
        reached = min(end, self._next)
        lost = _total(self._gaps, reached)
        return StreamCount(self.description.name, reached - lost, lost, self.flags(end))

    def reason(self, end: int) -> str:
        """Return why nothing can be read from the samples before `end`; empty if it can."""
        name, reached = self.description.name, min(end, self._next)
        if reached == 0:
            return f"no samples of {name} have come"
        lost, repeated = _total(self._gaps, reached), _total(self._repeats, reached)
        if lost:
            return f"{lost} of {reached} samples of {name} are missing"
        if self.flags(end) & SampleFlag.GAP:
            return f"samples of {name} are missing, as its source says"
        if repeated:
            return f"{repeated} of {reached} samples of {name} came twice"
        return self._value_reason(end, reached)

    def _value_reason(self, end: int, reached: int) -> str:
        name = self.description.name
        rates = [rate for index, rate in self._other_rate if index < end]
        if rates:
            return (
                f"{name} is sampled at {rates[0]:.12g} Hz, but the drive program says "
                f"{self._program.sample_rate:.12g} Hz"
            )
        stamps = [error for index, error in self._stamp_errors if index < end]
        if stamps:
            return (
                f"the stamps of {name} are not those of its samples (epoch + index / rate), but "
                f"{stamps[0] * 1e-9:.9g} s off: stamps from another clock"
            )
        not_finite = _total(self._not_finite, reached)
        if not_finite:
            return f"{not_finite} of {reached} samples of {name} are not finite"
        limit = f"{self.description.range:g} {self.description.unit}"
        limited = sum(int(np.searchsorted(found, reached)) for found in self._limited)
        if limited:
            return f"{limited} of {reached} samples of {name} are at the end of its range, {limit}"
        if self.flags(end) & SampleFlag.OVER_RANGE:
            return f"{name} was over its range, {limit}"
        if self.flags(end) & SampleFlag.RAMPED_DOWN:
            return f"{name} was measured while the driver took the voltage off by itself"
        return self._steps.defect(name, self.description.unit, reached)


def _probed(program: DriveProgram) -> tuple[int, int]:
    """Return where the steps of the samples are looked at: in the steady drive, if there is one."""
    start, end = 0, program.length
    if any(segment.label == "hold" for segment in program.segments):
        start, end = program.span("hold")
    return start, min(end, start + PROBED)


def _total(events: list[_Event], end: int) -> int:
    """Return how many samples before `end` the events concern."""
    return sum(min(event.end, end) - event.index for event in events if event.index < end)

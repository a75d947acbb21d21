"""
Drive periods: a stream folded into periods, and the mean waveform of many of them.

A drive period is in general no whole number of samples (216.216... at 4625 Hz and 1 MS/s).
Every period is therefore read at the same phases, by interpolation, with the delay of the
channel taken out on the way: at the middles of equal parts, so that the mean of the points belongs
to the middle of the period. Over such a period the plain mean of the points is exact for every
harmonic of the drive below half the number of points, and so is the discrete Fourier transform.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from imotor_ros.core.alignment import AFTER, BEFORE, read_grid
from imotor_ros.core.drive import DriveProgram
from imotor_ros.errors import BadInputError

Samples = NDArray[np.float64]
Rows = NDArray[np.float64]

# Points per period: at least as many as samples, so that no noise is folded, and never so few
# that extrema between points matter.
_FEWEST_POINTS = 64
_POINTS_STEP = 16


@dataclass(frozen=True)
class PeriodGrid:
    """
    Where the drive periods of a run lie.

    Attributes
    ----------
    origin : int
        Sample at which period 0 starts.
    period : float
        Length of a period (samples).
    count : int
        Number of periods.
    points : int
        Number of points at which each period is read.
    start_phase : float
        Phase of the drive at the start of every period (cycles, 0 to 1).

    """

    origin: int
    period: float
    count: int
    points: int
    start_phase: float = 0.0

    @classmethod
    def of_program(cls, program: DriveProgram) -> PeriodGrid:
        """
        Return the periods from the start of "ramp_up" to the end of "hold".

        Raises
        ------
        BadInputError
            If the program has no segment "hold", if the drive is not steady in it, or if its
            period is shorter than 8 samples.

        """
        labels = [segment.label for segment in program.segments]
        hold_start, end = program.span("hold")
        hold = program.segments[labels.index("hold")]
        origin = program.span("ramp_up")[0] if "ramp_up" in labels else hold_start
        frequency = program.fundamental_frequency
        if not (hold.start_frequency == hold.end_frequency == frequency and frequency > 0.0):
            raise BadInputError(
                "is not steady", where="hold", value=(hold.start_frequency, hold.end_frequency),
                bound=f"{frequency:g} Hz, > 0, throughout",
            )  # fmt: skip
        period = program.sample_rate / frequency
        if period < 8.0:
            raise BadInputError(
                "is too short", where="drive period", value=period, bound=">= 8 samples"
            )
        points = max(_FEWEST_POINTS, _POINTS_STEP * math.ceil(period / _POINTS_STEP))
        count = max(0, math.floor((end - origin) / period + 1e-9))
        return cls(origin, period, count, points, _cycles_at(program, origin))

    def middle(self, rows: NDArray[np.int64] | int) -> NDArray[np.float64]:
        """Return the middle of periods, in samples since the start of period 0."""
        return (np.asarray(rows, dtype=np.float64) + 0.5) * self.period

    def row_at(self, sample: float) -> int:
        """Return the first period that starts at or after a sample; it may lie past the end."""
        return max(0, math.ceil((sample - self.origin) / self.period - 1e-9))

    def first_sample(self, row: int) -> int:
        """Return the first sample that lies within period `row`."""
        return math.ceil(self.origin + row * self.period - 1e-6)

    @property
    def phases(self) -> NDArray[np.float64]:
        """Phases of the points (cycles of the drive, from `start_phase`), shape (points,)."""
        return np.asarray(self.start_phase + (np.arange(self.points) + 0.5) / self.points)


def _cycles_at(program: DriveProgram, sample: int) -> float:
    """Return the cycles of the drive at the start of a segment, less whole ones."""
    cycles, start = 0.0, 0
    for segment in program.segments:
        if start >= sample:
            break
        mean = 0.5 * (segment.start_frequency + segment.end_frequency)
        cycles = (cycles + segment.length * mean / program.sample_rate) % 1.0
        start += segment.length
    return cycles


class FoldedChannel:
    """
    The drive periods of one channel, filled as its samples come.

    However the samples are cut into blocks, the periods are the same to the last bit.

    Parameters
    ----------
    grid : PeriodGrid
        Where the periods lie.
    delay : float
        Delay of the channel (samples), which is taken out.
    keeps_waveforms : bool
        False to keep the means of the periods only.

    """

    def __init__(self, grid: PeriodGrid, delay: float, *, keeps_waveforms: bool = True) -> None:
        self.grid = grid
        self.delay = delay
        self.rows = 0
        self._keeps_waveforms = keeps_waveforms
        self._waveforms: Rows = np.empty((0, grid.points))
        self._means: Samples = np.empty(0)
        self._kept: Samples = np.empty(0)
        self._size = 0
        self._next = 0
        self._first_kept = 0

    @property
    def waveforms(self) -> Rows:
        """The complete periods, shape (rows, grid.points), or (0, grid.points) if not kept."""
        return self._waveforms[: self.rows if self._keeps_waveforms else 0]

    @property
    def means(self) -> Samples:
        """The means of the complete periods, shape (rows,)."""
        return self._means[: self.rows]

    def add(self, samples: Samples) -> None:
        """Take the next samples of the stream, whose first sample is sample 0 of the run."""
        self._next += samples.size
        if self.rows == self.grid.count:
            return
        needed = self._span(self.rows)[0]
        if self._next <= needed:
            return
        self._keep(samples, needed)
        complete = self.rows_until(self._next)
        if complete > self.rows:
            self._fold(complete)

    def _fold(self, end: int) -> None:
        grid, row = self.grid, self.rows
        waveforms = np.empty((end - row, grid.points))
        means = np.empty(end - row)
        fold_rows(
            self._kept, self._first_kept, grid.origin, grid.period, self.delay, row,
            waveforms, means,
        )  # fmt: skip
        self._means = _with(self._means, row, means, grid.count)
        if self._keeps_waveforms:
            self._waveforms = _with(self._waveforms, row, waveforms, grid.count)
        self.rows = end

    def _span(self, row: int) -> tuple[int, int]:
        """First sample needed for a period, and the one after the last."""
        start = self.grid.origin + (row * self.grid.period + self.delay)
        return math.floor(start) - BEFORE, math.floor(start + self.grid.period) + AFTER + 1

    def rows_until(self, end: int) -> int:
        """Return the number of periods that rest on samples before `end` alone."""
        reach = (end - self.grid.origin - self.delay) / self.grid.period
        rows = min(self.grid.count, max(0, math.floor(reach) + 1))
        while rows > 0 and self._span(rows - 1)[1] > end:
            rows -= 1
        return rows

    def _keep(self, samples: Samples, needed: int) -> None:
        """Append samples to those kept, and forget those before `needed`."""
        begin = self._next - samples.size
        if self._size == 0:
            self._first_kept = max(begin, needed)
            samples = samples[self._first_kept - begin :]
        if self._size + samples.size > self._kept.size:
            drop = min(max(needed - self._first_kept, 0), self._size)
            rest = self._kept[drop : self._size]
            longer = np.empty(2 * (rest.size + samples.size) + 64)
            longer[: rest.size] = rest
            self._kept, self._size = longer, rest.size
            self._first_kept += drop
        self._kept[self._size : self._size + samples.size] = samples
        self._size += samples.size


def _with(kept: Rows, size: int, more: Rows, limit: int) -> Rows:
    """Put `more` behind the first `size` rows of an array, which grows where it must."""
    end = size + len(more)
    if end > len(kept):
        longer = np.empty((min(max(end, len(kept) * 3 // 2, 64), limit), *kept.shape[1:]))
        longer[:size] = kept[:size]
        kept = longer
    kept[size:end] = more
    return kept


@njit(
    types.void(
        types.float64[::1], types.int64, types.float64, types.float64, types.float64,
        types.int64, types.float64[:, ::1], types.float64[::1],
    ),
    cache=True,
    error_model="numpy",
)  # fmt: skip
def fold_rows(
    samples: Samples, first_index: int, origin: float, period: float, delay: float,
    row: int, waveforms: Rows, means: Samples,
) -> None:  # fmt: skip
    """
    Read periods `row`, `row` + 1, ... and their means out of samples (kernel).

    `samples` starts at sample `first_index` of the run. The whole part of a period's start is
    split off first: the positions within must not depend on `first_index`, not even in the last
    bit. A period that starts too early in the stream to be read is NaN.
    """
    step = period / waveforms.shape[1]
    for j in range(means.size):
        start = origin + ((row + j) * period + delay + 0.5 * step)
        whole = math.floor(start)
        base = whole - BEFORE - first_index
        if base < 0:
            waveforms[j, :] = np.nan
        else:
            read_grid(samples[base:], start - whole + BEFORE, step, 0, waveforms[j])
        total = 0.0
        for i in range(waveforms.shape[1]):
            total += waveforms[j, i]
        means[j] = total / waveforms.shape[1]


@njit(
    types.void(types.float64[:, ::1], types.int64[::1], types.float64[:, ::1]),
    cache=True,
    error_model="numpy",
)
def add_alternating(waveforms: Rows, selection: NDArray[np.int64], halves: Rows) -> None:
    """
    Average the selected periods in two halves, alternating (kernel).

    `halves`, shape (2, points), receives the mean of the 1st, 3rd, ... and of the 2nd, 4th, ...
    selected period.
    """
    halves[:, :] = 0.0
    for i in range(selection.size):
        row = selection[i]
        half = i % 2
        for j in range(halves.shape[1]):
            halves[half, j] += waveforms[row, j]
    odd = (selection.size + 1) // 2
    for j in range(halves.shape[1]):
        halves[0, j] /= max(odd, 1)
        halves[1, j] /= max(selection.size - odd, 1)


@njit(
    types.void(types.float64[:, ::1], types.int64[::1], types.float64[::1], types.float64[::1]),
    cache=True,
    error_model="numpy",
)
def project_rows(
    waveforms: Rows, selection: NDArray[np.int64], weights: Samples, values: Samples
) -> None:
    """Weigh the points of each selected period and add them up, in `values` (kernel)."""
    for i in range(selection.size):
        row = selection[i]
        total = 0.0
        for j in range(weights.size):
            total += waveforms[row, j] * weights[j]
        values[i] = total


@njit(
    types.void(types.float64[:, ::1], types.int64[::1], types.float64[::1], types.float64[::1]),
    cache=True,
    error_model="numpy",
)
def square_deviations(
    waveforms: Rows, selection: NDArray[np.int64], waveform: Samples, values: Samples
) -> None:
    """Mean square deviation of each selected period from a waveform, in `values` (kernel)."""
    for i in range(selection.size):
        row = selection[i]
        total = 0.0
        for j in range(waveform.size):
            total += (waveforms[row, j] - waveform[j]) ** 2
        values[i] = total / waveform.size

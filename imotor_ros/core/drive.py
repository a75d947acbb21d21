"""Drive programs: the voltage over a whole run, as segments of offset and harmonics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from imotor_ros.errors import BadInputError


class Ending(IntEnum):
    """How a run ends; the numbers are those of DriveProgram.msg, which says more."""

    PLANNED = 0
    STOPPED = 1
    ABANDONED = 2


@dataclass(frozen=True)
class DriveSegment:
    """
    A stretch of the drive voltage: offset and harmonics, each linear from start to end.

    Attributes
    ----------
    label : str
        What the segment is for: "bias", "ramp_up", "hold", "ramp_down", "release", "step 3", ...
    length : int
        Number of samples.
    start_frequency, end_frequency : float
        Fundamental frequency (Hz); different values make a linear sweep.
    start_offset, end_offset : float
        Offset (V).
    start_amplitudes, end_amplitudes : tuple of float
        Amplitudes (V) of harmonics 1, 2, ...
    phases : tuple of float
        Sine phases (rad) of harmonics 1, 2, ...

    """

    label: str
    length: int
    start_frequency: float
    end_frequency: float
    start_offset: float = 0.0
    end_offset: float = 0.0
    start_amplitudes: tuple[float, ...] = ()
    end_amplitudes: tuple[float, ...] = ()
    phases: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check lengths and numbers."""
        if self.length < 1:
            raise BadInputError(
                "is too short", where=f"{self.label}.length", value=self.length, bound=">= 1"
            )
        counts = {len(self.start_amplitudes), len(self.end_amplitudes), len(self.phases)}
        if len(counts) != 1:
            raise BadInputError(
                "has different numbers of amplitudes and phases",
                where=self.label,
                value=sorted(counts),
            )
        numbers = (
            *(self.start_frequency, self.end_frequency, self.start_offset, self.end_offset),
            *self.start_amplitudes,
            *self.end_amplitudes,
            *self.phases,
        )
        for number in numbers:
            if not math.isfinite(number):
                raise BadInputError("is not finite", where=self.label, value=number)


@dataclass(frozen=True)
class DriveProgram:
    """
    What is played in a run.

    Attributes
    ----------
    run_id : str
        Name of the run.
    epoch : int
        Time of sample 0 (ns since 1970).
    sample_rate : float
        Samples per second (Hz).
    fundamental_frequency : float
        Fundamental frequency of the steady drive (Hz).
    segments : tuple of DriveSegment
        The segments, in order.
    motion_amplitudes, motion_phases : tuple of float
        Wanted rod displacement of the steady drive: amplitudes (m) and sine phases (rad) of
        harmonics 1, 2, ..., with the cycles of the drive.
    ending : Ending
        How it ends: as given, stopped, or abandoned by the generator.

    """

    run_id: str
    epoch: int
    sample_rate: float
    fundamental_frequency: float
    segments: tuple[DriveSegment, ...]
    motion_amplitudes: tuple[float, ...] = ()
    motion_phases: tuple[float, ...] = ()
    ending: Ending = Ending.PLANNED
    _starts: tuple[int, ...] = field(init=False, repr=False, compare=False, default=())

    def __post_init__(self) -> None:
        """Check the segments and note where each starts."""
        if not self.segments:
            raise BadInputError("has no segments", where=f"drive program {self.run_id}")
        if not (math.isfinite(self.sample_rate) and self.sample_rate > 0):
            raise BadInputError(
                "is out of bounds", where="sample_rate", value=self.sample_rate, bound="> 0 Hz"
            )
        starts = [0]
        for segment in self.segments:
            starts.append(starts[-1] + segment.length)
        object.__setattr__(self, "_starts", tuple(starts))

    @property
    def length(self) -> int:
        """Number of samples."""
        return self._starts[-1]

    def span(self, label: str) -> tuple[int, int]:
        """
        Return the first sample of the first segment `label`, and the one after its last.

        Raises
        ------
        BadInputError
            If no segment has that label.

        """
        for segment, start in zip(self.segments, self._starts, strict=False):
            if segment.label == label:
                return start, start + segment.length
        raise BadInputError("no such segment", where=f"drive program {self.run_id}", value=label)

    def cycles(self, label: str, index: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return the cycles of the fundamental since the start of the drive, less whole ones.

        Parameters
        ----------
        label : str
            A segment of constant frequency.
        index : ndarray, shape (n,)
            Samples in it or near it, counted from that of the program; need not be whole.

        Raises
        ------
        BadInputError
            If no segment has that label.

        """
        start, _ = self.span(label)
        place = self._starts.index(start)
        frequency = self.segments[place].start_frequency
        turns = self._start_cycles[place] + (index - start) * (frequency / self.sample_rate)
        return turns - np.floor(turns)

    def stopped_at(
        self, index: int, ramp_length: int | None = None, release_length: int | None = None
    ) -> DriveProgram:
        """
        Return the program cut at sample `index` and brought to 0 V from there.

        The amplitudes go to zero linearly during "ramp_down", then the offset during "release".
        A program that would end sooner by itself is returned as it is.

        Parameters
        ----------
        index : int
            First sample that differs from this program's, from 0 to `length`.
        ramp_length, release_length : int, optional
            Samples of the two segments; by default those of the last two segments.

        Raises
        ------
        BadInputError
            If `index` lies outside the program.

        """
        if not 0 <= index <= self.length:
            raise BadInputError(
                "is outside the program", where="index", value=index, bound=f"0 to {self.length}"
            )
        ramp = ramp_length or self.segments[-2 if len(self.segments) > 1 else -1].length
        release = release_length or self.segments[-1].length
        if index + ramp + release >= self.length:
            return self
        place = next(i for i in range(len(self.segments)) if index < self._starts[i + 1])
        cut = self.segments[place]
        share = (index - self._starts[place]) / cut.length
        frequency = cut.start_frequency + (cut.end_frequency - cut.start_frequency) * share
        offset = cut.start_offset + (cut.end_offset - cut.start_offset) * share
        pairs = zip(cut.start_amplitudes, cut.end_amplitudes, strict=True)
        amplitudes = tuple(start + (end - start) * share for start, end in pairs)
        zero = (0.0,) * len(amplitudes)
        kept = list(self.segments[:place])
        if share > 0.0:
            kept.append(
                replace(
                    cut,
                    length=index - self._starts[place],
                    end_frequency=frequency,
                    end_offset=offset,
                    end_amplitudes=amplitudes,
                )
            )
        down = DriveSegment(
            "ramp_down", ramp, frequency, frequency, offset, offset, amplitudes, zero, cut.phases
        )
        off = DriveSegment("release", release, 0.0, 0.0, offset, 0.0, zero, zero, cut.phases)
        return replace(self, segments=(*kept, down, off))

    @cached_property
    def _start_cycles(self) -> tuple[float, ...]:
        """Cycles of the fundamental at the start of each segment, less whole ones."""
        cycles = [0.0]
        for segment in self.segments:
            mean = 0.5 * (segment.start_frequency + segment.end_frequency)
            cycles.append((cycles[-1] + segment.length * mean / self.sample_rate) % 1.0)
        return tuple(cycles)

    def render(self, first: int, count: int) -> NDArray[np.float64]:
        """
        Return the voltage (V), shape (count,), of samples `first` to `first + count - 1`.

        Each sample depends on its index only: however a program is cut into blocks, its
        samples are the same to the last bit. Past the end the voltage is that of the last
        segment's end.
        """
        voltage = np.empty(count)
        last = self.segments[-1]
        voltage[:] = last.end_offset
        for i, segment in enumerate(self.segments):
            begin = max(first, self._starts[i])
            end = min(first + count, self._starts[i + 1])
            if begin < end:
                local = np.arange(begin - self._starts[i], end - self._starts[i], dtype=np.float64)
                rendered = _render_segment(segment, local, self.sample_rate, self._start_cycles[i])
                voltage[begin - first : end - first] = rendered
        return voltage


def _render_segment(
    segment: DriveSegment, index: NDArray[np.float64], sample_rate: float, cycles: float
) -> NDArray[np.float64]:
    share = index / segment.length
    slope = (segment.end_frequency - segment.start_frequency) * 0.5
    turns = cycles + index * (segment.start_frequency + slope * share) / sample_rate
    voltage = segment.start_offset + (segment.end_offset - segment.start_offset) * share
    pairs = zip(segment.start_amplitudes, segment.end_amplitudes, segment.phases, strict=True)
    for k, (start, end, phase) in enumerate(pairs, 1):
        if start == 0.0 and end == 0.0:
            continue  # a line that a multisine leaves out
        amplitude = start + (end - start) * share
        voltage += amplitude * np.sin(2.0 * np.pi * ((k * turns) % 1.0) + phase)
    return voltage


def steady_drive(
    *,
    run_id: str,
    epoch: int,
    sample_rate: float,
    fundamental_frequency: float,
    offset: float,
    amplitudes: Sequence[float],
    phases: Sequence[float],
    hold_time: float,
    bias_time: float = 5e-3,
    ramp_periods: float = 1.0,
    motion_amplitudes: Sequence[float] = (),
    motion_phases: Sequence[float] = (),
) -> DriveProgram:
    """
    Return the program of an ordinary run: bias, ramp_up, hold, ramp_down, release.

    Parameters
    ----------
    run_id, epoch, sample_rate, fundamental_frequency, motion_amplitudes, motion_phases
        See `DriveProgram`.
    offset : float
        Voltage (V) about which the harmonics swing; reached slowly during "bias".
    amplitudes, phases : sequence of float
        Amplitudes (V) and sine phases (rad) of the steady voltage.
    hold_time : float
        Length of the steady drive (s).
    bias_time : float
        Time taken to reach the offset, and to leave it at the end (s).
    ramp_periods : float
        Length of the ramps of the amplitudes, in periods of the fundamental.

    """
    frequency = fundamental_frequency
    ramp = max(1, round(ramp_periods * sample_rate / frequency))
    slow = max(1, round(bias_time * sample_rate))
    hold = max(1, round(hold_time * sample_rate))
    full, zero = tuple(map(float, amplitudes)), (0.0,) * len(amplitudes)
    angles = tuple(map(float, phases))
    # the bias must not turn the phase: it swings at frequency 0, so that cycles start with ramp_up
    plan = (
        ("bias", slow, 0.0, 0.0, offset, zero, zero),
        ("ramp_up", ramp, frequency, offset, offset, zero, full),
        ("hold", hold, frequency, offset, offset, full, full),
        ("ramp_down", ramp, frequency, offset, offset, full, zero),
        ("release", slow, 0.0, offset, 0.0, zero, zero),
    )
    segments = tuple(
        DriveSegment(label, length, f, f, u0, u1, a0, a1, angles)
        for label, length, f, u0, u1, a0, a1 in plan
    )
    return DriveProgram(
        run_id=run_id,
        epoch=epoch,
        sample_rate=sample_rate,
        fundamental_frequency=frequency,
        segments=segments,
        motion_amplitudes=tuple(motion_amplitudes),
        motion_phases=tuple(motion_phases),
    )

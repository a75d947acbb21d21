"""How all trials of a procedure are driven: the parts of a drive program that they share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from imotor_ros.core.drive import DriveProgram, DriveSegment
from imotor_ros.core.drive_limits import DriveLimits
from imotor_ros.errors import DriveLimitError

RAMP_TIME = 1e-3
"""Time (s) in which the amplitude of a measurement rises, and falls."""

PROBE_SHARES = (0.05, 0.005)
"""Amplitudes of the first pass of a measurement over the room about the offset.

It only tells how much each frequency bears; the second is for where the first is too much.
"""

RANGE_SHARE = 0.4
"""Share of an instrument's range that the second pass is planned to use.

The gain of a ceramic grows with the amplitude, up to twice: the range will do for that as well.
"""

_DEFAULT_SHARE = 0.6
"""Amplitude of a measurement over the room about the offset, where none is asked for."""


@dataclass(frozen=True)
class DriveSetting:
    """
    What all trials of a procedure have in common.

    Attributes
    ----------
    run_id : str
        Name of the procedure; those of its trials begin with it.
    epoch : int
        Time of sample 0 of every trial (ns since 1970).
    sample_rate : float
        Samples per second (Hz).
    offset : float
        Voltage (V) about which everything swings.
    bias_time : float
        Time (s) taken to reach the offset and to leave it.
    limits : DriveLimits
        What motor and amplifier allow.

    """

    run_id: str
    epoch: int
    sample_rate: float
    offset: float
    bias_time: float
    limits: DriveLimits

    @property
    def room(self) -> float:
        """Largest amplitude (V) about the offset."""
        return self.limits.room(self.offset)

    def amplitude(self, wanted: float) -> float:
        """
        Return the amplitude (V) of a measurement: `wanted`, or if that is 0, the usual one.

        Raises
        ------
        DriveLimitError
            If it is more than the range leaves about the offset.

        """
        amplitude = wanted or _DEFAULT_SHARE * self.room
        if not 0.0 < amplitude <= self.room:
            raise DriveLimitError(
                f"{self.run_id}: response", "amplitude about the offset", amplitude, self.room, "V"
            )
        return amplitude

    def program(
        self, name: str, frequency: float, segments: Sequence[DriveSegment]
    ) -> DriveProgram:
        """
        Return the program of a trial: `segments` between a bias and its release.

        Raises
        ------
        DriveLimitError
            If it needs more than is allowed.

        """
        count = len(segments[0].phases)
        zero = (0.0,) * count
        slow = max(1, round(self.bias_time * self.sample_rate))
        ends = ((0.0, self.offset), (self.offset, 0.0))
        bias, release = (
            DriveSegment(label, slow, 0.0, 0.0, u0, u1, zero, zero, zero)
            for label, (u0, u1) in zip(("bias", "release"), ends, strict=True)
        )
        program = DriveProgram(
            run_id=f"{self.run_id}.{name}",
            epoch=self.epoch,
            sample_rate=self.sample_rate,
            fundamental_frequency=frequency,
            segments=(bias, *segments, release),
        )
        self.limits.check_program(program)
        return program

    def segment(
        self,
        label: str,
        time: float,
        frequencies: tuple[float, float],
        start: ArrayLike,
        end: ArrayLike,
        phases: ArrayLike,
    ) -> DriveSegment:
        """Return a segment about the offset: its frequency and amplitudes run from start to end."""
        return DriveSegment(
            label=label,
            length=max(1, round(time * self.sample_rate)),
            start_frequency=frequencies[0],
            end_frequency=frequencies[1],
            start_offset=self.offset,
            end_offset=self.offset,
            start_amplitudes=_numbers(start),
            end_amplitudes=_numbers(end),
            phases=_numbers(phases),
        )


def _numbers(values: ArrayLike) -> tuple[float, ...]:
    return tuple(np.asarray(values, dtype=np.float64).tolist())

"""What a drive program asks of the amplifier, and whether the motor may have it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from imotor_ros.core.drive import DriveProgram, DriveSegment
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.core.samples import Samples
from imotor_ros.core.signals import extremes
from imotor_ros.errors import DriveLimitError

_ROUNDING = 1e-9
"""Share of a limit by which the last digits of a computed extreme may pass it."""


@dataclass(frozen=True)
class DriveDemand:
    """
    What a stretch of drive voltage needs.

    Attributes
    ----------
    lowest, highest : float
        Extremes of the voltage (V), ramps included.
    slope : float
        Bound of its slope (V/s); in a steady stretch, its largest slope.

    """

    lowest: float
    highest: float
    slope: float


@dataclass(frozen=True)
class DriveLimits(Parameters):
    """What the motor and its amplifier allow; by default those of the paper's motor."""

    lowest_voltage: float = parameter(
        -20.0, "lowest voltage that may leave the generator", unit="V", high=0.0
    )
    highest_voltage: float = parameter(
        120.0, "highest voltage that may leave the generator", unit="V", low=0.0, excludes_low=True
    )
    slew_rate: float = parameter(
        20e6, "largest slope of the amplifier's output", unit="V/s", low=0.0, excludes_low=True
    )
    current_limit: float = parameter(
        10.0, "largest current of the amplifier", unit="A", low=0.0, excludes_low=True
    )
    load_capacitance: float = parameter(
        1.6124e-6, "capacitance by which a slope becomes a current: that at large signals",
        unit="F", low=0.0, excludes_low=True,
    )  # fmt: skip

    @property
    def largest_slope(self) -> float:
        """Largest slope (V/s) that neither slew rate nor current forbids."""
        return min(self.slew_rate, self.current_limit / self.load_capacitance)

    def room(self, offset: float) -> float:
        """Return the largest amplitude (V) about an offset (V) that stays in the range."""
        return max(0.0, min(offset - self.lowest_voltage, self.highest_voltage - offset))

    def check_program(self, program: DriveProgram) -> None:
        """
        Check that a program stays within the limits, ramps and any stop included.

        A stop brings the amplitudes to zero and then the offset: what a program may reach is
        reached in its segments, and 0 V is always allowed.

        Raises
        ------
        DriveLimitError
            With the needed and the allowed value, of the first segment that needs too much.

        """
        for segment in program.segments:
            where = f"{program.run_id}: {segment.label}"
            self.check_demand(segment_demand(segment, program.sample_rate), where)
            first, _ = program.span(segment.label)
            if first > 0:
                last, voltage = program.render(first - 1, 2).tolist()
                jump = abs(voltage - last) * program.sample_rate
                self.check_demand(DriveDemand(0.0, 0.0, jump), f"start of {where}")

    def check_demand(self, demand: DriveDemand, where: str) -> None:
        """
        Check a demand.

        Parameters
        ----------
        demand : DriveDemand
            What is needed.
        where : str
            What needs it, for the error.

        Raises
        ------
        DriveLimitError
            With the needed and the allowed value.

        """
        span = _ROUNDING * (self.highest_voltage - self.lowest_voltage)
        if demand.highest > self.highest_voltage + span:
            raise DriveLimitError(where, "voltage", demand.highest, self.highest_voltage, "V")
        if demand.lowest < self.lowest_voltage - span:
            raise DriveLimitError(where, "voltage", demand.lowest, self.lowest_voltage, "V")
        if demand.slope > self.slew_rate:
            raise DriveLimitError(where, "slew rate", demand.slope, self.slew_rate, "V/s")
        current = demand.slope * self.load_capacitance
        if current > self.current_limit:
            raise DriveLimitError(where, "current", current, self.current_limit, "A")

    def contain(self, voltage: ArrayLike, where: str) -> Samples:
        """
        Return rendered samples (V) for which the range holds: the last gate before they leave.

        Parameters
        ----------
        voltage : array_like, shape (n,)
            Samples of a program that was checked.
        where : str
            What they belong to, for the error.

        Raises
        ------
        DriveLimitError
            If one of them is out of range by more than the last digits, or not a number.

        """
        samples = np.asarray(voltage, dtype=np.float64)
        if not samples.size:
            return samples
        span = _ROUNDING * (self.highest_voltage - self.lowest_voltage)
        lowest, highest = float(samples.min()), float(samples.max())
        # written so that NaN does not pass
        if not highest <= self.highest_voltage + span:
            raise DriveLimitError(where, "voltage", highest, self.highest_voltage, "V")
        if not lowest >= self.lowest_voltage - span:
            raise DriveLimitError(where, "voltage", lowest, self.lowest_voltage, "V")
        return np.clip(samples, self.lowest_voltage, self.highest_voltage)


def segment_demand(segment: DriveSegment, sample_rate: float) -> DriveDemand:
    """
    Return what a segment of a drive program needs.

    Offset and amplitudes run linearly from start to end while the phases stay. So the voltage is
    always between what it would be with those of the start and with those of the end: the
    extremes of these two waveforms bound it, and in a steady segment they are its own.

    Parameters
    ----------
    segment : DriveSegment
        The segment.
    sample_rate : float
        Samples per second (Hz).

    """
    duration = segment.length / sample_rate
    ends = (
        (segment.start_offset, segment.start_amplitudes),
        (segment.end_offset, segment.end_amplitudes),
    )
    lows, highs, slopes = [], [], []
    for offset, amplitudes in ends:
        low, high = extremes(amplitudes, segment.phases)
        lows.append(offset + low)
        highs.append(offset + high)
        slopes.append(_largest_slope(amplitudes, segment.phases))
    frequency = max(abs(segment.start_frequency), abs(segment.end_frequency))
    change = np.subtract(segment.end_amplitudes, segment.start_amplitudes)
    low, high = extremes(change, segment.phases)
    drift = abs(segment.end_offset - segment.start_offset) + max(-low, high)
    return DriveDemand(
        lowest=min(lows),
        highest=max(highs),
        slope=2.0 * math.pi * frequency * max(slopes) + drift / duration,
    )


def _largest_slope(amplitudes: ArrayLike, phases: ArrayLike) -> float:
    """Return the largest slope (V per radian of the fundamental) of a sum of harmonics."""
    sizes = np.asarray(amplitudes, dtype=np.float64)
    orders = np.arange(1, sizes.size + 1)
    low, high = extremes(orders * sizes, np.asarray(phases, dtype=np.float64) + 0.5 * np.pi)
    return max(-low, high)


def program_demand(program: DriveProgram) -> DriveDemand:
    """Return what a whole drive program needs; see `segment_demand`."""
    demands = [segment_demand(segment, program.sample_rate) for segment in program.segments]
    return DriveDemand(
        lowest=min(demand.lowest for demand in demands),
        highest=max(demand.highest for demand in demands),
        slope=max(demand.slope for demand in demands),
    )

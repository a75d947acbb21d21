"""
The drive for friction identification: a sine whose amplitude is stepped up, and down again.

Every step is a ramp ("ramp 7") and a stretch of constant amplitude ("step 7") of one frequency,
so that the drive's phase runs on through the whole run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from imotor_ros.core.drive import DriveProgram, DriveSegment
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.core.signals import HarmonicMotion, sine
from imotor_ros.errors import BadInputError

RISING = "rising"
FALLING = "falling"
REST = "rest"

Voltage = tuple[Sequence[float], Sequence[float]]
"""Amplitudes (V) and sine phases (rad) of harmonics 1, 2, ... of a drive voltage."""

_FEWEST_PERIODS = 12


@dataclass(frozen=True)
class SteppedSineParameters(Parameters):
    """A sine whose amplitude rises in equal steps, and falls in the same steps."""

    frequency: float = parameter(
        2000.0, "frequency of the sine", unit="Hz", low=1.0, high=100e3, source="section 5"
    )
    lowest_amplitude: float = parameter(
        0.1e-6, "rod displacement amplitude of the first and the last step", unit="m", low=0.0,
        excludes_low=True, high=1e-3, source="figure 8",
    )  # fmt: skip
    highest_amplitude: float = parameter(
        8e-6, "rod displacement amplitude of the two steps in the middle", unit="m", low=0.0,
        excludes_low=True, high=1e-3, source="figure 8",
    )  # fmt: skip
    steps: int = parameter(40, "number of steps each way", low=2, high=10_000, source="assumed")
    step_time: float = parameter(
        20e-3, "length of a step at constant amplitude", unit="s", low=0.0, excludes_low=True,
        high=60.0, source="assumed: 40 periods, of which a third lets the slider settle",
    )  # fmt: skip
    ramp_time: float = parameter(
        2e-3, "time taken from one amplitude to the next", unit="s", low=0.0, high=60.0,
        source="assumed",
    )  # fmt: skip
    corrections: int = parameter(
        4, "corrections of the voltages by the measured rod motion, 0 for none", low=0, high=20,
        source="section 6; four leave 0.2 % of unwanted harmonics on the paper's stand",
    )  # fmt: skip
    corrected_frequency: float = parameter(
        80e3, "highest frequency of the harmonics that hysteresis makes and a correction brings "
        "to rest", unit="Hz", low=0.0, high=1e6,
        source="assumed: what vibrometer and amplifier still show and pass",
    )  # fmt: skip
    offset: float = parameter(
        50.0, "voltage about which the sine swings", unit="V", low=-1e3, high=1e3
    )
    bias_time: float = parameter(
        5e-3, "time taken to reach the offset and to leave it", unit="s", low=0.0, high=60.0
    )
    rest_time: float = parameter(
        10e-3, "time without motion before the first step: shows the offsets of the channels",
        unit="s", low=0.0, high=60.0, source="assumed",
    )  # fmt: skip

    @property
    def amplitudes(self) -> tuple[float, ...]:
        """Rod displacement amplitude (m) of every step, the highest one twice."""
        rising = np.linspace(self.lowest_amplitude, self.highest_amplitude, self.steps)
        return tuple(np.concatenate([rising, rising[::-1]]).tolist())

    def check(self) -> None:
        """Refuse steps that go the wrong way or hold too few periods."""
        if self.lowest_amplitude >= self.highest_amplitude:
            raise BadInputError(
                "is not below the highest amplitude",
                where="SteppedSineParameters.lowest_amplitude",
                value=self.lowest_amplitude,
                bound=f"< {self.highest_amplitude:g} m",
            )
        if self.step_time * self.frequency < _FEWEST_PERIODS:
            raise BadInputError(
                "is too short",
                where="SteppedSineParameters.step_time",
                value=self.step_time,
                bound=f">= {_FEWEST_PERIODS / self.frequency:g} s, {_FEWEST_PERIODS} periods",
            )


def linear_voltages(
    parameters: SteppedSineParameters, voltage_for: Callable[[HarmonicMotion], Voltage]
) -> tuple[Voltage, ...]:
    """
    Return the voltages of all steps by a model of the stator.

    Parameters
    ----------
    parameters : SteppedSineParameters
        The steps.
    voltage_for : callable
        Returns the voltage that gives a wanted rod motion: the inverse of a linear response.

    """
    return tuple(voltage_for(sine(one, parameters.frequency)) for one in parameters.amplitudes)


def stepped_drive(
    parameters: SteppedSineParameters,
    voltages: Sequence[Voltage],
    *,
    run_id: str,
    epoch: int,
    sample_rate: float,
) -> DriveProgram:
    """
    Return a program of steps: bias, rest, ramps and steps, ramp_down, release.

    Parameters
    ----------
    parameters : SteppedSineParameters
        Frequency and times.
    voltages : sequence of Voltage
        The voltage of each step; first harmonics of one phase, or the voltage jumps.
    run_id, epoch, sample_rate
        See `DriveProgram`.

    """
    frequency = parameters.frequency
    count = max(len(amplitudes) for amplitudes, _ in voltages)
    tones = [(_padded(u, count), _padded(p, count)) for u, p in voltages]
    zero = (0.0,) * count
    slow, ramp = (_samples(t, sample_rate) for t in (parameters.bias_time, parameters.ramp_time))
    offset = parameters.offset
    first, last = tones[0][1], tones[-1]
    segments = [DriveSegment("bias", slow, 0.0, 0.0, 0.0, offset, zero, zero, first)]
    if parameters.rest_time > 0.0:
        length = _samples(parameters.rest_time, sample_rate)
        segments.append(DriveSegment(REST, length, 0.0, 0.0, offset, offset, zero, zero, first))

    def add(label: str, length: int, start: Sequence[float], tone: Voltage) -> None:
        voltage = (offset, offset, tuple(start), tuple(tone[0]), tuple(tone[1]))
        segments.append(DriveSegment(label, length, frequency, frequency, *voltage))

    hold = _samples(parameters.step_time, sample_rate)
    for number, (before, tone) in enumerate(pairwise([(zero, first), *tones]), 1):
        add(f"ramp {number}", ramp, before[0], tone)
        add(f"step {number}", hold, tone[0], tone)
    add("ramp_down", ramp, last[0], (zero, last[1]))
    segments.append(DriveSegment("release", slow, 0.0, 0.0, offset, 0.0, zero, zero, last[1]))
    return DriveProgram(run_id, epoch, sample_rate, frequency, tuple(segments))


def stepped_sine_drive(
    parameters: SteppedSineParameters,
    voltage_for: Callable[[HarmonicMotion], Voltage],
    *,
    run_id: str,
    epoch: int,
    sample_rate: float,
) -> DriveProgram:
    """Return the program of steps whose voltages a function tells; see `stepped_drive`."""
    voltages = linear_voltages(parameters, voltage_for)
    return stepped_drive(parameters, voltages, run_id=run_id, epoch=epoch, sample_rate=sample_rate)


def _padded(values: Sequence[float], count: int) -> tuple[float, ...]:
    return (*map(float, values), *((0.0,) * (count - len(values))))


def _samples(time: float, sample_rate: float) -> int:
    return max(1, round(time * sample_rate))


@dataclass(frozen=True)
class DriveStep:
    """
    One step of constant amplitude.

    Attributes
    ----------
    number : int
        Its number in the run, from 1.
    branch : str
        "rising" or "falling": which way the amplitude goes on the whole.
    start, end : int
        Its first sample, and the one after its last.

    """

    number: int
    branch: str
    start: int
    end: int


def steps_of(program: DriveProgram) -> tuple[DriveStep, ...]:
    """
    Return the steps of a stepped-sine program, in order.

    The branch rises to the first step that has the highest voltage, and falls after it.

    Raises
    ------
    BadInputError
        If the program has no steps, or a step is not a steady drive at the program's frequency.

    """
    spans: list[tuple[int, int]] = []
    voltages: list[float] = []
    start = 0
    for segment in program.segments:
        if segment.label.startswith("step "):
            _check_steady(segment, program)
            spans.append((start, start + segment.length))
            voltages.append(segment.start_amplitudes[0] if segment.start_amplitudes else 0.0)
        start += segment.length
    if not spans:
        raise BadInputError(
            "has no steps", where=f"drive program {program.run_id}",
            bound='segments "step 1", "step 2", ...: a sine of stepped amplitude',
        )  # fmt: skip
    # a corrected voltage may differ a little between the two steps at the top
    top = int(np.flatnonzero(np.array(voltages) > 0.999 * max(voltages))[0])
    return tuple(
        DriveStep(i + 1, RISING if i <= top else FALLING, *span) for i, span in enumerate(spans)
    )


def _check_steady(segment: DriveSegment, program: DriveProgram) -> None:
    frequency = program.fundamental_frequency
    is_steady = (
        segment.start_frequency == segment.end_frequency == frequency > 0.0
        and segment.start_offset == segment.end_offset
        and segment.start_amplitudes == segment.end_amplitudes
    )
    if not is_steady:
        raise BadInputError(
            "is not a steady drive", where=f"{program.run_id}: {segment.label}",
            bound=f"one amplitude, {frequency:g} Hz",
        )  # fmt: skip

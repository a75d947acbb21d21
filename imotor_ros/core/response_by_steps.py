"""
Frequency response by a stepped sine.

First at a small amplitude, which tells how much each frequency bears, then at the amplitude
wanted, or what the vibrometer can show and the amplifier give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from imotor_ros.core.channel import ROD_VELOCITY
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.drive_setting import PROBE_SHARES, RAMP_TIME, RANGE_SHARE, DriveSetting
from imotor_ros.core.harmonic_fit import PARTS, fit_harmonics, window_length
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.response import COMMAND, MeasuredResponse
from imotor_ros.core.response_estimate import estimate_response, is_over_range, refuse_overload
from imotor_ros.core.samples import Samples
from imotor_ros.core.trial import Procedure, Recording, Trial

STEPPED_SINE = "stepped_sine"

_SLOPE_SHARE = 0.8
"""Share of the amplifier's slope that a step is planned to use; the ramps need a little more."""

_SWEEPS = 4
"""Largest number of sweeps, each with half the amplitude of the one before."""


class SteppedResponse(NamedTuple):
    """
    What a stepped sine has shown.

    Attributes
    ----------
    small : MeasuredResponse
        At one small amplitude.
    large : MeasuredResponse
        At the amplitude wanted, or less where that would be too much.
    amplitude : float
        The amplitude wanted (V).
    velocity_range : float
        Largest velocity (m/s) that the channel shows.

    """

    small: MeasuredResponse
    large: MeasuredResponse
    amplitude: float
    velocity_range: float


def measure_steps(
    setting: DriveSetting,
    frequencies: Sequence[float],
    amplitude: float,
    *,
    settling_time: float,
    measuring_time: float,
    reference: str = COMMAND,
) -> Procedure[SteppedResponse]:
    """
    Return the procedure that measures the response to a sine at given frequencies.

    Parameters
    ----------
    setting : DriveSetting
        How trials are driven.
    frequencies : sequence of float
        Frequencies (Hz), rising.
    amplitude : float
        Largest amplitude (V); 0 for 0.6 of what the range leaves about the offset. It is
        smaller where vibrometer or amplifier would be overloaded.
    settling_time, measuring_time : float
        Time (s) left out and measured at each frequency.
    reference : str
        Channel of the voltage, or `COMMAND` for the voltage as commanded.

    """
    wanted = setting.amplitude(amplitude)
    steps = _Steps(setting, tuple(frequencies), settling_time, measuring_time, reference)
    largest = np.minimum(wanted, steps.largest_amplitudes())
    for number, share in enumerate(PROBE_SHARES, 1):
        probe = np.full(len(largest), min(share * setting.room, float(largest.min())))
        recording = yield Trial(steps.program(f"probe-{number}", probe), "response: probe")
        if not is_over_range(recording, ROD_VELOCITY):
            break
    small = steps.evaluate(recording, probe)
    _, channel = recording.channel(ROD_VELOCITY)
    bearable = RANGE_SHARE * channel.range / np.abs(small.admittances)
    amplitudes = np.minimum(bearable, largest)
    for number in range(1, _SWEEPS + 1):
        recording = yield Trial(steps.program(f"sweep-{number}", amplitudes), "response: sweep")
        if not is_over_range(recording, ROD_VELOCITY):
            break
        # an odd harmonic of a step that meets a resonance is not to be foreseen
        amplitudes = 0.5 * amplitudes
    return SteppedResponse(small, steps.evaluate(recording, amplitudes), wanted, channel.range)


@dataclass(frozen=True)
class _Steps:
    """A sine of one frequency after the other."""

    setting: DriveSetting
    frequencies: tuple[float, ...]
    settling_time: float
    measuring_time: float
    reference: str

    def largest_amplitudes(self) -> Samples:
        """Return the amplitudes (V) that the slope of the amplifier lets through, shape (n,)."""
        slope = _SLOPE_SHARE * self.setting.limits.largest_slope
        return np.asarray(slope / (2.0 * np.pi * np.array(self.frequencies)))

    def program(self, name: str, amplitudes: Samples) -> DriveProgram:
        """Return the program with an amplitude (V) for every frequency."""
        segment, rate = self.setting.segment, self.setting.sample_rate
        segments = []
        for k, (frequency, size) in enumerate(zip(self.frequencies, amplitudes, strict=True), 1):
            # two more periods: the channel is late, and parts begin at whole samples
            measured = window_length(frequency, rate, self.measuring_time) / rate
            time = self.settling_time + measured + 2.0 / frequency + 20e-6
            steady = (frequency, frequency)
            # no glide from step to step: it would pass through the resonances between them
            segments += [
                segment(f"rise {k}", RAMP_TIME, steady, [0.0], [size], [0.0]),
                segment(f"step {k}", time, steady, [size], [size], [0.0]),
                segment(f"fall {k}", RAMP_TIME, steady, [size], [0.0], [0.0]),
            ]
        return self.setting.program(name, self.frequencies[0], segments)

    def evaluate(self, recording: Recording, amplitudes: Samples) -> MeasuredResponse:
        """Return the response that a recording shows."""
        refuse_overload(
            recording, ROD_VELOCITY, *([] if self.reference == COMMAND else [self.reference])
        )
        velocity = self._phasors(recording, ROD_VELOCITY)
        voltage: Complex = np.tile(amplitudes.astype(np.complex128), (PARTS, 1))
        if self.reference != COMMAND:
            voltage = self._phasors(recording, self.reference)
        return estimate_response(
            STEPPED_SINE, self.reference, self.frequencies, velocity, voltage, amplitudes, recording
        )

    def _phasors(self, recording: Recording, name: str) -> Complex:
        """Return the phasors of a channel by part and frequency, shape (PARTS, n)."""
        samples, channel = recording.channel(name)
        return np.column_stack(
            [
                fit_harmonics(
                    samples,
                    channel,
                    recording.program,
                    f"step {k}",
                    settling_time=self.settling_time,
                    count=1,
                ).parts[:, 0]
                for k in range(1, len(self.frequencies) + 1)
            ]
        )

"""
Frequency response by multisines: many frequencies at once, with random phases, some times over.

With hysteresis the answer to one frequency depends on all others. The mean over the phases is
the best linear approximation for signals of this kind and size, and what differs from one set
of phases to the next lowers the coherence, as noise does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.channel import ROD_VELOCITY, VOLTAGE
from imotor_ros.core.channel_response import channel_response
from imotor_ros.core.drive import DriveProgram, DriveSegment
from imotor_ros.core.drive_setting import PROBE_SHARES, RAMP_TIME, RANGE_SHARE, DriveSetting
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.random_streams import generator
from imotor_ros.core.response import MeasuredResponse
from imotor_ros.core.response_estimate import estimate_response, is_over_range, refuse_overload
from imotor_ros.core.samples import Samples
from imotor_ros.core.signals import extremes
from imotor_ros.core.trial import Procedure, Recording, Trial

MULTISINE = "multisine"


def measure_multisine(multisine: Multisine) -> Procedure[MeasuredResponse]:
    """
    Return the procedure that measures the response by a multisine.

    A first pass with a small peak tells whether the vibrometer bears the one wanted; the second
    has that, or as much as the range lets.

    Parameters
    ----------
    multisine : Multisine
        What to play; its amplitude is the one wanted.

    """
    setting = multisine.setting
    for number, share in enumerate(PROBE_SHARES, 1):
        probe = replace(multisine, amplitude=min(multisine.amplitude, share * setting.room))
        recording = yield Trial(probe.program(f"probe-{number}"), "response: probe")
        if not is_over_range(recording, ROD_VELOCITY):
            break
    refuse_overload(recording, ROD_VELOCITY)
    samples, channel = recording.channel(ROD_VELOCITY)
    peak = max(float(np.abs(samples).max()), channel.resolution)
    bearable = probe.amplitude * RANGE_SHARE * channel.range / peak
    final = replace(multisine, amplitude=min(multisine.amplitude, bearable))
    recording = yield Trial(final.program("multisine"), "response: multisine")
    return final.evaluate(recording)


@dataclass(frozen=True)
class Multisine:
    """
    Sums of sines of equal amplitude and random phases, one after the other.

    Attributes
    ----------
    setting : DriveSetting
        How it is driven.
    frequencies : tuple of float
        Wanted frequencies (Hz); the nearest multiples of the period's are taken.
    amplitude : float
        Peak (V).
    period : float
        Period (s).
    settling_time, measuring_time : float
        Time (s) left out and least time measured of each sum.
    realisations : int
        Number of sums, each with phases of its own.

    """

    setting: DriveSetting
    frequencies: tuple[float, ...]
    amplitude: float
    period: float
    settling_time: float
    measuring_time: float
    realisations: int

    @property
    def _length(self) -> int:
        """Samples in a period."""
        return max(2, round(self.period * self.setting.sample_rate))

    @property
    def _base(self) -> float:
        """Frequency (Hz) that all lines are multiples of."""
        return self.setting.sample_rate / self._length

    @property
    def _lines(self) -> NDArray[np.int64]:
        """Multiples of the base frequency that are used."""
        wanted = np.rint(np.array(self.frequencies) / self._base)
        return np.unique(np.maximum(wanted, 1.0).astype(np.int64))

    @property
    def _count(self) -> int:
        """Periods measured of each realisation."""
        return max(1, math.ceil(self.measuring_time / self.period))

    def program(self, name: str) -> DriveProgram:
        """
        Return the program: every realisation comes and goes by a ramp.

        Parameters
        ----------
        name : str
            Name of the trial.

        Raises
        ------
        DriveLimitError
            If it needs more than is allowed.

        """
        draws = generator(0, "multisine/phases")
        lines = self._lines
        hold = self.settling_time + (self._count + 1) * self._length / self.setting.sample_rate
        segments: list[DriveSegment] = []
        for k in range(1, self.realisations + 1):
            phases = np.zeros(lines[-1])
            phases[lines - 1] = draws.uniform(-np.pi, np.pi, len(lines))
            sizes = self._scaled(phases)
            zero = np.zeros(len(sizes))
            for label, time, start, end in (
                ("ramp_up", RAMP_TIME, zero, sizes),
                ("multisine", hold, sizes, sizes),
                ("ramp_down", RAMP_TIME, sizes, zero),
            ):
                part = f"{label} {k}", time, (self._base, self._base)
                segments.append(self.setting.segment(*part, start, end, phases))
        return self.setting.program(name, self._base, segments)

    def _scaled(self, phases: Samples) -> Samples:
        """Return amplitudes (V), equal at all lines, so that the peak is the one wanted."""
        sizes = np.zeros(len(phases))
        sizes[self._lines - 1] = 1.0
        low, high = extremes(sizes, phases)
        return np.asarray(sizes * (self.amplitude / max(-low, high)))

    def evaluate(self, recording: Recording) -> MeasuredResponse:
        """Return the response that a recording of the program shows."""
        refuse_overload(recording, ROD_VELOCITY, VOLTAGE)
        velocity, voltage = (self._phasors(recording, name) for name in (ROD_VELOCITY, VOLTAGE))
        frequencies = (self._lines * self._base).tolist()
        peaks = np.full(len(frequencies), self.amplitude)
        return estimate_response(
            MULTISINE, VOLTAGE, frequencies, velocity, voltage, peaks, recording
        )

    def _phasors(self, recording: Recording, name: str) -> Complex:
        """Return the phasors of a channel by realisation and line."""
        samples, channel = recording.channel(name)
        program, lines = recording.program, self._lines
        rows = []
        for k in range(1, self.realisations + 1):
            label = f"multisine {k}"
            late = self.settling_time + max(channel.delay, 0.0)
            first = program.span(label)[0] + math.ceil(late * program.sample_rate)
            window = samples[first : first + self._count * self._length]
            period = window.reshape(self._count, self._length).mean(axis=0)
            spectrum = np.fft.rfft(period)[lines] * (2j / self._length)
            turns = program.cycles(label, np.array([float(first)]))[0]
            rows.append(spectrum * np.exp(-2j * np.pi * ((lines * turns) % 1.0)))
        return np.array(rows) / channel_response(channel, lines * self._base)

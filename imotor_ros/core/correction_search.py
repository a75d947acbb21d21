"""What the search for a voltage is made of: measured motion, its errors, and the next voltage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imotor_ros.core.channel import ROD_VELOCITY
from imotor_ros.core.correction_parameters import CorrectionParameters
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.drive_setting import DriveSetting
from imotor_ros.core.excitation import Excitation, voltage_for_motion
from imotor_ros.core.harmonic_fit import HarmonicFit, fit_harmonics, window_length
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.response import MeasuredResponse
from imotor_ros.core.response_by_steps import SteppedResponse
from imotor_ros.core.response_estimate import refuse_overload
from imotor_ros.core.samples import Samples
from imotor_ros.core.signals import HarmonicMotion, extremes
from imotor_ros.core.trial import Recording
from imotor_ros.errors import DriveLimitError

_GUARD = 2.0
"""Standard uncertainties by which an error must be below its tolerance."""


@dataclass(frozen=True)
class MotionErrors:
    """How far a measured motion is from the wanted one."""

    amplitudes: Samples
    phases: Samples
    uncertainties: Samples
    unwanted: Samples

    @property
    def largest(self) -> tuple[float, float]:
        """Largest error of an amplitude (relative) and of a phase (rad)."""
        return float(np.abs(self.amplitudes).max()), float(np.abs(self.phases).max())


@dataclass(frozen=True)
class Search:
    """What stays the same during the search for a voltage."""

    setting: DriveSetting
    motion: HarmonicMotion
    parameters: CorrectionParameters
    ramp_periods: float
    is_corrected: bool

    @property
    def count(self) -> int:
        """Number of harmonics that are driven."""
        wanted, settings = self.motion.harmonics, self.parameters
        if not self.is_corrected:
            return wanted
        highest = min(settings.suppression_limit, 0.1 * self.setting.sample_rate)
        possible = math.floor(highest / self.motion.fundamental_frequency)
        return max(wanted, min(wanted + settings.suppressed_harmonics, possible))

    @property
    def orders(self) -> Samples:
        """Numbers of the harmonics."""
        return np.arange(1.0, self.count + 1.0)

    @property
    def wanted(self) -> Complex:
        """Wanted displacement A exp(i psi) (m); 0 for the harmonics to be suppressed."""
        wanted = np.zeros(self.count, dtype=np.complex128)
        phases = np.array(self.motion.phases)
        wanted[: self.motion.harmonics] = np.array(self.motion.amplitudes) * np.exp(1j * phases)
        return wanted

    def check_velocity(self, velocity_range: float) -> None:
        """
        Check that the channel can show the wanted motion.

        Raises
        ------
        DriveLimitError
            With the needed and the available range.

        """
        low, high = extremes(
            2.0 * np.pi * self.motion.fundamental_frequency * np.abs(self.wanted) * self.orders,
            np.angle(self.wanted) + 0.5 * np.pi,
        )
        needed = max(-low, high)
        if needed > velocity_range:
            where = f"{self.setting.run_id}: {ROD_VELOCITY}"
            raise DriveLimitError(where, "velocity", needed, velocity_range, "m/s")

    def gains(self, response: SteppedResponse) -> Complex:
        """
        Return the displacement per volt (m/V) at the amplitude of the response.

        Where a harmonic bears less, its gain at the small amplitude grows as that of the first
        one does: hysteresis acts before the dynamics.
        """
        small, large = np.array(response.small.gains), np.array(response.large.gains)
        is_full = np.array(response.large.amplitudes) >= 0.99 * response.amplitude
        if not is_full[0]:
            return self._checked(response.large, large)
        return self._checked(response.large, np.where(is_full, large, small * large[0] / small[0]))

    def _checked(self, response: MeasuredResponse, gains: Complex) -> Complex:
        # the response itself says where it is no basis for a voltage
        response(np.array(response.frequencies))
        return gains

    def linear_voltage(self, gains: Complex) -> Complex:
        """Return the voltage A exp(i psi) (V) of the linear model."""
        count = self.motion.harmonics
        amplitudes, phases = voltage_for_motion(self.motion, lambda _: gains[:count])
        voltage = np.zeros(self.count, dtype=np.complex128)
        voltage[:count] = np.array(amplitudes) * np.exp(1j * np.array(phases))
        return voltage

    def program(self, name: str, voltage: Complex) -> DriveProgram:
        """
        Return the program that plays a voltage.

        Raises
        ------
        DriveLimitError
            If it needs more than the limits allow.

        """
        frequency, setting = self.motion.fundamental_frequency, self.setting
        measured = window_length(frequency, setting.sample_rate, self.parameters.measuring_time)
        hold = self._settling_time + measured / setting.sample_rate + 2.0 / frequency + 20e-6
        program = steady_drive(
            run_id=f"{setting.run_id}.{name}",
            epoch=setting.epoch,
            sample_rate=setting.sample_rate,
            fundamental_frequency=frequency,
            offset=setting.offset,
            amplitudes=np.abs(voltage).tolist(),
            phases=np.angle(voltage).tolist(),
            hold_time=hold,
            bias_time=setting.bias_time,
            ramp_periods=self.ramp_periods,
            motion_amplitudes=self.motion.amplitudes,
            motion_phases=self.motion.phases,
        )
        setting.limits.check_program(program)
        return program

    @property
    def _settling_time(self) -> float:
        return max(self.parameters.settling_time, 3.0 / self.motion.fundamental_frequency)

    def measure(self, recording: Recording) -> HarmonicFit:
        """Return the displacement (m) that a recording shows."""
        refuse_overload(recording, ROD_VELOCITY)
        samples, channel = recording.channel(ROD_VELOCITY)
        fit = fit_harmonics(
            samples,
            channel,
            recording.program,
            "hold",
            settling_time=self._settling_time,
            count=self.count,
        )
        omega = 2.0 * np.pi * self.motion.fundamental_frequency * self.orders
        return HarmonicFit(fit.parts / (1j * omega))

    def errors(self, moved: HarmonicFit) -> MotionErrors:
        """Compare a measured displacement with the wanted one."""
        count = self.motion.harmonics
        wanted, phasors = self.wanted, moved.phasors
        ratio = phasors[:count] / wanted[:count]
        first = np.angle(ratio[0])
        relative = np.angle(ratio * np.exp(-1j * self.orders[:count] * first))
        relative[0] = first
        speeds = np.abs(phasors) * self.orders
        largest = np.max(np.abs(wanted) * self.orders)
        return MotionErrors(
            amplitudes=np.abs(ratio) - 1.0,
            phases=relative,
            uncertainties=moved.uncertainties[:count] / np.abs(wanted[:count]),
            unwanted=speeds[count:] / largest,
        )

    def is_content(self, errors: MotionErrors, *, is_last: bool) -> bool:
        """Whether the motion is as wanted; in the end, unwanted harmonics are put up with."""
        settings, guard = self.parameters, _GUARD * errors.uncertainties
        is_good = bool(
            np.all(np.abs(errors.amplitudes) + guard <= settings.amplitude_tolerance)
            and np.all(np.abs(errors.phases) + guard <= settings.phase_tolerance)
        )
        is_quiet = bool(np.all(errors.unwanted <= settings.suppression_tolerance))
        return is_good and (is_quiet or is_last)

    def failure(self, errors: MotionErrors) -> str:
        """Say which harmonic is how far off."""
        settings = self.parameters
        guard = _GUARD * errors.uncertainties
        excess = np.maximum(
            (np.abs(errors.amplitudes) + guard) / settings.amplitude_tolerance,
            (np.abs(errors.phases) + guard) / settings.phase_tolerance,
        )
        k = int(np.argmax(excess))
        frequency = (k + 1) * self.motion.fundamental_frequency
        return (
            f"{self.setting.run_id}: the rod does not come to the wanted motion: after "
            f"{settings.cycle_limit} corrections harmonic {k + 1}, {frequency:g} Hz, is off by "
            f"{100 * errors.amplitudes[k]:.2g} % and {math.degrees(errors.phases[k]):.2g} degrees "
            f"(uncertain by {100 * errors.uncertainties[k]:.2g} %), allowed are "
            f"{100 * settings.amplitude_tolerance:.2g} % and "
            f"{math.degrees(settings.phase_tolerance):.2g} degrees"
        )

    def result(self, gains: Complex, voltage: Complex, found: Sequence[MotionErrors]) -> Excitation:
        """Put together what was found."""
        linear = self.linear_voltage(gains)[: self.motion.harmonics]
        last = found[-1]
        return Excitation(
            fundamental_frequency=self.motion.fundamental_frequency,
            motion_amplitudes=self.motion.amplitudes,
            motion_phases=self.motion.phases,
            response_gains=_numbers(np.abs(gains)),
            response_phases=_numbers(np.angle(gains)),
            linear_amplitudes=_numbers(np.abs(linear)),
            linear_phases=_numbers(np.angle(linear)),
            amplitudes=_numbers(np.abs(voltage)),
            phases=_numbers(np.angle(voltage)),
            amplitude_errors=_numbers(last.amplitudes),
            phase_errors=_numbers(last.phases),
            uncertainties=_numbers(last.uncertainties),
            unwanted_velocities=_numbers(last.unwanted),
            cycles=len(found) - 1,
            largest_amplitude_errors=tuple(one.largest[0] for one in found),
            largest_phase_errors=tuple(one.largest[1] for one in found),
        )


class Broyden:
    """
    Finds the next voltage from those tried: Broyden's method, starting with the response.

    In units of displacement: a voltage counts as what the linear model makes of it.
    """

    def __init__(self, gains: Complex) -> None:
        self._gains = gains
        self._slopes = np.eye(2 * len(gains))
        self._last: tuple[Samples, Samples] | None = None

    def next_voltage(self, voltage: Complex, moved: Complex, wanted: Complex) -> Complex:
        """Return the voltage to be tried after one that has moved the rod by `moved`."""
        inputs, outputs = _parts(voltage * self._gains), _parts(moved)
        if self._last is not None:
            step, change = inputs - self._last[0], outputs - self._last[1]
            length = float(step @ step)
            if length > 0.0:
                self._slopes += np.outer(change - self._slopes @ step, step / length)
        self._last = inputs, outputs
        missing = np.linalg.solve(self._slopes, _parts(wanted - moved))
        count = len(self._gains)
        return voltage + (missing[:count] + 1j * missing[count:]) / self._gains


def _parts(values: Complex) -> Samples:
    return np.concatenate([values.real, values.imag])


def _numbers(values: Samples) -> tuple[float, ...]:
    return tuple(float(value) for value in values)

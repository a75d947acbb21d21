"""
The indicators of one run, from what has been measured up to some sample.

Only measured signals are looked at. Time 0 is the start of the segment "ramp_up"; periods during
the ramp are left out of everything.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core import waveforms
from imotor_ros.core.channel import (
    CURRENT,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    SampleFlag,
)
from imotor_ros.core.indicators import (
    DURABILITY,
    EFFICIENCY,
    FORCE,
    MEAN_VELOCITY,
    RIPPLE,
    START_UP_TIME,
    UNITS,
    Indicator,
    Window,
)
from imotor_ros.core.period_statistics import SIGNIFICANT, standard_error
from imotor_ros.core.run_view import NotAvailable, RunView
from imotor_ros.core.run_windows import RunWindows
from imotor_ros.core.steady_state import start_up_time

Array = NDArray[np.float64]
Selection = NDArray[np.int64]

# Share of a constant velocity that AC coupling may take away over the run.
_MOST_VELOCITY_DECAY = 0.01

# Share of the ripple that the bandwidth may hide before the reader is warned.
_MUCH_HIDDEN = 0.05

_LIMITS = {
    SampleFlag.VOLTAGE_CLIPPED: "the amplifier clipped the voltage",
    SampleFlag.SLEW_LIMITED: "the amplifier limited the slew rate of the voltage",
    SampleFlag.CURRENT_LIMITED: "the amplifier limited the current",
}


class RunAnalysis:
    """
    The indicators of a run.

    Parameters
    ----------
    view : RunView
        The run.

    """

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._windows = RunWindows(view)

    def indicators(self) -> tuple[Indicator, ...]:
        """Return all indicators, in the order of `UNITS`."""
        self._warn_of_limits()
        self._warn_of_bandwidths()
        makers = {
            MEAN_VELOCITY: self._mean_velocity,
            START_UP_TIME: self._start_up_time,
            RIPPLE: self._ripple,
            DURABILITY: self._durability,
            EFFICIENCY: self._efficiency,
            FORCE: self._force,
        }
        found = []
        for name, unit in UNITS.items():
            try:
                value, uncertainty = makers[name]()
            except NotAvailable as reason:
                found.append(Indicator(name, unit, reason=str(reason)))
            else:
                found.append(Indicator(name, unit, float(value), float(uncertainty)))
        return tuple(found)

    def windows(self) -> tuple[Window, ...]:
        """Return the windows found."""
        return self._windows.found()

    def mean_velocities(self) -> tuple[dict[str, Array], int, str]:
        """Return the mean waveforms of the free run, its periods, and why there are none."""
        try:
            rows = self._windows.selection(SLIDER_VELOCITY)
        except NotAvailable as reason:
            return {}, 0, str(reason)
        names = [name for name in (ROD_VELOCITY, SLIDER_VELOCITY) if not self._view.missing(name)]
        found = {n: waveforms.mean_waveform(self._view.waveforms(n), rows) for n in names}
        return found, rows.size, ""

    # ------------------------------------------------------------------ velocity

    def _mean_velocity(self) -> tuple[float, float]:
        mean, error = self._velocity()
        gain = self._view.channel(SLIDER_VELOCITY).gain_uncertainty
        return mean, math.hypot(error, gain * mean)

    def _velocity(self) -> tuple[float, float]:
        """Return the mean velocity and its uncertainty, that of the gain left out."""
        view = self._view
        view.require(SLIDER_VELOCITY)
        channel = view.channel(SLIDER_VELOCITY)
        decay = 2.0 * math.pi * channel.high_pass_frequency * view.rows * view.period
        if decay > _MOST_VELOCITY_DECAY:
            raise NotAvailable(
                f"{SLIDER_VELOCITY} is AC-coupled (lower cut-off frequency "
                f"{channel.high_pass_frequency:.3g} Hz): it does not show a mean velocity"
            )
        values = view.means(SLIDER_VELOCITY)[self._windows.selection(SLIDER_VELOCITY)]
        mean = float(np.mean(values))
        parts = (standard_error(values), self._drift, channel.offset_uncertainty, decay * mean)
        return mean, math.hypot(*parts)

    @property
    def _drift(self) -> float:
        return self._windows.free_run().drift

    def _moving(self, what: str) -> float:
        """Return the mean velocity, or refuse where the slider does not move for certain."""
        mean, error = self._velocity()
        if abs(mean) <= SIGNIFICANT * error:
            raise NotAvailable(
                f"{what} has no meaning: the mean velocity, {mean:.2g} m/s, is not different from "
                f"zero (standard uncertainty {error:.2g} m/s)"
            )
        return mean

    def _start_up_time(self) -> tuple[float, float]:
        self._moving("the start-up time")
        settling = self._windows.free_run().settling
        assert settling is not None
        first = float(self._view.times(self._view.first, self._view.first + 1)[0])
        offset = self._view.channel(SLIDER_VELOCITY).offset_uncertainty
        time, uncertainty, reason = start_up_time(settling, first, offset)
        if reason:
            raise NotAvailable(reason)
        return time, uncertainty

    # ------------------------------------------------------------------ waveforms

    def _harmonics(self, *names: str) -> int:
        """Return how many harmonics all of the channels show."""
        view = self._view
        rate, points = view.program.sample_rate, view.grid.points
        widths = (view.channel(name).bandwidth for name in names)
        return min(
            waveforms.count_harmonics(view.frequency, rate, width, points) for width in widths
        )

    def _ripple(self) -> tuple[float, float]:
        mean = self._moving("the ripple")
        view, channel = self._view, self._view.channel(SLIDER_VELOCITY)
        rows = self._windows.selection(SLIDER_VELOCITY)
        reach = waveforms.corner_reach(channel.bandwidth, view.program.sample_rate, view.frequency)
        swing = waveforms.peak_to_peak(
            view.waveforms(SLIDER_VELOCITY), rows, self._harmonics(SLIDER_VELOCITY), reach,
            channel.low_pass,
        )  # fmt: skip
        ripple = swing.value / abs(mean)
        hidden = swing.bandwidth_loss / abs(mean)
        if hidden > _MUCH_HIDDEN * ripple:
            view.warn(f"the bandwidth of {SLIDER_VELOCITY} hides about {hidden:.2g} of the ripple")
        means = math.copysign(1.0, mean) * view.means(SLIDER_VELOCITY)[rows]
        parts = (
            standard_error(swing.per_period - ripple * means),
            swing.noise_bias,
            swing.bandwidth_doubt,
            ripple * channel.offset_uncertainty,
            ripple * self._drift,
        )
        return ripple, math.hypot(*parts) / abs(mean)

    def _durability(self) -> tuple[float, float]:
        self._view.require(SLIDER_VELOCITY, ROD_VELOCITY)
        mean, _ = self._velocity()
        rows = self._windows.selection(SLIDER_VELOCITY, ROD_VELOCITY)
        rod, slider = self._view.channel(ROD_VELOCITY), self._view.channel(SLIDER_VELOCITY)
        if slider.bandwidth != rod.bandwidth:
            self._view.warn(
                f"{ROD_VELOCITY} and {SLIDER_VELOCITY} have different bandwidths, which distorts "
                "the relative velocity"
            )
        sliding, v_r, v_s, rectified = self._sliding(rows)
        error = math.hypot(standard_error(sliding.per_period), sliding.noise_bias, rectified)
        if sliding.value <= SIGNIFICANT * error:
            raise NotAvailable(
                "rod and slider move together within the uncertainty: their mean relative speed "
                f"is {sliding.value:.2g} m/s (standard uncertainty {error:.2g} m/s)"
            )
        ratio = mean / sliding.value
        signs = sliding.signs[:: waveforms.FINER]
        scatter = self._view.means(SLIDER_VELOCITY)[rows] - ratio * sliding.per_period
        parts = (
            standard_error(scatter),
            self._drift,
            ratio * sliding.noise_bias,
            ratio * rectified,
            slider.offset_uncertainty * (1.0 + ratio * float(np.mean(signs))),
            slider.gain_uncertainty * (mean + ratio * float(np.mean(signs * v_s))),
            rod.gain_uncertainty * ratio * float(np.mean(signs * v_r)),
        )
        return abs(ratio), math.hypot(*parts) / sliding.value

    def _sliding(self, rows: Selection) -> tuple[waveforms.MeanMagnitude, Array, Array, float]:
        """
        Return mean relative speed, mean waveforms of rod and slider, and bias of the errors.

        The last is by how much gain and offset errors raise the mean relative speed (m/s) where
        the slider sticks. The rod is fixed to the stator: the mean of its velocity is the
        channel's offset, and taken off.
        """
        view = self._view
        rod_rows, slider_rows = view.waveforms(ROD_VELOCITY), view.waveforms(SLIDER_VELOCITY)
        offset = float(np.mean(view.means(ROD_VELOCITY)[rows]))
        harmonics = self._harmonics(SLIDER_VELOCITY, ROD_VELOCITY)
        sliding = waveforms.mean_magnitude(rod_rows, slider_rows, offset, rows, harmonics)
        v_r = waveforms.mean_waveform(rod_rows, rows) - offset
        v_s = waveforms.mean_waveform(slider_rows, rows)
        rod, slider = view.channel(ROD_VELOCITY), view.channel(SLIDER_VELOCITY)
        doubt = np.sqrt(
            (rod.gain_uncertainty * v_r) ** 2
            + (slider.gain_uncertainty * v_s) ** 2
            + slider.offset_uncertainty**2
        )
        return sliding, v_r, v_s, waveforms.rectified_error(v_r - v_s, doubt)

    # ------------------------------------------------------------------ power and force

    def _efficiency(self) -> tuple[float, float]:
        view = self._view
        view.require(SLIDER_VELOCITY, VOLTAGE, CURRENT)
        mean, _ = self._velocity()
        rows = self._windows.selection(SLIDER_VELOCITY)
        slider = view.channel(SLIDER_VELOCITY)
        scatter = view.means(SLIDER_VELOCITY)[rows]
        parts = [self._drift, slider.offset_uncertainty, slider.gain_uncertainty * mean]
        power = 1.0
        for name in (VOLTAGE, CURRENT):
            effective = self._effective_value(name, rows)
            power *= effective.value
            scatter = scatter - mean / effective.value * effective.per_period
            hidden = effective.hidden_share(self._bandwidth_ratio(name))
            parts += [
                view.channel(name).gain_uncertainty * mean,
                hidden * waveforms.ONE_SIDED * mean,
            ]
        return abs(mean) / power, math.hypot(standard_error(scatter), *parts) / power

    def _effective_value(self, name: str, rows: Selection) -> waveforms.Effective:
        effective = waveforms.effective_value(
            self._view.waveforms(name), rows, self._harmonics(name)
        )
        if effective.value <= SIGNIFICANT * standard_error(effective.per_period):
            raise NotAvailable(f"{name} shows no signal above its noise")
        return effective

    def _bandwidth_ratio(self, name: str) -> float:
        """Return the fundamental frequency over the bandwidth of a channel; 0 if unknown."""
        bandwidth = self._view.channel(name).bandwidth
        return self._view.frequency / bandwidth if bandwidth > 0.0 else 0.0

    def _force(self) -> tuple[float, float]:
        state, record = self._windows.load(), self._windows.load_record
        mean, error = record.mean(state.first, state.end)
        drift = record.drift(self._view.first, self._windows.free_end)
        return mean * self._windows.direction(state.first), math.hypot(error, state.drift, drift)

    # ------------------------------------------------------------------ warnings

    def _warn_of_limits(self) -> None:
        raised = 0
        for name in self._view.names:
            raised |= self._view.flags(name)
        for flag, text in _LIMITS.items():
            if raised & flag:
                self._view.warn(text)

    def _warn_of_bandwidths(self) -> None:
        view = self._view
        highest = max(len(view.program.motion_amplitudes), 1) * view.frequency
        for name in (ROD_VELOCITY, SLIDER_VELOCITY, VOLTAGE, CURRENT):
            bandwidth = view.channel(name).bandwidth if name in view.names else 0.0
            if 0.0 < bandwidth < 2.0 * highest:
                view.warn(
                    f"the highest harmonic of the drive, {highest:g} Hz, is beyond half the "
                    f"bandwidth of {name}, {bandwidth:g} Hz"
                )

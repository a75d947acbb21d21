"""
The indicators of one run, from what has been measured up to some sample.

Only measured signals are looked at. Time 0 is the start of the segment "ramp_up"; periods during
the ramp are left out of everything.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core import waveforms
from imotor_ros.core.alignment import BEFORE
from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    ChannelDescription,
    SampleFlag,
)
from imotor_ros.core.contact import (
    Baseline,
    Contact,
    ContactCriteria,
    find_baseline,
    find_contact,
)
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.evaluator_parameters import EvaluatorParameters
from imotor_ros.core.indicators import (
    DURABILITY,
    EFFICIENCY,
    FORCE,
    FREE_RUN,
    LOAD,
    MEAN_VELOCITY,
    RIPPLE,
    START_UP_TIME,
    UNITS,
    Indicator,
    Window,
)
from imotor_ros.core.measured_stream import MeasuredStream
from imotor_ros.core.periods import PeriodGrid
from imotor_ros.core.steady_state import (
    SIGNIFICANT,
    SteadyState,
    find_steady_state,
    noise_of,
    standard_error,
    start_up_time,
)

Array = NDArray[np.float64]
Selection = NDArray[np.int64]

# A high-pass may take away this share of a constant over the run, and no more.
_MOST_DECAY = 0.5
_MOST_VELOCITY_DECAY = 0.01

# How well a time constant of a charge amplifier is known (relative).
_DECAY_UNCERTAINTY = 0.2

# Force before the drive, over the uncertainty of the offset, from which on it is a load.
_PRELOAD = 5.0

# Share of the ripple that the bandwidth may hide before the reader is warned.
_MUCH_HIDDEN = 0.05

_LIMITS = {
    SampleFlag.VOLTAGE_CLIPPED: "the amplifier clipped the voltage",
    SampleFlag.SLEW_LIMITED: "the amplifier limited the slew rate of the voltage",
    SampleFlag.CURRENT_LIMITED: "the amplifier limited the current",
}


class RunAnalysis:
    """
    The indicators of a run as of some sample.

    Parameters
    ----------
    parameters : EvaluatorParameters
        How to evaluate.
    program : DriveProgram
        The run.
    grid : PeriodGrid
        Its drive periods.
    streams : mapping of str to MeasuredStream
        What was measured, by channel name.
    until : int
        Samples from this one on are not looked at.

    Attributes
    ----------
    warnings : list of str
        What came up while the indicators were computed.

    """

    def __init__(
        self,
        parameters: EvaluatorParameters,
        program: DriveProgram,
        grid: PeriodGrid,
        streams: Mapping[str, MeasuredStream],
        until: int,
    ) -> None:
        self.warnings: list[str] = []
        self._parameters = parameters
        self._program = program
        self._grid = grid
        self._streams = streams
        self._until = until
        usable = [one for name, one in streams.items() if one.folded and not self._missing(name)]
        self._rows = min((min(one.rows_until(until), grid.count) for one in usable), default=0)
        self._first = self._first_row()

    def _first_row(self) -> int:
        """Return the first whole period at full drive that every channel shows."""
        delays = [one.folded.delay for one in self._streams.values() if one.folded]
        earliest = BEFORE - min([0.0, *delays])
        return self._grid.row_at(max(self._program.span("hold")[0], earliest))

    def indicators(self) -> tuple[Indicator, ...]:
        """Return all indicators, in the order of `UNITS`."""
        self._warn_of_flags()
        self._warn_of_bandwidth()
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
            except _NotAvailable as reason:
                found.append(Indicator(name, unit, reason=str(reason)))
            else:
                found.append(Indicator(name, unit, float(value), float(uncertainty)))
        return tuple(found)

    def windows(self) -> tuple[Window, ...]:
        """Return the windows found."""
        found = []
        for name, finder in ((FREE_RUN, self._free_run), (LOAD, self._load)):
            try:
                state = finder()
            except _NotAvailable:
                continue
            start, end = (self._grid.first_sample(row) for row in (state.first, state.end))
            found.append(Window(name, start, end, state.end - state.first))
        return tuple(found)

    def mean_velocities(self) -> tuple[dict[str, Array], int, str]:
        """Return the mean waveforms of the free run, its periods, and why there are none."""
        try:
            rows = self.selection(SLIDER_VELOCITY)
        except _NotAvailable as reason:
            return {}, 0, str(reason)
        names = [n for n in (ROD_VELOCITY, SLIDER_VELOCITY) if not self._missing(n)]
        found = {name: waveforms.mean_waveform(self._waveforms(name), rows) for name in names}
        return found, rows.size, ""

    # ------------------------------------------------------------------ channels

    def _missing(self, name: str) -> str:
        """Return why a channel cannot be used; empty if it can."""
        stream = self._streams.get(name)
        return f"the run has no channel {name}" if stream is None else stream.reason(self._until)

    def _require(self, *names: str) -> None:
        for name in names:
            reason = self._missing(name)
            if reason:
                raise _NotAvailable(reason)

    def _channel(self, name: str) -> ChannelDescription:
        return self._streams[name].description

    def _means(self, name: str) -> Array:
        folded = self._streams[name].folded
        assert folded is not None
        return folded.means[: self._rows]

    def _waveforms(self, name: str) -> Array:
        folded = self._streams[name].folded
        assert folded is not None
        return folded.waveforms[: self._rows]

    def _harmonics(self, *names: str) -> int:
        """Return how many harmonics all of the channels show."""
        program, points = self._program, self._grid.points
        return min(
            waveforms.count_harmonics(
                program.fundamental_frequency, program.sample_rate,
                self._channel(name).bandwidth, points,
            )
            for name in names
        )  # fmt: skip

    def _times(self, first: int, end: int) -> Array:
        """Return the middles of periods, in seconds since the start of the drive."""
        return self._grid.middle(np.arange(first, end)) / self._program.sample_rate

    # ------------------------------------------------------------------ windows

    @cached_property
    def _baseline(self) -> Baseline:
        stream = self._streams[LOAD_FORCE]
        return find_baseline(stream.start(self._until), self._grid.period)

    @cached_property
    def _is_preloaded(self) -> bool:
        """Return whether the force before the drive is more than the channel's offset can be."""
        base, doubt = self._baseline, self._channel(LOAD_FORCE).offset_uncertainty
        limit = _PRELOAD * math.hypot(doubt, base.uncertainty)
        return doubt > 0.0 and abs(base.offset) > limit

    @cached_property
    def _load_means(self) -> Array:
        """
        Mean load force of each period, what was there before the drive taken off.

        Decay is made up for: a high-pass of time constant tau turns F into y, with
        F = y + integral of y dt / tau.
        """
        return self._without_decay(self._means(LOAD_FORCE) - self._baseline.offset)

    @cached_property
    def _preload(self) -> Array:
        """What has to be added to `_load_means` for the load force itself; no offset, but force."""
        if not self._is_preloaded:
            return np.zeros(self._rows)
        offset = self._baseline.offset
        before = self._decay_rate * self._grid.origin / self._program.sample_rate * offset
        return before + self._without_decay(np.full(self._rows, offset))

    @property
    def _decay_rate(self) -> float:
        return 2.0 * math.pi * self._channel(LOAD_FORCE).high_pass_frequency

    def _without_decay(self, force: Array) -> Array:
        share = self._decay_rate * self._grid.period / self._program.sample_rate
        return np.asarray(force + share * (np.cumsum(force) - 0.5 * force))

    def _usable_force(self) -> str:
        """Return why contact cannot be judged by force; empty if it can."""
        reason = self._missing(LOAD_FORCE) or self._baseline.reason
        channel = self._streams[LOAD_FORCE].description if not reason else None
        if channel is None:
            return reason
        decay = 2.0 * math.pi * channel.high_pass_frequency * self._until
        if decay / self._program.sample_rate > _MOST_DECAY:
            return (
                f"a constant force decays during the run: {LOAD_FORCE} has a lower cut-off "
                f"frequency of {channel.high_pass_frequency:.3g} Hz"
            )
        return ""

    @cached_property
    def _contact(self) -> Contact:
        has_velocity = not self._missing(SLIDER_VELOCITY)
        reason = self._usable_force()
        if reason and LOAD_FORCE in self._streams and has_velocity:
            self.warnings.append(f"contact is judged by the slider velocity alone: {reason}")
        threshold = math.nan
        if not reason:
            channel, parameters = self._channel(LOAD_FORCE), self._parameters
            largest = float(np.max(np.abs(self._load_means), initial=0.0))
            floor = channel.range if 0.0 < channel.range < math.inf else largest
            threshold = max(
                parameters.contact_noise_factor * self._baseline.noise,
                parameters.contact_share * floor,
                3.0 * channel.resolution,
            )
        criteria = ContactCriteria(threshold, self._parameters.contact_persistence, self._first)
        contact = find_contact(
            self._means(SLIDER_VELOCITY) if has_velocity else None,
            None if reason else self._load_means,
            criteria,
        )
        if contact.warning:
            self.warnings.append(contact.warning)
        return contact

    def _contact_row(self) -> int:
        """Return the first period that may be hindered, or the number of periods."""
        row = self._contact.row
        return self._rows if row is None else row

    @cached_property
    def _free_end(self) -> int:
        row = self._contact.row
        if row is None:
            return self._rows
        guard = self._parameters.guard_periods
        if not self._missing(LOAD_FORCE):
            # a slow force channel tells of the contact late
            bandwidth = self._channel(LOAD_FORCE).bandwidth
            if bandwidth > 0.0:
                guard += math.ceil(0.5 * self._program.fundamental_frequency / bandwidth)
        return max(row - guard, 0)

    def _free_run(self) -> SteadyState:
        """Return the steady free run, rows counted from period 0."""
        self._require(SLIDER_VELOCITY)
        state = self._free_state
        if state.reason:
            raise _NotAvailable(state.reason)
        return state

    @cached_property
    def _free_state(self) -> SteadyState:
        end = max(self._free_end, self._first)
        state = find_steady_state(
            self._times(self._first, end),
            self._means(SLIDER_VELOCITY)[self._first : end],
            minimum=self._parameters.minimum_periods,
            level=self._parameters.settling_level,
            bound=self._parameters.velocity_drift_bound,
            scatter=self._parameters.scatter_bound,
            what="the velocity",
        )
        reason = state.reason
        if reason and self._contact.row is not None:
            time = self._contact.row / self._program.fundamental_frequency
            reason += f"; contact {time * 1e3:.4g} ms after the start of the drive"
        return SteadyState(
            state.first + self._first, state.end + self._first, state.drift, reason,
            state.settling,
        )  # fmt: skip

    def _load(self) -> SteadyState:
        """Return the steady part of the load, rows counted from period 0."""
        self._require(LOAD_FORCE)
        reason = self._usable_force()
        if reason:
            raise _NotAvailable(reason)
        if not self._contact.is_seen_by_force:
            raise _NotAvailable("no contact with a stop or spring was seen")
        state = self._load_state
        if state.reason:
            raise _NotAvailable(state.reason)
        return state

    @cached_property
    def _load_state(self) -> SteadyState:
        begin = max(self._contact_row(), self._first)
        state = find_steady_state(
            self._times(begin, self._rows),
            self._load_means[begin:],
            minimum=self._parameters.minimum_periods,
            level=self._parameters.settling_level,
            bound=self._parameters.force_drift_bound,
            scatter=self._parameters.scatter_bound,
            what="the load force",
        )
        return SteadyState(
            state.first + begin, state.end + begin, state.drift, state.reason, state.settling
        )

    def selection(self, *names: str) -> Selection:
        """
        Return the periods of the free run that are good in all of the channels.

        Raises
        ------
        _NotAvailable
            If there is no free run, or too little is left of it.

        """
        state = self._free_run()
        every = np.arange(state.first, state.end)
        rows = every
        for name in names:
            if self._streams[name].flags(self._until) & SampleFlag.DROP_OUT:
                rows = np.intersect1d(rows, self._undisturbed(name), assume_unique=True)
        if rows.size < self._parameters.minimum_periods:
            raise _NotAvailable(
                f"drop-outs of {' or '.join(names)} spoil all but {rows.size} of {every.size} "
                f"periods of the free run"
            )
        return rows

    def _undisturbed(self, name: str) -> Selection:
        state = self._free_run()
        every = np.arange(state.first, state.end)
        rows = waveforms.without_spoiled(self._waveforms(name), every)
        text = (
            f"{name} had drop-outs: {every.size - rows.size} of {every.size} periods of the free "
            "run are left out"
        )
        if text not in self.warnings:
            self.warnings.append(text)
        return rows

    # ------------------------------------------------------------------ indicators

    def _mean_velocity(self) -> tuple[float, float]:
        mean, error = self._velocity()
        return mean, math.hypot(error, self._channel(SLIDER_VELOCITY).gain_uncertainty * mean)

    def _velocity(self) -> tuple[float, float]:
        """Return the mean velocity and its uncertainty, that of the gain left out."""
        self._require(SLIDER_VELOCITY)
        channel = self._channel(SLIDER_VELOCITY)
        decay = 2.0 * math.pi * channel.high_pass_frequency * self._rows * self._grid.period
        decay /= self._program.sample_rate
        if decay > _MOST_VELOCITY_DECAY:
            raise _NotAvailable(
                f"{SLIDER_VELOCITY} is AC-coupled (lower cut-off frequency "
                f"{channel.high_pass_frequency:.3g} Hz): it does not show a mean velocity"
            )
        values = self._means(SLIDER_VELOCITY)[self.selection(SLIDER_VELOCITY)]
        mean = float(np.mean(values))
        parts = (
            standard_error(values),
            self._free_run().drift,
            channel.offset_uncertainty,
            decay * mean,
        )
        return mean, math.hypot(*parts)

    def _moving(self, what: str) -> tuple[float, float]:
        """Return `_velocity`, or refuse where the slider does not move for certain."""
        mean, error = self._velocity()
        if abs(mean) <= SIGNIFICANT * error:
            raise _NotAvailable(
                f"{what} has no meaning: the mean velocity, {mean:.2g} m/s, is not different from "
                f"zero (standard uncertainty {error:.2g} m/s)"
            )
        return mean, error

    def _start_up_time(self) -> tuple[float, float]:
        self._moving("the start-up time")
        settling = self._free_state.settling
        assert settling is not None
        first = float(self._times(self._first, self._first + 1)[0])
        offset = self._channel(SLIDER_VELOCITY).offset_uncertainty
        time, uncertainty, reason = start_up_time(settling, first, offset)
        if reason:
            raise _NotAvailable(reason)
        return time, uncertainty

    def _ripple(self) -> tuple[float, float]:
        mean, _ = self._moving("the ripple")
        channel = self._channel(SLIDER_VELOCITY)
        rows = self.selection(SLIDER_VELOCITY)
        swing = waveforms.peak_to_peak(
            self._waveforms(SLIDER_VELOCITY), rows, self._harmonics(SLIDER_VELOCITY),
            waveforms.corner_reach(
                channel.bandwidth, self._program.sample_rate, self._program.fundamental_frequency
            ),
        )  # fmt: skip
        ripple = swing.value / abs(mean)
        means = self._means(SLIDER_VELOCITY)[rows]
        hidden = swing.bandwidth_loss / abs(mean)
        if hidden > _MUCH_HIDDEN * ripple:
            self.warnings.append(
                f"the bandwidth of {SLIDER_VELOCITY} may hide up to {hidden:.2g} of the ripple"
            )
        parts = (
            standard_error((swing.per_period - ripple * np.sign(mean) * means) / abs(mean)),
            swing.noise_bias / abs(mean),
            hidden / math.sqrt(3.0),
            ripple * math.hypot(channel.offset_uncertainty, self._free_run().drift) / abs(mean),
        )
        return ripple, math.hypot(*parts)

    def _durability(self) -> tuple[float, float]:
        self._require(SLIDER_VELOCITY, ROD_VELOCITY)
        mean, _ = self._velocity()
        slider, rod = self._channel(SLIDER_VELOCITY), self._channel(ROD_VELOCITY)
        if slider.bandwidth != rod.bandwidth:
            self.warnings.append(
                f"{ROD_VELOCITY} and {SLIDER_VELOCITY} have different bandwidths, which distorts "
                "the relative velocity"
            )
        rows = self.selection(SLIDER_VELOCITY, ROD_VELOCITY)
        rod_rows, slider_rows = self._waveforms(ROD_VELOCITY), self._waveforms(SLIDER_VELOCITY)
        # The rod is fixed to the stator: the mean of its velocity is the channel's offset.
        offset = float(np.mean(self._means(ROD_VELOCITY)[rows]))
        harmonics = self._harmonics(SLIDER_VELOCITY, ROD_VELOCITY)
        sliding = waveforms.mean_magnitude(rod_rows, slider_rows, offset, rows, harmonics)
        v_r = waveforms.mean_waveform(rod_rows, rows) - offset
        v_s = waveforms.mean_waveform(slider_rows, rows)
        doubt = np.sqrt(
            (rod.gain_uncertainty * v_r) ** 2
            + (slider.gain_uncertainty * v_s) ** 2
            + slider.offset_uncertainty**2
        )
        rectified = waveforms.rectified_error(v_r - v_s, doubt)
        error = math.hypot(standard_error(sliding.per_period), sliding.noise_bias, rectified)
        if sliding.value <= SIGNIFICANT * error:
            raise _NotAvailable(
                f"rod and slider move together within the uncertainty: their mean relative speed "
                f"is {sliding.value:.2g} m/s (standard uncertainty {error:.2g} m/s)"
            )
        ratio = mean / sliding.value
        signs = sliding.signs.reshape(-1, waveforms.FINER)[:, 0]
        per_period = self._means(SLIDER_VELOCITY)[rows] - ratio * sliding.per_period
        parts = (
            standard_error(per_period),
            self._free_run().drift,
            ratio * sliding.noise_bias,
            ratio * rectified,
            slider.offset_uncertainty * (1.0 + ratio * float(np.mean(signs))),
            slider.gain_uncertainty * (mean + ratio * float(np.mean(signs * v_s))),
            rod.gain_uncertainty * ratio * float(np.mean(signs * v_r)),
        )
        return abs(ratio), math.hypot(*parts) / sliding.value

    def _efficiency(self) -> tuple[float, float]:
        self._require(SLIDER_VELOCITY, VOLTAGE, CURRENT)
        mean, _ = self._velocity()
        rows = self.selection(SLIDER_VELOCITY)
        scatter = self._means(SLIDER_VELOCITY)[rows]
        slider = self._channel(SLIDER_VELOCITY)
        gains = [slider.gain_uncertainty * mean]
        power = 1.0
        for name in (VOLTAGE, CURRENT):
            effective = waveforms.effective_value(
                self._waveforms(name), rows, self._harmonics(name)
            )
            if effective.value <= SIGNIFICANT * standard_error(effective.per_period):
                raise _NotAvailable(f"{name} shows no signal above its noise")
            power *= effective.value
            scatter = scatter - mean / effective.value * effective.per_period
            gains.append(self._channel(name).gain_uncertainty * mean)
            hidden = effective.hidden_share(self._bandwidth_ratio(name))
            gains.append(hidden / math.sqrt(3.0) * mean)
        parts = (
            standard_error(scatter),
            self._free_run().drift,
            slider.offset_uncertainty,
            *gains,
        )
        return abs(mean) / power, math.hypot(*parts) / power

    def _bandwidth_ratio(self, name: str) -> float:
        """Return the fundamental frequency over the bandwidth of a channel; 0 if unknown."""
        bandwidth = self._channel(name).bandwidth
        return self._program.fundamental_frequency / bandwidth if bandwidth > 0.0 else 0.0

    def _force(self) -> tuple[float, float]:
        state = self._load()
        channel = self._channel(LOAD_FORCE)
        rows = slice(state.first, state.end)
        values = self._load_means[rows] + self._preload[rows]
        mean = float(np.mean(values))
        shown = float(np.mean(self._means(LOAD_FORCE)[rows]))
        if self._is_preloaded:
            self.warnings.append(
                f"{LOAD_FORCE} shows {self._baseline.offset:.3g} N before the drive starts, too "
                "much for an offset: taken as load"
            )
        else:
            shown -= self._baseline.offset
        parts = (
            standard_error(values),
            state.drift,
            self._baseline.uncertainty,
            self._baseline_drift(),
            channel.offset_uncertainty,
            channel.gain_uncertainty * mean,
            _DECAY_UNCERTAINTY * (mean - shown),
        )
        return mean * self._direction(state.first), math.hypot(*parts)

    def _baseline_drift(self) -> float:
        """Return how far the force has drifted away before contact, if that is significant."""
        before = self._load_means[self._first : max(self._free_end, self._first)]
        if before.size < self._parameters.minimum_periods:
            return 0.0
        drift = float(np.mean(before))
        error = math.hypot(standard_error(before), self._baseline.uncertainty)
        if abs(drift) <= SIGNIFICANT * error:
            return 0.0
        return abs(drift)

    def _direction(self, end: int) -> float:
        """Return +1 or -1: the direction in which the slider has moved until period `end`."""
        if not self._missing(SLIDER_VELOCITY):
            velocity = self._means(SLIDER_VELOCITY)[:end]
            noise = noise_of(velocity) * math.sqrt(velocity.size)
            moved = float(np.sum(velocity))
            if abs(moved) > 2.0 * SIGNIFICANT * noise:
                return math.copysign(1.0, moved)
        self.warnings.append(
            "the direction of motion is unknown: a force against forward motion counts as positive"
        )
        return 1.0

    # ------------------------------------------------------------------ warnings

    def _warn_of_flags(self) -> None:
        raised = 0
        for stream in self._streams.values():
            raised |= stream.flags(self._until)
        self.warnings += [text for flag, text in _LIMITS.items() if raised & flag]

    def _warn_of_bandwidth(self) -> None:
        program = self._program
        highest = max(len(program.motion_amplitudes), 1) * program.fundamental_frequency
        for name in (ROD_VELOCITY, SLIDER_VELOCITY, VOLTAGE, CURRENT):
            if name not in self._streams:
                continue
            bandwidth = self._channel(name).bandwidth
            if 0.0 < bandwidth < 2.0 * highest:
                self.warnings.append(
                    f"the highest harmonic of the drive, {highest:g} Hz, is beyond half the "
                    f"bandwidth of {name}, {bandwidth:g} Hz"
                )


class _NotAvailable(Exception):
    """Why an indicator cannot be given."""

"""
Whether the channels of a run can be what they say: checks by physics, before any indicator.

A sample that is wrong by a factor, late, or of another quantity looks like any other. But the
program says which voltage was played and how the rod was to move; a rod that is fixed to its
stator does not travel; a stack takes the current of a capacitor; and friction drags the slider
the way the rod slides under it, so that its acceleration changes sign where rod and slider are
equally fast. What contradicts this is refused, with the numbers. What no physics here can tell:
a delay that all channels share, a slider, current or force wrong by a factor of less than two or
so, and a rod wrong by a factor for which its voltage has been corrected.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core import waveforms
from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    MEASURED_CHANNELS,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    SampleFlag,
)
from imotor_ros.core.drive import DriveSegment
from imotor_ros.core.run_view import NotAvailable, RunView
from imotor_ros.core.run_windows import RunWindows

Array = NDArray[np.float64]
Phasors = NDArray[np.complex128]

FEWEST_PERIODS = 4
"""Periods at full drive without which nothing is checked."""

_WEAK = 0.1
"""Harmonics below this share of the largest say nothing of phase."""

_LAG_STEP = 0.5e-6
_WIDEST_LAG = 60e-6
"""Steps and reach (s) of the search for the lag between rod and slider."""

_FLAT = 0.005
"""By how much the agreement may be below its best where a lag counts as possible."""

_SLIDING = 0.04
"""Relative speed, over the rod's amplitude, that counts in full as sliding."""

_FEWEST_SLIDING = 0.3
"""Mean weight of the sliding below which rod and slider move together: nothing can be said."""

_SMALL_CHANGE = 1e-3
"""Change of a waveform, relative, that noise may make: nothing follows from its phase."""

_PERFECT = 0.998
"""Agreement below which the reader is warned: half the slider's velocity can make 0.996."""

_LIMITED = SampleFlag.VOLTAGE_CLIPPED | SampleFlag.SLEW_LIMITED | SampleFlag.CURRENT_LIMITED


def find_doubts(view: RunView) -> dict[str, str]:
    """
    Return why channels cannot be what they say, by channel; one that concerns all is in each.

    Parameters
    ----------
    view : RunView
        The run; what is unusable anyway is left out.

    """
    settings = view.parameters.plausibility
    if not settings.is_checked or view.rows - view.first < FEWEST_PERIODS:
        return {}
    checks = _Checks(view)
    for find in (checks.voltage, checks.rod, checks.slider):
        for reason in find():
            return dict.fromkeys(MEASURED_CHANNELS, reason)
    reason = next(checks.current(), "")
    # a cable that is in the wrong place has taken the place of another one
    return dict.fromkeys((CURRENT, LOAD_FORCE), reason) if reason else {}


@dataclass(frozen=True)
class Agreement:
    """
    How well friction explains the slider's acceleration.

    Attributes
    ----------
    value : float
        From -1 (against the sliding throughout) to 1 (with it throughout), at the best lag.
    earliest, latest : float
        Lags (s) of the rod behind the slider that explain it as well.

    """

    value: float
    earliest: float
    latest: float

    @property
    def distance(self) -> float:
        """How far (s) the nearest of these lags is from none."""
        return max(self.earliest, -self.latest, 0.0)


class _Checks:
    def __init__(self, view: RunView) -> None:
        self._view = view
        self._bounds = view.parameters.plausibility
        self._rows = np.arange(view.first, view.rows)
        program = view.program
        self._hold = next(one for one in program.segments if one.label == "hold")
        self._harmonic = 2.0 * math.pi * view.frequency

    def _phasors(self, name: str, count: int, rows: NDArray[np.int64] | None = None) -> Phasors:
        """Return the sine phasors of harmonics 1 to `count` of a channel's mean waveform."""
        view, grid = self._view, self._view.grid
        chosen = self._rows if rows is None else rows
        mean = waveforms.mean_waveform(view.waveforms(name), chosen)
        orders = np.arange(1, count + 1)
        turns = np.exp(-2j * np.pi * np.outer(orders, grid.phases))
        return np.asarray(2j * (turns @ mean) / grid.points)

    def _omega(self, count: int) -> Array:
        return np.asarray(self._harmonic * np.arange(1, count + 1), dtype=np.float64)

    # ---- voltage ---------------------------------------------------------------------------

    def voltage(self) -> Iterator[str]:
        """Compare the voltage monitor with the drive program."""
        view, bounds = self._view, self._bounds
        if view.missing(VOLTAGE) or any(view.flags(name) & _LIMITED for name in view.names):
            return
        asked = _phasors_of(self._hold)
        shown = self._phasors(VOLTAGE, len(asked))
        size = float(np.linalg.norm(asked))
        if size == 0.0:
            return
        lag = _lag(asked, shown, self._omega(len(asked)))
        error = float(np.linalg.norm(shown * np.exp(1j * self._omega(len(asked)) * lag) - asked))
        gain = float(np.linalg.norm(shown)) / size
        said = f"{VOLTAGE} does not show the voltage of the drive program"
        if error > bounds.voltage_error * size:
            yield f"{said}: {gain:.3g} times its amplitude, another shape or another channel"
            return
        if not -bounds.least_lead < lag < bounds.largest_output_lag:
            yield (
                f"{said} in time: {lag * 1e6:.3g} us late (expected "
                f"{-bounds.least_lead * 1e6:g} to {bounds.largest_output_lag * 1e6:g} us): "
                "undeclared delay, or another clock"
            )
            return
        offset = float(np.mean(view.means(VOLTAGE)[self._rows]))
        largest = size + abs(self._hold.start_offset)
        if abs(offset - self._hold.start_offset) > bounds.voltage_error * largest:
            yield f"{said}: offset {offset:.4g} V instead of {self._hold.start_offset:.4g} V"
            return
        yield from self._slip(VOLTAGE, bounds.clock_slip)

    def _slip(self, name: str, bound: float) -> Iterator[str]:
        """Compare the phase of a channel at the start and the end of the steady drive."""
        part = self._rows.size // 8
        if part < 2:
            return
        count = max(len(self._hold.start_amplitudes), 1)
        begin = self._phasors(name, count, self._rows[:part])
        end = self._phasors(name, count, self._rows[-part:])
        slip = _lag(begin, end, self._omega(count)) * self._view.program.sample_rate
        change = float(np.linalg.norm(end - begin)) / max(float(np.linalg.norm(begin)), 1e-300)
        if abs(slip) > bound and change > _SMALL_CHANGE:
            yield (
                f"{name} slips against the drive by {slip:.3g} samples during the steady drive "
                f"(allowed {bound:g}): another clock, or samples that are missing without notice"
            )

    # ---- rod -------------------------------------------------------------------------------

    def rod(self) -> Iterator[str]:
        """Compare the rod's motion with that which the program is to cause."""
        view, bounds = self._view, self._bounds
        if view.missing(ROD_VELOCITY):
            return
        channel = view.channel(ROD_VELOCITY)
        mean = float(np.mean(view.means(ROD_VELOCITY)[self._rows]))
        wave = waveforms.mean_waveform(view.waveforms(ROD_VELOCITY), self._rows)
        largest = float(np.max(np.abs(wave - np.mean(wave))))
        allowed = bounds.rod_mean * largest + 6.0 * channel.offset_uncertainty
        if abs(mean) > allowed:
            yield (
                f"{ROD_VELOCITY} has a mean of {mean:.3g} m/s (allowed {allowed:.2g} m/s), but the "
                "rod is fixed to the stator: another channel, or an undeclared offset"
            )
            return
        program = view.program
        wanted = _phasors_from(program.motion_amplitudes, program.motion_phases)
        if not np.any(wanted):
            return
        omega = self._omega(len(wanted))
        velocity = 1j * omega * wanted
        found = self._phasors(ROD_VELOCITY, len(wanted))
        error = float(np.linalg.norm(found - velocity) / np.linalg.norm(velocity))
        if error > bounds.rod_motion_error:
            gain = float(np.linalg.norm(found) / np.linalg.norm(velocity))
            lag = _lag(velocity, found, omega)
            shifted = found * np.exp(1j * omega * lag)
            is_late = np.linalg.norm(shifted - velocity) < 0.5 * np.linalg.norm(found - velocity)
            cause = f"it is {lag * 1e6:.3g} us late: undeclared delay" if is_late else (
                f"{gain:.3g} times its amplitude"
            )  # fmt: skip
            yield (
                f"{ROD_VELOCITY} does not show the motion that the drive program is to cause, "
                f"{100 * error:.3g} % off (allowed {100 * bounds.rod_motion_error:g} %): {cause}"
            )
            return
        yield from self._slip(ROD_VELOCITY, 4.0 * bounds.clock_slip)

    # ---- slider ----------------------------------------------------------------------------

    def slider(self) -> Iterator[str]:
        """Compare the slider's motion with the friction of the rod under it."""
        view, bounds = self._view, self._bounds
        if view.missing(SLIDER_VELOCITY) or view.missing(ROD_VELOCITY):
            return
        try:
            rows = RunWindows(view).selection(SLIDER_VELOCITY, ROD_VELOCITY)
        except NotAvailable:
            return
        rod = waveforms.mean_waveform(view.waveforms(ROD_VELOCITY), rows)
        slider = waveforms.mean_waveform(view.waveforms(SLIDER_VELOCITY), rows)
        rod -= np.mean(rod)
        spare = 6.0 * view.channel(SLIDER_VELOCITY).offset_uncertainty
        for extreme in (np.max, np.min):
            fast, limit = float(extreme(slider)), float(extreme(rod))
            if abs(fast) > bounds.slider_speed * abs(limit) + spare and fast * limit > 0.0:
                yield (
                    f"{SLIDER_VELOCITY} reaches {fast:.3g} m/s and {ROD_VELOCITY} {limit:.3g} m/s: "
                    "a slider that friction drags is not faster than the rod"
                )
                return
        yield from self._friction(rod, slider)

    def _friction(self, rod: Array, slider: Array) -> Iterator[str]:
        view, bounds = self._view, self._bounds
        channels = view.channel(ROD_VELOCITY), view.channel(SLIDER_VELOCITY)
        amplitude = 0.5 * float(np.ptp(rod))
        gains = math.hypot(*(one.gain_uncertainty for one in channels))
        offsets = math.hypot(*(one.offset_uncertainty for one in channels))
        scale = max(_SLIDING * amplitude, 3.0 * (gains * amplitude + offsets))
        widths = [one.bandwidth for one in channels if one.bandwidth > 0.0]
        rate = view.program.sample_rate
        harmonics = min(
            waveforms.count_harmonics(view.frequency, rate, one.bandwidth, rod.size)
            for one in channels
        )
        found = agreement(rod, slider, view.period, scale, harmonics)
        if found is None:
            return
        tolerance = max(bounds.lag_tolerance, 2.0 / rate, *(0.3 / one for one in widths), 0.0)
        if found.value < bounds.friction_agreement:
            yield (
                f"{SLIDER_VELOCITY} and {ROD_VELOCITY} contradict each other: friction explains "
                f"the slider's acceleration to {found.value:.2f} only (expected "
                f"{bounds.friction_agreement:g} to 1): wrong factor, sign or channel"
            )
        elif found.distance > tolerance:
            nearest = found.earliest if found.earliest > 0.0 else found.latest
            yield (
                f"{ROD_VELOCITY} is {abs(nearest) * 1e6:.3g} us or more "
                f"{'late' if nearest > 0.0 else 'early'} against {SLIDER_VELOCITY} (allowed "
                f"{tolerance * 1e6:.2g} us beside the declared delays): undeclared delay"
            )
        elif found.value < _PERFECT:
            view.warn(
                f"friction explains the acceleration of {SLIDER_VELOCITY} to {found.value:.4f} "
                f"only: a factor of it or of {ROD_VELOCITY} may be wrong"
            )

    # ---- current ---------------------------------------------------------------------------

    def current(self) -> Iterator[str]:
        """Compare the current with that of a capacitor."""
        view, bounds = self._view, self._bounds
        if view.missing(CURRENT) or view.missing(VOLTAGE):
            return
        count = max(len(self._hold.start_amplitudes), 1)
        voltage, current = self._phasors(VOLTAGE, count), self._phasors(CURRENT, count)
        charging = 1j * self._omega(count) * voltage
        power = float(np.linalg.norm(charging) ** 2)
        if power == 0.0:
            return
        capacitance = complex(np.sum(current * np.conj(charging))) / power
        rest = float(np.linalg.norm(current - capacitance * charging))
        size = max(float(np.linalg.norm(current)), 1e-300)
        angle = math.degrees(math.atan2(capacitance.imag, capacitance.real))
        low, high = bounds.least_capacitance, bounds.largest_capacitance
        if rest > bounds.current_error * size or abs(angle) > bounds.largest_loss_angle:
            yield (
                f"{CURRENT} is not the current of a piezoelectric stack: "
                f"{100 * rest / size:.3g} % of it do not follow the slope of the voltage, the "
                f"rest by {angle:.3g} degrees off: another channel, or an undeclared delay"
            )
        elif not low < abs(capacitance) < high:
            yield (
                f"{CURRENT} over the slope of {VOLTAGE} makes {abs(capacitance):.3g} F "
                f"(expected {low:g} to {high:g} F): wrong unit"
            )


def _phasors_of(segment: DriveSegment) -> Phasors:
    return _phasors_from(segment.start_amplitudes, segment.phases)


def _phasors_from(amplitudes: tuple[float, ...], phases: tuple[float, ...]) -> Phasors:
    return np.asarray(np.array(amplitudes) * np.exp(1j * np.array(phases)), dtype=np.complex128)


def _lag(before: Phasors, after: Phasors, omega: Array) -> float:
    """Return by how much (s) `after` lags `before`, by the harmonics that are strong in both."""
    weights = np.abs(before) * np.abs(after)
    if not np.any(weights):
        return 0.0
    # the strongest decides which turn it is; up to half its period on either side
    first = int(np.argmax(weights))
    ratio = after * np.conj(before)
    guess = -float(np.angle(ratio[first])) / float(omega[first])
    left = ratio * np.exp(1j * omega * guess)
    strong = weights > _WEAK * weights[first]
    slopes = (weights * omega**2)[strong]
    return guess - float(np.sum((weights * omega)[strong] * np.angle(left[strong])) / slopes.sum())


def agreement(
    rod: Array, slider: Array, period: float, scale: float, harmonics: int
) -> Agreement | None:
    """
    Return how well friction explains the slider's acceleration, over the lag of the rod.

    Friction accelerates the slider towards the rod's velocity. So the acceleration has the sign of
    the relative velocity wherever the slider slides: times it, it is positive throughout. At a
    wrong lag it is not, near the changes of sign.

    Parameters
    ----------
    rod, slider : ndarray, shape (points,)
        Mean waveforms (m/s) over one period; the rod's without its mean.
    period : float
        Drive period (s).
    scale : float
        Relative speed (m/s) above which the slider slides for certain.
    harmonics : int
        Harmonics that both channels show.

    Returns
    -------
    Agreement or None
        None where rod and slider move together, within `scale`.

    """
    fine = waveforms.refine(rod, harmonics)
    finer = waveforms.refine(slider, harmonics)
    acceleration = np.roll(finer, -1) - np.roll(finer, 1)
    size = fine.size
    step = max(1, round(_LAG_STEP / period * size))
    reach = round(min(_WIDEST_LAG / period, 0.25) * size)
    places = np.arange(-(reach // step), reach // step + 1) * step
    thin = slice(None, None, waveforms.FINER // 2)
    values = np.empty(places.size)
    for i, place in enumerate(places):
        relative = np.roll(fine, -place)[thin] - finer[thin]
        sliding = np.sign(relative) * np.clip(np.abs(relative) / scale - 1.0, 0.0, 1.0)
        worked = acceleration[thin] * sliding
        total = float(np.sum(np.abs(worked)))
        values[i] = float(np.sum(worked)) / total if total > 0.0 else 0.0
        if place == 0 and float(np.mean(np.abs(sliding))) < _FEWEST_SLIDING:
            return None
    best = float(np.max(values))
    good = places[values >= best - _FLAT] * (period / size)
    return Agreement(best, float(good[0]), float(good[-1]))

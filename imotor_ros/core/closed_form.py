"""
Closed-form solution for loads that do not depend on position: exact, and fast.

While the slider slides with sign s, its relative velocity w = v_R - v_S obeys, over the drive
phase theta,

    w' + Lambda w = alpha(theta) - G_s,     alpha = a_R / omega,  Lambda = c / (m omega),
                                            G_s = (s F_0 + F_x) / (m omega),

with the answer w = h(theta) + (w_0 - h_0) E - G_s phi_1, where h is the periodic response to the
rod alone, E = exp(-Lambda D) and phi_1 = (1 - E) / Lambda over the phase D gone. exp(Lambda D) w
is monotone between the phases where alpha = G_s, which are the same in every period. So between
two of them w has one zero or none, and which of the two is seen from its value at the second: no
event is searched for, and none can be missed. Where sticking can begin and where it ends are fixed
phases as well. What is left per period is a few multiplications, and one root per event.

Equations (1) to (5) of the paper with friction models 1 and 2, and any constant force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.phases import level_phases, monotone_nodes, trigonometric_value
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.solution import PeriodTable, SliderMotion
from imotor_ros.errors import BadInputError, SolverError

Array = NDArray[np.float64]
_TURN = 2.0 * math.pi


def applies(friction: FrictionLaw, load: LoadParameters | None = None) -> bool:
    """Return whether the closed form solves this law and load."""
    is_straight = friction.numbers.excess == 0.0
    return is_straight and (load is None or not load.numbers.depends_on_position)


def simulate(
    motion: HarmonicMotion,
    slider: SliderParameters,
    friction: FrictionLaw,
    *,
    load: LoadParameters | None = None,
    periods: int,
    initial_velocity: float = 0.0,
    record: bool = False,
) -> PeriodTable:
    """
    Solve the slider's motion over whole drive periods.

    Parameters
    ----------
    motion : HarmonicMotion
        Rod displacement.
    slider : SliderParameters
        Mass, inclination, constant outer forces.
    friction : FrictionLaw
        A law whose sliding force is a straight line over the relative speed.
    load : LoadParameters, optional
        A constant force at most; none by default.
    periods : int
        Number of drive periods.
    initial_velocity : float
        Slider velocity (m/s) at time 0; its position there is 0.
    record : bool
        Whether to keep the events, so that the motion can be sampled.

    Returns
    -------
    PeriodTable
        One row per period.

    Raises
    ------
    BadInputError
        If the law or the load is not of the kind above, or a number is out of bounds.

    Notes
    -----
    Where a constant force exceeds the Coulomb force the slider runs away, and the solution
    follows it: there is no steady state then.

    """
    _check(friction, load, periods, initial_velocity)
    case = _Case.make(motion, slider, friction, load)
    rows = np.empty((5, periods))
    capacity = 6 * periods if record else 0
    while True:
        segments = np.empty((capacity, 4))
        count, final = _solve(
            case.decay, case.limits, case.spectrum, case.knots, case.knot_counts, case.is_away,
            case.add, case.keep, case.at_knots, case.first_region, case.regions, case.region_sides,
            case.exit_gaps, case.exit_values, case.rests, case.rest_velocities,
            case.starts_at_rest(initial_velocity), initial_velocity, rows, segments,
        )  # fmt: skip
        if count < 0:
            raise SolverError("the closed form found no end of a period's events")
        if not record or count <= capacity:
            break
        capacity = count
    omega = case.omega
    positive, negative, low, high, stick = rows
    mean = -(positive + negative) / _TURN
    path = _Segments(case, segments[:count], 0.0, periods) if record else None
    force = load.constant_force if load else 0.0
    return PeriodTable(
        period=motion.period,
        mean_velocity=mean,
        min_velocity=low,
        max_velocity=high,
        mean_relative_speed=(positive - negative) / _TURN,
        stick_share=stick / _TURN,
        mean_load_force=np.full(periods, force),
        final_position=float(np.sum(mean)) * _TURN / omega,
        final_velocity=float(final),
        trajectory=path,
    )


def _check(
    friction: FrictionLaw, load: LoadParameters | None, periods: int, initial_velocity: float
) -> None:
    if not applies(friction, load):
        raise BadInputError(
            "has no closed form",
            where="friction, load",
            value=(type(friction).__name__, load),
            bound="a straight friction law and no spring or end stops",
        )
    if not isinstance(periods, int) or periods < 1:
        raise BadInputError("is out of bounds", where="periods", value=periods, bound=">= 1")
    if not math.isfinite(initial_velocity):
        raise BadInputError("is not finite", where="initial_velocity", value=initial_velocity)


@dataclass(frozen=True)
class _Case:
    """
    Everything about a signal, law and load that is the same in every period.

    Attributes
    ----------
    omega, decay : float
        Fundamental angular frequency (rad/s); Lambda.
    limits : ndarray, shape (4,)
        G_+, G_-; acceleration 1/omega of friction alone, F_0/(m omega); 1 if a constant force
        exceeds the sliding force at rest, so that the slider velocity turns while it slides.
    spectrum : ndarray, shape (4, n)
        Real and imaginary parts of rod velocity V_k and response h_k.
    knots, is_away : ndarray, shape (2, most)
        For s = +1 and -1: phases 0, those where alpha = G_s, and 2 pi; whether w moves away from
        zero between one and the next.
    add, keep : ndarray, shape (2, most)
        w at the end of such a gap is add + keep * w at its start.
    at_knots : ndarray, shape (2, most, 2)
        h and its integral at the knots.
    first_region : ndarray of int, shape (2, most)
        Region in which each gap begins.
    regions, region_sides : ndarray
        Phases 0, those where the force for sticking equals the break-away force, and 2 pi; 0
        where sticking is possible, else the sign in which the slider breaks away.
    exit_gaps, exit_values : ndarray
        For each of them: gap in which sliding begins there; h, its integral, v_R, and w at the
        end of that gap.
    rests, rest_velocities : ndarray
        Phases where a_R = 0, and v_R there.

    """

    omega: float
    decay: float
    limits: Array
    spectrum: Array
    knots: Array
    knot_counts: NDArray[np.int64]
    is_away: NDArray[np.bool_]
    add: Array
    keep: Array
    at_knots: Array
    first_region: NDArray[np.int64]
    regions: Array
    region_sides: NDArray[np.int64]
    exit_gaps: NDArray[np.int64]
    exit_values: Array
    rests: Array
    rest_velocities: Array

    @classmethod
    def make(
        cls,
        motion: HarmonicMotion,
        slider: SliderParameters,
        friction: FrictionLaw,
        load: LoadParameters | None,
    ) -> _Case:
        """Find the fixed phases and tabulate the solution over them."""
        omega = _TURN * motion.fundamental_frequency
        ik = 1j * np.arange(1, motion.harmonics + 1)
        velocity = (
            np.array(motion.amplitudes) * ik.imag * omega * np.exp(1j * np.array(motion.phases))
        )
        law, scale = friction.numbers, slider.friction_scale
        inertia = slider.mass * omega
        decay = scale * law.slope / inertia
        outer = slider.axial_force - slider.weight_along_rod - (load.constant_force if load else 0)
        slide, stick, push = (
            scale * law.force / inertia,
            scale * law.break_away / inertia,
            outer / inertia,
        )
        levels = (push + slide, push - slide)
        # With equal forces the phases of break-away ARE those of the sliding tables.
        edges = levels if law.break_away == law.force else (push + stick, push - stick)
        response = velocity * ik / (ik + decay)

        alpha = velocity * ik
        nodes = monotone_nodes(alpha)
        tables = [level_phases(alpha, level, nodes) for level in levels]
        most = max(phases.size for phases, _ in tables)
        knots, is_away = np.full((2, most), _TURN), np.zeros((2, most), dtype=np.bool_)
        add, keep, at_knots = np.zeros((2, most)), np.zeros((2, most)), np.zeros((2, most, 2))
        counts = np.array([phases.size for phases, _ in tables])
        for i, (phases, sides) in enumerate(tables):
            size = phases.size
            knots[i, :size] = phases
            is_away[i, : size - 1] = sides == (1, -1)[i]
            h = trigonometric_value(response, phases)
            at_knots[i, :size, 0] = h
            at_knots[i, :size, 1] = trigonometric_value(response / ik, phases)
            gone = np.diff(phases)
            keep[i, : size - 1] = np.exp(-decay * gone)
            first = gone if decay == 0.0 else -np.expm1(-decay * gone) / decay
            add[i, : size - 1] = h[1:] - h[:-1] * keep[i, : size - 1] - levels[i] * first

        regions, sides = _regions(alpha, edges, nodes)
        exit_gaps = np.zeros(regions.size, dtype=np.int64)
        exit_values = np.zeros((regions.size, 4))
        exit_values[:, 0] = trigonometric_value(response, regions)
        exit_values[:, 1] = trigonometric_value(response / ik, regions)
        exit_values[:, 2] = trigonometric_value(velocity, regions)
        for j in range(1, regions.size - 1):
            if sides[j - 1] != 0 or sides[j] == 0:
                continue
            i = 0 if sides[j] > 0 else 1
            gap = _gap_of_exit(knots[i], counts[i], is_away[i], regions[j])
            exit_gaps[j] = gap
            gone = knots[i, gap + 1] - regions[j]
            left = math.exp(-decay * gone)
            first = gone if decay == 0.0 else -math.expm1(-decay * gone) / decay
            exit_values[j, 3] = (
                at_knots[i, gap + 1, 0] - exit_values[j, 0] * left - levels[i] * first
            )

        first_region = np.zeros((2, most), dtype=np.int64)
        for i in range(2):
            found = np.searchsorted(regions, knots[i], side="right") - 1
            first_region[i] = np.clip(found, 0, regions.size - 2)
        rests, _ = level_phases(alpha, 0.0, nodes)
        turns_while_sliding = decay > 0.0 and abs(push) >= slide
        return cls(
            omega, decay, np.array([*levels, slide, 1.0 if turns_while_sliding else 0.0]),
            np.array([velocity.real, velocity.imag, response.real, response.imag]),
            knots, counts, is_away, add, keep, at_knots, first_region, regions, sides, exit_gaps,
            exit_values, rests, trigonometric_value(velocity, rests),
        )  # fmt: skip

    @cached_property
    def velocity_spectrum(self) -> NDArray[np.complex128]:
        """Coefficients V_k of the rod velocity (m/s)."""
        return np.asarray(self.spectrum[0] + 1j * self.spectrum[1])

    @cached_property
    def response_spectrum(self) -> NDArray[np.complex128]:
        """Coefficients h_k of the periodic response (m/s)."""
        return np.asarray(self.spectrum[2] + 1j * self.spectrum[3])

    def starts_at_rest(self, initial_velocity: float) -> bool:
        """Return whether rod and slider have equal velocities at time 0."""
        return bool(trigonometric_value(self.velocity_spectrum, np.zeros(1))[0] == initial_velocity)


def _regions(
    alpha: NDArray[np.complex128], edges: tuple[float, float], nodes: Array
) -> tuple[Array, NDArray[np.int64]]:
    """Merge the phases of break-away in both directions."""
    above, above_sides = level_phases(alpha, edges[0], nodes)
    below, below_sides = level_phases(alpha, edges[1], nodes)
    phases = np.union1d(above, below)
    middle = 0.5 * (phases[1:] + phases[:-1])
    forward = above_sides[np.searchsorted(above, middle, side="right") - 1] > 0
    backward = below_sides[np.searchsorted(below, middle, side="right") - 1] < 0
    return phases, np.where(forward, 1, np.where(backward, -1, 0)).astype(np.int64)


def _gap_of_exit(knots: Array, count: int, is_away: NDArray[np.bool_], phase: float) -> int:
    """Return the gap in which a slide begins; by rounding its phase may lie just before."""
    gap = int(np.searchsorted(knots[:count], phase, side="right")) - 1
    gap = min(max(gap, 0), int(count) - 2)
    return gap if is_away[gap] or gap + 2 >= count else gap + 1


@njit(cache=True, error_model="numpy")
def _decays(decay, gone):
    """Return E = exp(-x), phi_1 and phi_2 = (gone - phi_1) / decay, with x = decay * gone."""
    if decay == 0.0:
        return 1.0, gone, 0.5 * gone * gone
    x = decay * gone
    if x < 0.1:
        # 1/2! - x/3! + x^2/4! - ...: the differences above would lose the digits here.
        second = 1.0 / 39916800.0
        second = 1.0 / 3628800.0 - x * second
        second = 1.0 / 362880.0 - x * second
        second = 1.0 / 40320.0 - x * second
        second = 1.0 / 5040.0 - x * second
        second = 1.0 / 720.0 - x * second
        second = 1.0 / 120.0 - x * second
        second = 1.0 / 24.0 - x * second
        second = 1.0 / 6.0 - x * second
        second = 0.5 - x * second
        first = 1.0 - x * second
        return 1.0 - x * first, gone * first, gone * gone * second
    first = -math.expm1(-x) / x
    return math.exp(-x), gone * first, gone * gone * (1.0 - first) / x


@njit(cache=True, error_model="numpy")
def _rod(theta, decay, spectrum):
    """Return v_R, alpha, alpha', h and the integral of h at a phase."""
    cos_1, sin_1 = math.cos(theta), math.sin(theta)
    cos_k, sin_k = cos_1, sin_1
    velocity, alpha, jerk, response, integral = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(spectrum.shape[1]):
        k = i + 1.0
        even = spectrum[0, i] * cos_k - spectrum[1, i] * sin_k
        odd = spectrum[0, i] * sin_k + spectrum[1, i] * cos_k
        velocity += even
        alpha -= k * odd
        jerk -= k * k * even
        if decay == 0.0:
            integral += odd / k
        else:
            response += spectrum[2, i] * cos_k - spectrum[3, i] * sin_k
            integral += (spectrum[2, i] * sin_k + spectrum[3, i] * cos_k) / k
        cos_k, sin_k = cos_k * cos_1 - sin_k * sin_1, sin_k * cos_1 + cos_k * sin_1
    if decay == 0.0:
        response = velocity
    return velocity, alpha, jerk, response, integral


@njit(cache=True, error_model="numpy")
def _zero(guess, low, high, sign, decay, level, w_low, h_low, spectrum):
    """
    Return the phase in (low, high) where w is zero, with v_R, h and the integral of h there.

    w has the sign `sign` at `low`, where it is `w_low`, and exactly one zero before `high`.
    Halley's method from the guess; where it would leave the bracket, halving.
    """
    base = low
    theta = guess if low < guess < high else 0.5 * (low + high)
    for _ in range(200):
        velocity, alpha, jerk, h, integral = _rod(theta, decay, spectrum)
        left, first, _unused = _decays(decay, theta - base)
        w = h - level * first + (w_low - h_low) * left
        rate = alpha - level - decay * w
        bend = jerk - decay * rate
        if w * sign > 0.0:
            low = theta
        else:
            high = theta
        below = rate - 0.5 * w * bend / rate
        step = -w / below
        if not (low <= theta + step <= high):
            step = 0.5 * (low + high) - theta
            if step == 0.0 or high - low <= 1e-15 * high:
                return theta, velocity, h, integral
        elif abs(step) < 1e-6:
            # The rest of Halley's method is below rounding: go there by Taylor's series.
            h_rate = alpha - decay * h
            integral += step * (h + step * (0.5 * h_rate))
            h += step * (h_rate + 0.5 * step * (jerk - decay * h_rate))
            velocity += step * (alpha + 0.5 * step * jerk)
            return theta + step, velocity, h, integral
        theta += step
    return theta, velocity, h, integral


@njit(cache=True, error_model="numpy")
def _turning_extremes(start, end, w, h, sign, decay, limits, spectrum, rests, low, high):
    """
    Widen (low, high) by extremes of v_S inside a slide, for a constant force above F_0.

    The slider's acceleration y obeys y' + Lambda y = Lambda alpha: it has at most one zero
    between two phases where alpha = 0.
    """
    level = limits[0] if sign > 0 else limits[1]
    a, w_a = start, w
    for j in range(rests.size):
        b = rests[j] if rests[j] < end else end
        if b <= a:
            continue
        left, first, _unused = _decays(decay, b - start)
        h_b = _rod(b, decay, spectrum)[3]
        w_b = h_b - level * first + (w - h) * left
        y_a, y_b = level + decay * w_a, level + decay * w_b
        if y_a * y_b < 0.0:
            s, e = a, b
            for _ in range(60):
                middle = 0.5 * (s + e)
                left, first, _unused = _decays(decay, middle - start)
                v, _alpha, _jerk, h_m, _integral = _rod(middle, decay, spectrum)
                w_m = h_m - level * first + (w - h) * left
                if (level + decay * w_m) * y_a > 0.0:
                    s = middle
                else:
                    e = middle
            low, high = min(low, v - w_m), max(high, v - w_m)
        a, w_a = b, w_b
        if b == end:
            break
    return low, high


@njit(cache=True, error_model="numpy")
def _note(segments, count, period, theta, mode, w):
    if count < segments.shape[0]:
        segments[count, 0], segments[count, 1] = period, theta
        segments[count, 2], segments[count, 3] = mode, w
    return count + 1


@njit(cache=True, error_model="numpy")
def _solve(
    decay, limits, spectrum, knots, counts, is_away, add, keep, at_knots, first_region, regions,
    region_sides, exit_gaps, exit_values, rests, rest_velocities, starts_at_rest,
    initial_velocity, rows, segments,
):  # fmt: skip
    """
    Fill one row per period; return the number of segments, or -1, and the final slider velocity.

    Rows: integral over the phase of w where positive, where negative, extremes of v_S, phase
    spent sticking.
    """
    origin_velocity, origin_h, origin_integral = (
        exit_values[0, 2], exit_values[0, 0], exit_values[0, 1]
    )  # fmt: skip
    turns_while_sliding = limits[3] != 0.0
    last_region = regions.size - 2
    guesses = np.full(knots.shape, -1.0)
    count = 0
    w = 0.0 if starts_at_rest else origin_velocity - initial_velocity
    mode = 0 if w == 0.0 else (1 if w > 0.0 else -1)
    for period in range(rows.shape[1]):
        velocity = origin_velocity - w
        low, high = velocity, velocity
        positive, negative, stuck = 0.0, 0.0, 0.0
        # Start of the present stretch: phase, w, h and its integral, v_R.
        start, start_w, start_h, start_integral = 0.0, w, origin_h, origin_integral
        start_velocity = origin_velocity
        gap, region = 0, 0
        # w at the end of gap `gap`, if that is known beforehand.
        if mode == 0 and region_sides[0] != 0:
            mode = region_sides[0]
        i = 0 if mode > 0 else 1
        w_end = add[i, 0] + keep[i, 0] * w
        w_low, h_low, phase_low = w, origin_h, 0.0
        if segments.shape[0] > 0:
            count = _note(segments, count, period, 0.0, mode, w)
        is_over = False
        for _ in range(10000):
            if mode == 0:
                end = regions[region + 1]
                stuck += end - start
                for j in range(1, rests.size - 1):
                    if start < rests[j] < end:
                        low, high = min(low, rest_velocities[j]), max(high, rest_velocities[j])
                w = 0.0
                if region == last_region:
                    is_over = True
                    break
                region += 1
                mode = region_sides[region]
                gap = exit_gaps[region]
                w_end = exit_values[region, 3]
                start, start_w = end, 0.0
                start_h, start_integral = exit_values[region, 0], exit_values[region, 1]
                start_velocity = exit_values[region, 2]
                w_low, h_low, phase_low = 0.0, start_h, start
                low, high = min(low, start_velocity), max(high, start_velocity)
                i = 0 if mode > 0 else 1
                if segments.shape[0] > 0:
                    count = _note(segments, count, period, start, mode, 0.0)
            # Slide: from knot to knot, until w has changed its sign or the period is over.
            last_gap = counts[i] - 2
            while True:
                if not is_away[i, gap] and w_end * mode < 0.0:
                    break
                if gap == last_gap:
                    is_over = True
                    break
                gap += 1
                w_low, h_low, phase_low = w_end, at_knots[i, gap, 0], knots[i, gap]
                w_end = add[i, gap] + keep[i, gap] * w_end
            level = limits[i]
            if is_over:
                end, end_integral, w = _TURN, origin_integral, w_end
            else:
                end, velocity, h, end_integral = _zero(
                    guesses[i, gap], phase_low, knots[i, gap + 1], mode, decay, level, w_low,
                    h_low, spectrum,
                )  # fmt: skip
                guesses[i, gap] = end
            _left, first, second = _decays(decay, end - start)
            slid = end_integral - start_integral + (start_w - start_h) * first - level * second
            if mode > 0:
                positive += slid
            else:
                negative += slid
            if turns_while_sliding:
                low, high = _turning_extremes(
                    start, end, start_w, start_h, mode, decay, limits, spectrum, rests, low, high
                )
            if is_over:
                break
            low, high = min(low, velocity), max(high, velocity)
            region = first_region[i, gap]
            while region < last_region and regions[region + 1] <= end:
                region += 1
            mode = region_sides[region]
            start, start_w, start_h, start_integral = end, 0.0, h, end_integral
            start_velocity = velocity
            if mode != 0:
                i = 0 if mode > 0 else 1
                gap = 0
                while gap < counts[i] - 2 and knots[i, gap + 1] <= end:
                    gap += 1
                if is_away[i, gap]:
                    left, first, second = _decays(decay, knots[i, gap + 1] - end)
                    w_end = at_knots[i, gap + 1, 0] - h * left - limits[i] * first
                    w_low, h_low, phase_low = 0.0, h, end
                else:
                    # By rounding alone: sliding would end at once.
                    mode = 0
            if segments.shape[0] > 0:
                count = _note(segments, count, period, end, mode, 0.0)
        if not is_over:
            return -1, 0.0
        velocity = origin_velocity - w
        low, high = min(low, velocity), max(high, velocity)
        rows[0, period], rows[1, period] = positive, negative
        rows[2, period], rows[3, period], rows[4, period] = low, high, stuck
    return count, origin_velocity - w


class _Segments:
    """The recorded stretches of a solution, from which the motion at any time follows."""

    def __init__(self, case: _Case, segments: Array, position: float, periods: int) -> None:
        self._case = case
        self._periods = periods
        period, theta, mode, w = segments.T
        self._period, self._theta, self._mode, self._w = period, theta, mode, w
        self._turns = period + theta / _TURN
        ends = np.append(theta[1:], _TURN)
        ends[ends == 0.0] = _TURN
        slid = self._slid(np.arange(period.size), ends)[1]
        self._slid_before = np.concatenate([[0.0], np.cumsum(slid)[:-1]])
        self._start = position

    @property
    def event_times(self) -> Array:
        """Times (s) at which stretches of sticking or sliding begin."""
        return np.asarray(self._turns[self._theta > 0.0] * _TURN / self._case.omega)

    def sample(self, time: ArrayLike) -> SliderMotion:
        """Return the motion at the times (s) since the start."""
        times = np.asarray(time, dtype=np.float64)
        turns = times * (self._case.omega / _TURN)
        if times.size and (turns.min() < 0.0 or turns.max() > self._periods * (1 + 1e-12)):
            raise BadInputError("is outside the solution", where="time", value=times)
        index = np.clip(np.searchsorted(self._turns, turns, side="right") - 1, 0, None)
        theta = (turns - self._period[index]) * _TURN
        w, slid = self._slid(index, theta)
        spectrum = self._case.velocity_spectrum
        ik = 1j * np.arange(1, spectrum.size + 1)
        rod_velocity = trigonometric_value(spectrum, theta)
        travelled = trigonometric_value(spectrum / ik, theta)
        travelled = travelled - trigonometric_value(spectrum / ik, np.zeros(1))
        position = self._start + (travelled - self._slid_before[index] - slid) / self._case.omega
        return SliderMotion(
            times, position, rod_velocity - w, rod_velocity, np.asarray(self._mode[index] == 0)
        )

    def _slid(self, index: NDArray[np.int64], theta: Array) -> tuple[Array, Array]:
        """Return w and its integral over the phase since the start of segment `index`."""
        case, start = self._case, self._theta[index]
        response = case.response_spectrum
        ik = 1j * np.arange(1, response.size + 1)
        h, h_0 = trigonometric_value(response, theta), trigonometric_value(response, start)
        integral = trigonometric_value(response / ik, theta)
        integral = integral - trigonometric_value(response / ik, start)
        mode, w_0 = self._mode[index], self._w[index]
        level = np.where(mode > 0, case.limits[0], case.limits[1])
        left, first, second = _decay_arrays(case.decay, theta - start)
        w = h - level * first + (w_0 - h_0) * left
        slid = integral - level * second + (w_0 - h_0) * first
        return np.where(mode == 0, 0.0, w), np.where(mode == 0, 0.0, slid)


@njit(cache=True, error_model="numpy")
def _decay_arrays(decay, gone):
    left, first, second = np.empty_like(gone), np.empty_like(gone), np.empty_like(gone)
    for i in range(gone.size):
        left.flat[i], first.flat[i], second.flat[i] = _decays(decay, gone.flat[i])
    return left, first, second

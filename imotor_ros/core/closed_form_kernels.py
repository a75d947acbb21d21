"""
Compiled code of the closed-form solver; see `closed_form` for the equations and symbols.

Phases are in rad, integrals over the phase; the time scale of the drive enters through Lambda and
the levels alone.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
_TURN = 2.0 * math.pi

_SAME = 1e-15
"""Change of w over a period, as part of the range of v_S in it, that is rounding."""


@njit(cache=True, error_model="numpy")
def decays(decay: float, gone: float) -> tuple[float, float, float]:
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
def _rod(theta: float, decay: float, spectrum: Array) -> tuple[float, float, float, float, float]:
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
def _zero(
    guess: float,
    low: float,
    high: float,
    sign: int,
    decay: float,
    level: float,
    w_low: float,
    h_low: float,
    spectrum: Array,
) -> tuple[float, float, float, float]:
    """
    Return the phase in (low, high) where w is zero, with v_R, h and the integral of h there.

    w has the sign `sign` at `low`, where it is `w_low`, and exactly one zero before `high`.
    Halley's method from the guess; where it would leave the bracket, halving.
    """
    base = low
    theta = guess if low < guess < high else 0.5 * (low + high)
    for _ in range(200):
        velocity, alpha, jerk, h, integral = _rod(theta, decay, spectrum)
        left, first, _unused = decays(decay, theta - base)
        w = h - level * first + (w_low - h_low) * left
        rate = alpha - level - decay * w
        bend = jerk - decay * rate
        if w * sign > 0.0:
            low = theta
        else:
            high = theta
        # Newton's step and Halley's share of it; near an extreme of w both would creep: halve.
        newton, share = -w / rate, 0.5 * w * bend / (rate * rate)
        step = newton / (1.0 - share) if abs(share) < 0.5 else math.inf
        if not (low <= theta + step <= high):
            step = 0.5 * (low + high) - theta
            if step == 0.0 or high - low <= 1e-15 * high:
                return theta, velocity, h, integral
        elif abs(step) < 1e-6 and abs(step) * share * share < 1e-17:
            # The rest of Halley's method is below rounding: go there by Taylor's series.
            h_rate = alpha - decay * h
            integral += step * (h + step * (0.5 * h_rate))
            h += step * (h_rate + 0.5 * step * (jerk - decay * h_rate))
            velocity += step * (alpha + 0.5 * step * jerk)
            return theta + step, velocity, h, integral
        theta += step
    return theta, velocity, h, integral


@njit(cache=True, error_model="numpy")
def _turning_extremes(
    start: float,
    end: float,
    w: float,
    h: float,
    sign: int,
    decay: float,
    levels: tuple[float, float],
    spectrum: Array,
    rests: Array,
    low: float,
    high: float,
) -> tuple[float, float]:
    """
    Widen (low, high) by extremes of v_S inside a slide, for a constant force above F_0.

    The slider's acceleration y obeys y' + Lambda y = Lambda alpha: it has at most one zero
    between two phases where alpha = 0.
    """
    level = levels[0] if sign > 0 else levels[1]
    a, w_a = start, w
    for j in range(rests.size + 1):
        b = min(rests[j], end) if j < rests.size else end
        if b <= a:
            continue
        left, first, _unused = decays(decay, b - start)
        h_b = _rod(b, decay, spectrum)[3]
        w_b = h_b - level * first + (w - h) * left
        y_a, y_b = level + decay * w_a, level + decay * w_b
        if y_a * y_b < 0.0:
            s, e = a, b
            for _ in range(60):
                middle = 0.5 * (s + e)
                left, first, _unused = decays(decay, middle - start)
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
def _note(segments: Array, count: int, period: int, theta: float, mode: int, w: float) -> int:
    if count < segments.shape[0]:
        segments[count, 0], segments[count, 1] = period, theta
        segments[count, 2], segments[count, 3] = mode, w
    return count + 1


@njit(cache=True, error_model="numpy")
def solve(
    decay: float,
    levels: tuple[float, float],
    turns_while_sliding: bool,
    spectrum: Array,
    counts: NDArray[np.int64],
    knots: Array,
    is_away: NDArray[np.bool_],
    keep: Array,
    add: Array,
    at_knots: Array,
    first_region: NDArray[np.int64],
    regions: Array,
    region_sides: NDArray[np.int64],
    exit_gaps: NDArray[np.int64],
    exit_values: Array,
    rests: Array,
    rest_velocities: Array,
    initial_velocity: float,
    until_steady: bool,
    rows: Array,
    segments: Array,
) -> tuple[int, float]:
    """
    Fill one row per period; return the number of segments, or -1, and the final slider velocity.

    Rows: integral over the phase of w where positive, where negative, extremes of v_S, phase
    spent sticking. If asked to, copy the row of the first period that ends as it began to all
    periods after it: w at its start alone determines a period.
    """
    origin_velocity, origin_h, origin_integral = (
        exit_values[0, 2], exit_values[0, 0], exit_values[0, 1]
    )  # fmt: skip
    last_region = regions.size - 2
    guesses = np.full(knots.shape, -1.0)
    count = 0
    w = origin_velocity - initial_velocity
    mode = 0 if w == 0.0 else (1 if w > 0.0 else -1)
    for period in range(rows.shape[1]):
        w_before, mode_before = w, mode
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
                for j in range(rests.size):
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
            level = levels[i]
            if is_over:
                end, end_integral, w = _TURN, origin_integral, w_end
            else:
                end, velocity, h, end_integral = _zero(
                    guesses[i, gap], phase_low, knots[i, gap + 1], mode, decay, level, w_low,
                    h_low, spectrum,
                )  # fmt: skip
                guesses[i, gap] = end
            _left, first, second = decays(decay, end - start)
            slid = end_integral - start_integral + (start_w - start_h) * first - level * second
            if mode > 0:
                positive += slid
            else:
                negative += slid
            if turns_while_sliding:
                low, high = _turning_extremes(
                    start, end, start_w, start_h, mode, decay, levels, spectrum, rests, low, high
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
                    left, first, second = decays(decay, knots[i, gap + 1] - end)
                    w_end = at_knots[i, gap + 1, 0] - h * left - levels[i] * first
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
        if until_steady and mode == mode_before and abs(w - w_before) <= _SAME * (high - low):
            for row in range(rows.shape[0]):
                rows[row, period + 1 :] = rows[row, period]
            break
    return count, origin_velocity - w


@njit(cache=True, error_model="numpy")
def decay_arrays(decay: float, gone: Array) -> tuple[Array, Array, Array]:
    """Return `decays` for an array of phases gone."""
    left, first, second = np.empty_like(gone), np.empty_like(gone), np.empty_like(gone)
    for i in range(gone.size):
        left.flat[i], first.flat[i], second.flat[i] = decays(decay, gone.flat[i])
    return left, first, second

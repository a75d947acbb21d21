"""
One step of the slider's motion as a power series in time: compiled code for both solvers.

Between two events (a change between sticking and sliding, or at an end stop) the motion is
analytic, and its Taylor coefficients follow from each other. `advance` builds them, chooses how
far they hold, finds the first event before that, and goes there. The event polynomials are
searched by `polynomial.first_root`, which misses none. A root at which a stretch starts is taken
out of its polynomial, so that no event is found twice: the cause of stalls in event solvers.

Equations (1) to (5) of the paper; x slider position, v slider velocity, w = v_R - v relative
velocity, L load force, N friction force that sticking needs.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from imotor_ros.core.friction import FrictionNumbers
from imotor_ros.core.polynomial import (
    evaluate,
    first_crossing,
    integral,
    root_workspace,
    slope,
)
from imotor_ros.core.slider import LoadNumbers

Array = NDArray[np.float64]

# Entries of the constants array.
MASS, FORCE, SLOPE, EXCESS, DECAY, EXPONENT, BREAK = 0, 1, 2, 3, 4, 5, 6
SPRING, SPRING_AT, CONSTANT, LOWER, UPPER, STOP, DAMPING = 7, 8, 9, 10, 11, 12, 13

# States at the end stops: away from both; pushing against one; behind its surface but retreating
# faster than it follows, so that no force acts. Negative at the lower stop.
AWAY, PUSHING, TRAILING = 0, 1, 2

# What ended a step.
NOTHING, ZERO, EXIT, TOUCH, FAILED = 0, 1, 2, 3, 4

# Rows of the series workspace.
_W, _V, _X, _L, _E, _G, _NEED, _TEST, _RATE, _STEP = range(10)
SLIDER_VELOCITY, SLIDER_POSITION, LOAD = _V, _X, _L


def series_workspace(order: int, mass: float) -> Array:
    """Return the memory of `advance` for series up to t^order and a slider of `mass` (kg)."""
    work = np.zeros((10, order + 2))
    work[_STEP] = 1.0 / np.arange(1, order + 3)
    work[_RATE] = work[_STEP] / mass
    return work


def constants(mass: float, friction: FrictionNumbers, load: LoadNumbers) -> Array:
    """Return mass (kg), friction law and load as the array that `advance` takes."""
    return np.array([mass, *friction, *load], dtype=np.float64)


__all__ = ["advance", "clear_speed", "constants", "decide", "root_workspace", "series_workspace"]


@njit(cache=True, error_model="numpy", inline="always")
def position_load(x: float, v: float, stop: int, p: Array) -> float:
    """Return the load force (N) at position x (m), velocity v (m/s) and stop state."""
    load = p[SPRING] * (x - p[SPRING_AT]) + p[CONSTANT]
    if stop == PUSHING:
        load += p[STOP] * (x - p[UPPER]) + p[DAMPING] * v
    elif stop == -PUSHING:
        load += p[STOP] * (x - p[LOWER]) + p[DAMPING] * v
    return float(load)


@njit(cache=True, error_model="numpy", inline="always")
def sliding_force(w: float, p: Array) -> float:
    """Return the magnitude (N) of the sliding force at relative velocity w (m/s)."""
    speed = abs(w)
    force = p[FORCE] + p[SLOPE] * speed
    if p[EXCESS] != 0.0:
        ratio = speed / p[DECAY]
        force += p[EXCESS] * math.exp(-(ratio if p[EXPONENT] == 1.0 else ratio * ratio))
    return float(force)


@njit(cache=True, error_model="numpy")
def stop_state(x: float, v: float, p: Array) -> int:
    """Return the stop state of a slider at x (m) with velocity v (m/s)."""
    if p[STOP] == 0.0:
        return AWAY
    if x > p[UPPER]:
        return PUSHING if p[STOP] * (x - p[UPPER]) + p[DAMPING] * v > 0.0 else TRAILING
    if x < p[LOWER]:
        return -PUSHING if p[STOP] * (x - p[LOWER]) + p[DAMPING] * v < 0.0 else -TRAILING
    return AWAY


@njit(cache=True, error_model="numpy")
def clear_speed(p: Array) -> float:
    """Return the relative speed (m/s) beyond which the excess at rest is below rounding."""
    if p[EXCESS] == 0.0:
        return 0.0
    return float(p[DECAY] * (37.0 if p[EXPONENT] == 1.0 else 6.1))


@njit(cache=True, error_model="numpy")
def decide(need: float, limit: float) -> int:
    """Return 0 to stick, or the sign of sliding, where rod and slider have equal velocities."""
    if abs(need) <= limit:
        return 0
    return 1 if need > 0.0 else -1


@njit(cache=True, error_model="numpy")
def _load_coefficient(k: int, s: Array, stop: int, p: Array) -> float:
    load = p[SPRING] * s[_X, k]
    if k == 0:
        load += p[CONSTANT] - p[SPRING] * p[SPRING_AT]
    if stop == PUSHING or stop == -PUSHING:
        load += p[STOP] * s[_X, k] + p[DAMPING] * s[_V, k]
        if k == 0:
            load -= p[STOP] * (p[UPPER] if stop > 0 else p[LOWER])
    return float(load)


@njit(cache=True, error_model="numpy")
def _sliding_series(
    mode: int,
    stop: int,
    known: int,
    w0: float,
    x0: float,
    r: Array,
    order: int,
    push: tuple[float, float],
    lift: tuple[float, float],
    clear: float,
    p: Array,
    s: Array,
) -> None:
    """Taylor coefficients of w, v, x, L while sliding; `push`, `lift` are linear in time."""
    sign = float(mode)
    s[_W, 0], s[_V, 0], s[_X, 0] = w0, r[0] - w0, x0
    gaussian = p[EXPONENT] == 2.0
    # Far from rest the excess is left out: its series would not tell how it grows on the way.
    excess = 0.0 if abs(w0) > clear else p[EXCESS]
    before = 0.0
    for k in range(order):
        force = p[SLOPE] * sign * s[_W, k]
        if k == 0:
            force += p[FORCE]
        if excess != 0.0:
            if gaussian:
                total = 0.0
                for i in range(k + 1):
                    total += s[_W, i] * s[_W, k - i]
                s[_G, k] = total / (p[DECAY] * p[DECAY])
            else:
                s[_G, k] = sign * s[_W, k] / p[DECAY]
            if k == 0:
                s[_E, 0] = math.exp(-s[_G, 0])
            else:
                total = 0.0
                for j in range(1, k + 1):
                    total += j * s[_G, j] * s[_E, k - j]
                s[_E, k] = -total / k
            force += excess * s[_E, k]
        friction = lift[0] * force + lift[1] * before
        before = force
        s[_L, k] = _load_coefficient(k, s, stop, p)
        outer = push[k] if k < 2 else 0.0
        s[_V, k + 1] = (sign * friction + outer - s[_L, k]) * s[_RATE, k]
        if k == 0 and known == 2:
            s[_V, 1] = r[1]
        s[_W, k + 1] = r[k + 1] - s[_V, k + 1]
        s[_X, k + 1] = s[_V, k] * s[_STEP, k]
    s[_L, order] = _load_coefficient(order, s, stop, p)


@njit(cache=True, error_model="numpy")
def _sticking_series(
    stop: int, x0: float, r: Array, order: int, push: tuple[float, float], p: Array, s: Array
) -> None:
    """Taylor coefficients of v, x, L and of the force N that sticking needs (to order - 1)."""
    s[_X, 0] = x0
    for k in range(order + 1):
        s[_W, k], s[_V, k] = 0.0, r[k]
        if k < order:
            s[_X, k + 1] = r[k] * s[_STEP, k]
        s[_L, k] = _load_coefficient(k, s, stop, p)
        if k:
            outer = push[k - 1] if k < 3 else 0.0
            s[_NEED, k - 1] = p[MASS] * k * r[k] + s[_L, k - 1] - outer


@njit(cache=True, error_model="numpy")
def _valid_length(last: float, previous: float, order: int, length: float, scale: float) -> float:
    """
    Return how far the last two coefficients of a series stay below `scale`, at most `length`.

    `last` and `previous` are their magnitudes.
    """
    power = length ** (order - 1)
    if last * power * length > scale:
        length = (scale / last) ** (1.0 / order)
        power = length ** (order - 1)
    if previous * power > scale:
        length = (scale / previous) ** (1.0 / (order - 1))
    return length


@njit(cache=True, error_model="numpy")
def _stop_event(
    stop: int, order: int, length: float, p: Array, s: Array, work: Array
) -> tuple[float, int]:
    """Return time of the first change at the end stops in [0, length], and the state after it."""
    best, after = math.inf, stop
    test = s[_TEST]
    for side in (1, -1):
        if stop * side < 0:
            continue
        surface = p[UPPER] if side > 0 else p[LOWER]
        if stop == AWAY or stop == side * TRAILING:
            for k in range(order + 1):
                test[k] = s[_X, k]
            test[0] -= surface
            if stop == AWAY:
                # Just after leaving a surface the distance may be zero or rounded to its inside.
                if test[0] * side > 0.0:
                    test[0] = 0.0
                time = first_crossing(test, 0, order, -side, length, work)
                if time < best:
                    best, after = time, side * PUSHING
            else:
                if test[0] * side < 0.0:
                    test[0] = 0.0
                time = first_crossing(test, 0, order, side, length, work)
                if time < best:
                    best, after = time, AWAY
        if stop != AWAY:
            # The force that the stop would exert; it pushes while that has the sign of `side`.
            for k in range(order + 1):
                test[k] = p[STOP] * s[_X, k] + p[DAMPING] * s[_V, k]
            test[0] -= p[STOP] * surface
            wanted = side if stop == side * PUSHING else -side
            if test[0] * wanted < 0.0:
                test[0] = 0.0
            time = first_crossing(test, 0, order, wanted, length, work)
            if time < best:
                best = time
                after = side * PUSHING
                if stop == side * PUSHING:
                    # Without damping the force is gone at the surface itself.
                    after = side * TRAILING if p[DAMPING] > 0.0 else AWAY
    return best, after


@njit(cache=True, error_model="numpy")
def advance(
    mode: int,
    stop: int,
    known: int,
    w0: float,
    x0: float,
    r: Array,
    order: int,
    length: float,
    push: tuple[float, float],
    lift: tuple[float, float],
    tolerance: float,
    p: Array,
    s: Array,
    work: Array,
) -> tuple[float, int, int, int, int, float, float]:
    """
    Go on in the present mode to the first event, at most by `length`.

    Parameters
    ----------
    mode : int
        0 sticking, else the sign of the relative velocity.
    stop : int
        State at the end stops.
    known : int
        How many coefficients of w are known to be zero: 1 at the start of a slide, 2 if it also
        starts without acceleration.
    w0, x0 : float
        Relative velocity (m/s) and slider position (m) at the start.
    r : ndarray, shape (order + 1,)
        Taylor coefficients of the rod velocity at the start.
    order : int
        Order of the series.
    length : float
        Longest step (s).
    push : tuple of float
        Outer axial force less weight (N), value and rate, linear in time.
    lift : tuple of float
        Contact force over the nominal one, value and rate.
    tolerance : float
        Size of the last terms of the series relative to the velocities.
    p, s, work : ndarray
        Constants, series workspace, root workspace; `s` holds the series afterwards.

    Returns
    -------
    tuple
        Time gone (s), event, then mode, stop, known, w and x after it.

    """
    has_stops = p[STOP] > 0.0
    # A little inside, so that a step that ends there counts as near.
    clear = clear_speed(p) * (1.0 + 1e-9)
    if mode == 0:
        _sticking_series(stop, x0, r, order, push, p, s)
        limit = p[BREAK] * lift[0]
        if abs(s[_NEED, 0]) > limit:
            return 0.0, EXIT, (1 if s[_NEED, 0] > 0.0 else -1), stop, 1, 0.0, x0
    else:
        _sliding_series(mode, stop, known, w0, x0, r, order, push, lift, clear, p, s)
        if known == 0 and w0 * mode <= 0.0:
            need = p[MASS] * r[1] + s[_L, 0] - push[0]
            after = decide(need, p[BREAK] * lift[0])
            return 0.0, ZERO, after, stop, 1, 0.0, x0
    scale = tolerance * (
        abs(s[_V, 0]) + abs(w0) + (abs(s[_V, 1]) + abs(s[_W, 1])) * length + 1e-300
    )
    last = max(abs(s[_V, order]), abs(s[_W, order]))
    previous = max(abs(s[_V, order - 1]), abs(s[_W, order - 1]))
    length = _valid_length(last, previous, order, length, scale)

    time, event, after, after_stop, after_known = length, NOTHING, mode, stop, 0
    if mode == 0:
        test = s[_TEST]
        for sign in (1, -1):
            for k in range(order):
                test[k] = -sign * s[_NEED, k]
            test[0] += p[BREAK] * lift[0]
            test[1] += p[BREAK] * lift[1]
            crossing = first_crossing(test, 0, order - 1, 1, time, work)
            if crossing <= time:
                time, event, after = crossing, EXIT, sign
                after_known = 2 if p[BREAK] == p[FORCE] + p[EXCESS] else 1
    elif abs(w0) > clear > 0.0:
        test = s[_TEST]
        for k in range(order + 1):
            test[k] = s[_W, k]
        test[0] -= mode * clear_speed(p)
        time = min(time, first_crossing(test, 0, order, mode, time, work))
    else:
        crossing = first_crossing(s[_W], known, order, mode, time, work)
        if crossing <= time:
            time, event = crossing, ZERO
    if has_stops:
        crossing, changed = _stop_event(stop, order, time, p, s, work)
        if crossing < time or (crossing <= time and event == NOTHING):
            time, event, after, after_stop, after_known = (
                crossing,
                TOUCH,
                mode,
                changed,
                0,
            )

    x = evaluate(s[_X], order, time)
    w = 0.0 if mode == 0 else evaluate(s[_W], order, time)
    if event == ZERO:
        velocity = evaluate(r, order, time)
        need = p[MASS] * slope(r, order, time) + position_load(x, velocity, stop, p)
        need -= push[0] + push[1] * time
        after = decide(need, p[BREAK] * (lift[0] + lift[1] * time))
        after_known, w = 1, 0.0
    elif event == TOUCH:
        after_known = known if time == 0.0 else 0
    return time, event, after, after_stop, after_known, w, x


@njit(cache=True, error_model="numpy")
def load_impulse(s: Array, order: int, time: float) -> float:
    """Return the integral of the load force over the first `time` of that step."""
    return float(integral(s[_L], s[_STEP], order, time))


@njit(cache=True, error_model="numpy")
def relative_distance(s: Array, order: int, time: float) -> float:
    """Return the integral of w over the first `time` of the step whose series is in `s`."""
    return float(integral(s[_W], s[_STEP], order, time))

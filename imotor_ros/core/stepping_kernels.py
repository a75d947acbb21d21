"""
Compiled code of the sampled slider solver; see `stepping`.

A sample in which nothing happens is one short series, with a proof that nothing does: the Bernstein
coefficients of its cubic part, widened by the rest, enclose the relative velocity or the force that
sticking needs. Only where the proof fails does `flow.advance` look for events.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from imotor_ros.core.flow import (
    AWAY,
    BREAK,
    DAMPING,
    EXCESS,
    FORCE,
    LOWER,
    MASS,
    SLOPE,
    SPRING,
    STOP,
    TRAILING,
    UPPER,
    advance,
    clear_speed,
    decide,
    position_load,
    sliding_force,
    stop_state,
)

Array = NDArray[np.float64]

# Error of a series within a sample: far below that of the cubic between samples. Where friction
# falls steeply the steps are many, and their errors add up.
_STRAIGHT_TOLERANCE, _CURVED_TOLERANCE = 1e-11, 1e-13
_MOST_EVENTS = 10_000
# Divisions by constants are not turned into products by the compiler.
_THIRD, _FIFTH, _SIXTH, _SEVENTH = 1.0 / 3.0, 0.2, 1.0 / 6.0, 1.0 / 7.0


@njit(cache=True, error_model="numpy")
def process_samples(
    rod_velocity: Array,
    rod_acceleration: Array,
    axial: Array,
    normal: Array,
    has_started: bool,
    memory: Array,
    step: float,
    base_push: float,
    base_lift: float,
    lift_per_newton: float,
    p: Array,
    s: Array,
    work: Array,
    position: Array,
    velocity: Array,
    load: Array,
    friction: Array,
    is_sticking: NDArray[np.bool_],
) -> int:
    """Fill the response arrays; return the sample before which the solver failed, or -1."""
    x, w = memory[0], memory[1]
    mode, stop = int(memory[2]), int(memory[3])
    r0, a0, axial0, normal0 = memory[4], memory[5], memory[6], memory[7]
    push0 = base_push + axial0
    lift0 = base_lift
    if normal0 != 0.0:
        lift0 = max(base_lift + normal0 * lift_per_newton, 0.0)
    # Six terms of the series are enough for all that is slow against a sample.
    is_slow = max(base_lift, 1.0) * p[SLOPE] + p[DAMPING] < 0.02 * p[MASS] / step
    is_slow = is_slow and p[SPRING] + p[STOP] < 1e-4 * p[MASS] / (step * step)
    clear, rate = clear_speed(p), 1.0 / step
    r = np.zeros(s.shape[1])
    for i in range(rod_velocity.size):
        r1, a1 = rod_velocity[i], rod_acceleration[i]
        axial1 = axial[i] if axial.size else 0.0
        normal1 = normal[i] if normal.size else 0.0
        push1 = base_push + axial1
        lift1 = base_lift
        if normal1 != 0.0:
            lift1 = max(base_lift + normal1 * lift_per_newton, 0.0)
        if not has_started:
            # The first sample is the start: memory holds the slider's velocity in place of w.
            has_started = True
            w = r1 - w
            stop = stop_state(x, r1 - w, p)
            mode = 1 if w > 0.0 else -1
            if w == 0.0:
                need = p[MASS] * a1 + position_load(x, r1, stop, p) - push1
                mode = decide(need, p[BREAK] * lift1)
        else:
            difference = (r1 - r0) * rate
            c2 = (3.0 * difference - 2.0 * a0 - a1) * rate
            c3 = (a0 + a1 - 2.0 * difference) * (rate * rate)
            is_done = False
            if is_slow and abs(stop) < TRAILING:
                if mode == 0:
                    is_done, x = _stick_on(
                        stop, x, r0, a0, c2, c3, step, push0, push1, lift0, lift1, p
                    )
                else:
                    is_done, w, x = _slide_on(
                        mode, stop, w, x, r0, a0, c2, c3, step, push0, push1, lift0, lift1, clear,
                        rate, p,
                    )  # fmt: skip
            if not is_done:
                mode, stop, w, x, is_done = _through_events(
                    mode, stop, w, x, r0, a0, c2, c3, step, push0, push1, lift0, lift1, p, s, r,
                    work,
                )  # fmt: skip
                if not is_done:
                    return i
        r0, a0, axial0, normal0, push0, lift0 = r1, a1, axial1, normal1, push1, lift1
        position[i], velocity[i], is_sticking[i] = x, r1 - w, mode == 0
        load[i] = position_load(x, r1 - w, stop, p)
        if mode == 0:
            friction[i] = p[MASS] * a1 + load[i] - push1
        else:
            friction[i] = mode * lift1 * sliding_force(w, p)
    memory[0], memory[1], memory[2], memory[3] = x, w, float(mode), float(stop)
    memory[4], memory[5], memory[6], memory[7] = r0, a0, axial0, normal0
    return -1


@njit(cache=True, error_model="numpy", inline="always")
def _keeps_stop(
    stop: int, x: float, v: float, most_v: float, most_a: float, step: float, p: Array
) -> bool:
    """Return whether nothing changes at the end stops within a sample, for sure."""
    if p[STOP] == 0.0:
        return True
    if stop == AWAY:
        reach = most_v * step
        return bool(x + reach < p[UPPER] and x - reach > p[LOWER])
    pushing = p[STOP] * (x - (p[UPPER] if stop > 0 else p[LOWER])) + p[DAMPING] * v
    return bool(pushing * stop > (p[STOP] * most_v + p[DAMPING] * most_a) * step)


@njit(cache=True, error_model="numpy", inline="always")
def _stick_on(
    stop: int,
    x: float,
    r0: float,
    r1: float,
    r2: float,
    r3: float,
    h: float,
    push0: float,
    push1: float,
    lift0: float,
    lift1: float,
    p: Array,
) -> tuple[bool, float]:
    """Stick through one sample if nothing happens in it; return whether, and the position."""
    stiffness, damping = p[SPRING], 0.0
    if stop != AWAY:
        stiffness, damping = stiffness + p[STOP], p[DAMPING]
    # Force needed, as a quadratic in time, and a bound on the rest of it.
    n0 = p[MASS] * r1 + position_load(x, r0, stop, p) - push0
    n1 = (2.0 * p[MASS] * r2 + stiffness * r0 + damping * r1) * h - (push1 - push0)
    n2 = (3.0 * p[MASS] * r3 + 0.5 * stiffness * r1 + damping * r2) * h * h
    rest = (abs(stiffness * r2) + abs(damping * r3) + abs(stiffness * r3) * h) * h * h * h
    # It stays between its Bernstein coefficients, and so does the limit.
    limit0, limit2 = p[BREAK] * lift0 - rest, p[BREAK] * lift1 - rest
    if (
        abs(n0) < limit0
        and abs(n0 + 0.5 * n1) < 0.5 * (limit0 + limit2)
        and abs(n0 + n1 + n2) < limit2
    ):
        most_a = abs(r1) + (2.0 * abs(r2) + 3.0 * abs(r3) * h) * h
        if _keeps_stop(stop, x, r0, abs(r0) + most_a * h, most_a, h, p):
            return True, x + (r0 + (r1 / 2 + (r2 * _THIRD + r3 / 4 * h) * h) * h) * h
    return False, x


@njit(cache=True, error_model="numpy", inline="always")
def _slide_on(
    mode: int,
    stop: int,
    w: float,
    x: float,
    r0: float,
    r1: float,
    r2: float,
    r3: float,
    h: float,
    push0: float,
    push1: float,
    lift0: float,
    lift1: float,
    clear: float,
    rate: float,
    p: Array,
) -> tuple[bool, float, float]:
    """Slide through one sample if nothing happens in it; return whether, w and the position."""
    stiffness, damping = p[SPRING], 0.0
    if stop != AWAY:
        stiffness, damping = stiffness + p[STOP], p[DAMPING]
    inverse, slope, sign = 1.0 / p[MASS], lift0 * p[SLOPE], float(mode)
    force, lift_rate = sign * p[FORCE] + p[SLOPE] * w, (lift1 - lift0) * rate
    lifted = lift_rate * p[SLOPE]
    v0 = r0 - w
    v1 = (lift0 * force + push0 - position_load(x, v0, stop, p)) * inverse
    w1 = r1 - v1
    v2 = slope * w1 + lift_rate * force + (push1 - push0) * rate - stiffness * v0 - damping * v1
    v2 *= inverse / 2
    w2 = r2 - v2
    v3 = (slope * w2 + lifted * w1 - stiffness * v1 / 2 - damping * v2) * (inverse * _THIRD)
    w3 = r3 - v3
    v4 = (slope * w3 + lifted * w2 - stiffness * v2 * _THIRD - damping * v3) * (inverse / 4)
    v5 = (-slope * v4 + lifted * w3 - stiffness * v3 / 4 - damping * v4) * (inverse * _FIFTH)
    v6 = (-slope * v5 - lifted * v4 - stiffness * v4 * _FIFTH - damping * v5) * (inverse * _SIXTH)
    # w stays beyond the lowest Bernstein coefficient of its cubic, less the rest.
    h1, h2, h3 = w1 * h, w2 * h * h, w3 * h * h * h
    rest = -(v4 + (v5 + v6 * h) * h) * h * h * h * h
    end = w + h1 + h2 + h3
    margin = clear + 1e-12 * abs(w) + 3.0 * abs(rest)
    if (
        sign * w > margin
        and sign * (w + h1 * _THIRD) > margin
        and sign * (w + (2.0 * h1 + h2) * _THIRD) > margin
        and sign * end > margin
    ):
        most_a = abs(v1) + (2.0 * abs(v2) + 4.0 * abs(v3) * h) * h
        if _keeps_stop(stop, x, v0, abs(v0) + most_a * h, most_a, h, p):
            x += (
                v0
                + (
                    v1 / 2
                    + (
                        v2 * _THIRD
                        + (v3 / 4 + (v4 * _FIFTH + (v5 * _SIXTH + v6 * _SEVENTH * h) * h) * h) * h
                    )
                    * h
                )
                * h
            ) * h
            return True, end + rest, x
    return False, w, x


@njit(cache=True, error_model="numpy")
def _through_events(
    mode: int,
    stop: int,
    w: float,
    x: float,
    r0: float,
    a0: float,
    c2: float,
    c3: float,
    step: float,
    push0: float,
    push1: float,
    lift0: float,
    lift1: float,
    p: Array,
    s: Array,
    r: Array,
    work: Array,
) -> tuple[int, int, float, float, bool]:
    """Go through one sample with as many events as it has."""
    order = s.shape[1] - 2
    push_rate, lift_rate = (push1 - push0) / step, (lift1 - lift0) / step
    tolerance = _STRAIGHT_TOLERANCE if p[EXCESS] == 0.0 else _CURVED_TOLERANCE
    gone, known, idle = 0.0, 0, 0
    for _ in range(_MOST_EVENTS):
        # The rod's cubic and the outer forces, seen from the time reached.
        r[0] = r0 + (a0 + (c2 + c3 * gone) * gone) * gone
        r[1] = a0 + (2.0 * c2 + 3.0 * c3 * gone) * gone
        r[2] = c2 + 3.0 * c3 * gone
        r[3] = c3
        push = (push0 + push_rate * gone, push_rate)
        lift = (lift0 + lift_rate * gone, lift_rate)
        time, _event, mode, stop, known, w, x = advance(
            mode,
            stop,
            known,
            w,
            x,
            r,
            order,
            step - gone,
            push,
            lift,
            tolerance,
            p,
            s,
            work,
        )
        gone += time
        if gone >= step * (1.0 - 1e-15):
            return mode, stop, w, x, True
        idle = idle + 1 if time == 0.0 else 0
        if idle > 20:
            break
    return mode, stop, w, x, False

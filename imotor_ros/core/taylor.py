"""
Power-series solver in continuous time: springs, end stops, Stribeck and every other case.

The rod's motion is a sum of harmonics, so its Taylor coefficients at any time are known; those of
the slider follow by recurrence (`flow.advance`). Steps are as long as the series holds, events are
isolated with certainty, and nothing is stepped over. Where the closed form applies, both agree to
rounding: this solver is its check.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.flow import (
    BREAK,
    MASS,
    SLIDER_VELOCITY,
    advance,
    constants,
    decide,
    load_impulse,
    position_load,
    relative_distance,
    series_workspace,
    stop_state,
)
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.polynomial import evaluate, first_root, root_workspace
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.solution import PeriodTable, SliderMotion, check_start, check_times
from imotor_ros.errors import SolverError

Array = NDArray[np.float64]

ORDER = 24
TOLERANCE = 1e-16
_MOST_STEPS = 200_000
_HEAD = 5


def simulate(
    motion: HarmonicMotion,
    slider: SliderParameters,
    friction: FrictionLaw,
    *,
    load: LoadParameters | None = None,
    periods: int,
    initial_velocity: float = 0.0,
    initial_position: float = 0.0,
    record: bool = False,
) -> PeriodTable:
    """
    Solve the slider's motion over whole drive periods, with any law and load.

    Parameters
    ----------
    motion : HarmonicMotion
        Rod displacement.
    slider : SliderParameters
        Mass, inclination, constant outer forces.
    friction : FrictionLaw
        Friction law at the nominal contact force.
    load : LoadParameters, optional
        Spring, weight, end stops; none by default.
    periods : int
        Number of drive periods.
    initial_velocity, initial_position : float
        Of the slider at time 0 (m/s, m).
    record : bool
        Whether to keep the series, so that the motion can be sampled.

    Returns
    -------
    PeriodTable
        One row per period.

    Raises
    ------
    BadInputError
        If a number is out of bounds.
    SolverError
        If the events of a period have no end.

    """
    check_start(periods, initial_velocity, initial_position)
    load = load or LoadParameters.free()
    numbers = constants(slider.mass, friction.numbers, load.numbers)
    outer = slider.axial_force - slider.weight_along_rod
    rows = np.empty((6, periods))
    capacity = 0
    while True:
        steps = np.empty((capacity, _HEAD + ORDER + 1))
        count, failed, x, v = _solve(
            motion.period, *_rod_tables(motion), _longest_step(motion), numbers, outer,
            slider.friction_scale, initial_position, initial_velocity, rows, steps,
            series_workspace(ORDER, slider.mass), root_workspace(),
        )  # fmt: skip
        if failed >= 0:
            raise SolverError(f"the events of drive period {failed} have no end")
        if not record or count <= capacity:
            break
        capacity = count
    positive, negative, low, high, stick, force = rows
    period = motion.period
    # The rod returns after each period, so that what is left is the slip.
    mean = -(positive + negative) / period
    return PeriodTable(
        period=period,
        mean_velocity=mean,
        min_velocity=low,
        max_velocity=high,
        mean_relative_speed=(positive - negative) / period,
        stick_share=stick / period,
        mean_load_force=force / period,
        final_position=x,
        final_velocity=v,
        trajectory=_Steps(motion, steps[:count], periods) if record else None,
    )


def _rod_tables(motion: HarmonicMotion) -> tuple[Array, Array]:
    """Return velocity coefficients V_k (2, n) and (k omega)^j / j! (order + 1, n)."""
    k = np.arange(1, motion.harmonics + 1)
    omega = 2.0 * math.pi * motion.fundamental_frequency
    velocity = np.array(motion.amplitudes) * k * omega * np.exp(1j * np.array(motion.phases))
    powers = np.empty((ORDER + 1, k.size))
    powers[0] = 1.0
    for j in range(1, ORDER + 1):
        powers[j] = powers[j - 1] * k * omega / j
    return np.array([velocity.real, velocity.imag]), powers


def _longest_step(motion: HarmonicMotion) -> float:
    """Return the time (s) over which the rod's series holds wherever it starts."""
    k = np.arange(1, motion.harmonics + 1)
    speeds = np.abs(motion.amplitudes) * k
    shares = speeds / max(float(np.sum(speeds)), 1e-300) * (k / k[-1]) ** float(ORDER)
    # sum of shares (k_n omega h)^order / order! = tolerance
    log = (
        math.log(TOLERANCE) + math.lgamma(ORDER + 1) - math.log(max(float(np.sum(shares)), 1e-300))
    )
    return math.exp(log / ORDER) / (2.0 * math.pi * motion.max_frequency)


@njit(cache=True, error_model="numpy")
def _rod_series(theta: float, spectrum: Array, powers: Array, r: Array) -> None:
    """Fill Taylor coefficients of the rod velocity at a phase (rad), in time (s)."""
    r[:] = 0.0
    cos_1, sin_1 = math.cos(theta), math.sin(theta)
    cos_k, sin_k = cos_1, sin_1
    for i in range(spectrum.shape[1]):
        even = spectrum[0, i] * cos_k - spectrum[1, i] * sin_k
        odd = spectrum[0, i] * sin_k + spectrum[1, i] * cos_k
        j = 0
        while j < powers.shape[0]:
            # Each derivative turns cos into -sin: the signs repeat after four.
            r[j] += powers[j, i] * even
            if j + 1 < powers.shape[0]:
                r[j + 1] -= powers[j + 1, i] * odd
            even, odd = -even, -odd
            j += 2
        cos_k, sin_k = cos_k * cos_1 - sin_k * sin_1, sin_k * cos_1 + cos_k * sin_1


@njit(cache=True, error_model="numpy")
def _extremes(
    v: Array, order: int, length: float, low: float, high: float, test: Array, work: Array
) -> tuple[float, float]:
    """Widen (low, high) by the extremes of a polynomial on [0, length], ends included."""
    for value in (v[0], evaluate(v, order, length)):
        low, high = min(low, value), max(high, value)
    n = order - 1
    for k in range(order):
        test[k] = (k + 1) * v[k + 1]
    gone, first = 0.0, 0
    for _ in range(2 * order):
        if first == n:
            break
        root = first_root(test, first, n, length - gone, work)
        if not root <= length - gone:
            break
        gone += root
        value = evaluate(v, order, gone)
        low, high = min(low, value), max(high, value)
        # Go to the root and take it out.
        for i in range(n):
            for k in range(n - 1, i - 1, -1):
                test[k] += root * test[k + 1]
        test[0], first = 0.0, 1
    return low, high


@njit(cache=True, error_model="numpy")
def _solve(
    period: int,
    spectrum: Array,
    powers: Array,
    longest: float,
    p: Array,
    outer: float,
    scale: float,
    x: float,
    velocity: float,
    rows: Array,
    steps: Array,
    s: Array,
    work: Array,
) -> tuple[int, int, float, float]:
    """
    Fill one row per period; return number of steps, period that failed or -1, and x and v_S.

    Rows: integral over time of w where positive, where negative, extremes of v_S, time spent
    sticking, integral of the load force.
    """
    order = powers.shape[0] - 1
    omega = 2.0 * math.pi / period
    push, lift = (outer, 0.0), (scale, 0.0)
    r, test = np.zeros(order + 2), np.zeros(order + 2)
    _rod_series(0.0, spectrum, powers, r)
    w = r[0] - velocity
    stop = stop_state(x, velocity, p)
    mode = 1 if w > 0.0 else -1
    if w == 0.0:
        need = p[MASS] * r[1] + position_load(x, velocity, stop, p) - outer
        mode = decide(need, p[BREAK] * scale)
    known = 1 if w == 0.0 else 0
    count = 0
    for row in range(rows.shape[1]):
        positive, negative, stuck, force = 0.0, 0.0, 0.0, 0.0
        low, high = math.inf, -math.inf
        time, idle, is_over = 0.0, 0, False
        for _ in range(_MOST_STEPS):
            _rod_series(omega * time, spectrum, powers, r)
            before, x_before = mode, x
            gone, _event, mode, stop, known, w, x = advance(
                mode,
                stop,
                known,
                w,
                x,
                r,
                order,
                min(period - time, longest),
                push,
                lift,
                2.0 * TOLERANCE,
                p,
                s,
                work,
            )
            if gone > 0.0:
                if steps.shape[0] > count:
                    steps[count, 0], steps[count, 1], steps[count, 2] = row, time, before
                    steps[count, 3], steps[count, 4] = x_before, _event
                    for k in range(order + 1):
                        steps[count, _HEAD + k] = s[SLIDER_VELOCITY, k]
                count += 1
                slid = relative_distance(s, order, gone)
                if before > 0:
                    positive += slid
                elif before < 0:
                    negative += slid
                else:
                    stuck += gone
                force += load_impulse(s, order, gone)
                low, high = _extremes(s[SLIDER_VELOCITY], order, gone, low, high, test, work)
            is_over = time + gone >= period * (1.0 - 2e-16)
            idle = idle + 1 if time + gone == time else 0
            time += gone
            if is_over or idle > 40:
                break
        if not is_over:
            return count, row, x, 0.0
        rows[0, row], rows[1, row], rows[2, row], rows[3, row] = positive, negative, low, high
        rows[4, row], rows[5, row] = stuck, force
    _rod_series(0.0, spectrum, powers, r)
    return count, -1, x, r[0] - w


class _Steps:
    """The recorded series of a solution."""

    def __init__(self, motion: HarmonicMotion, steps: Array, periods: int) -> None:
        self._motion = motion
        self._periods = periods
        self._steps = steps
        self._turns = steps[:, 0] + steps[:, 1] / motion.period

    @property
    def step_times(self) -> Array:
        """Times (s) at which the steps begin; the motion is analytic between them."""
        return np.asarray(self._turns * self._motion.period)

    @property
    def event_times(self) -> Array:
        """Times (s) at which stretches of sticking or sliding begin."""
        mode = self._steps[:, 2]
        return np.asarray(self._turns[1:][mode[1:] != mode[:-1]] * self._motion.period)

    def sample(self, time: ArrayLike) -> SliderMotion:
        """Return the motion at the times (s) since the start."""
        times = check_times(time, self._periods * self._motion.period)
        turns = times / self._motion.period
        index = np.clip(np.searchsorted(self._turns, turns, side="right") - 1, 0, None)
        step = self._steps[index]
        local = (turns - self._turns[index]) * self._motion.period
        velocity, position = np.zeros_like(local), np.zeros_like(local)
        for k in range(ORDER, -1, -1):
            velocity = velocity * local + step[..., _HEAD + k]
            position = position * local + step[..., _HEAD + k] / (k + 1)
        return SliderMotion(
            times,
            position * local + step[..., 3],
            velocity,
            self._motion.velocity(times),
            step[..., 2] == 0.0,
        )

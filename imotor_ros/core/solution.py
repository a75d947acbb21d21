"""What the continuous-time solvers return: one row per drive period, and its summary."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.regression import start_up_time
from imotor_ros.errors import BadInputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SliderMotion:
    """
    The motion at chosen times; arrays of the shape of the times.

    Attributes
    ----------
    time : ndarray
        The times (s).
    position, velocity : ndarray
        Of the slider (m, m/s).
    rod_velocity : ndarray
        Velocity of the rod (m/s).
    is_sticking : ndarray of bool
        Whether the slider sticks.

    """

    time: Array
    position: Array
    velocity: Array
    rod_velocity: Array
    is_sticking: NDArray[np.bool_]


class Trajectory(Protocol):
    """A recorded solution that can be looked at at any time."""

    @property
    def event_times(self) -> Array:
        """Times (s) at which stretches of sticking or sliding begin."""

    def sample(self, time: ArrayLike) -> SliderMotion:
        """Return the motion at the times (s) since the start."""


@dataclass(frozen=True)
class PeriodTable:
    """
    The solution by drive periods; arrays of shape (periods,).

    Attributes
    ----------
    period : float
        Drive period (s).
    mean_velocity, min_velocity, max_velocity : ndarray
        Of the slider in each period (m/s).
    mean_relative_speed : ndarray
        Mean of |v_R - v_S| (m/s).
    stick_share : ndarray
        Part of the period spent sticking.
    mean_load_force : ndarray
        Mean load force (N), positive along -x.
    final_position, final_velocity : float
        Of the slider at the end of the last period (m, m/s).
    trajectory : Trajectory or None
        The motion within the periods, if it was asked for.

    """

    period: float
    mean_velocity: Array
    min_velocity: Array
    max_velocity: Array
    mean_relative_speed: Array
    stick_share: Array
    mean_load_force: Array
    final_position: float
    final_velocity: float
    trajectory: Trajectory | None = field(default=None, repr=False)

    @property
    def periods(self) -> int:
        """Number of periods."""
        return int(self.mean_velocity.size)


def check_start(periods: int, initial_velocity: float, initial_position: float = 0.0) -> None:
    """Refuse a number of periods or a start that no solver can use."""
    if not isinstance(periods, int) or periods < 1:
        raise BadInputError("is out of bounds", where="periods", value=periods, bound=">= 1")
    for name, value in (("velocity", initial_velocity), ("position", initial_position)):
        if not math.isfinite(value):
            raise BadInputError("is not finite", where=f"initial_{name}", value=value)


def check_times(time: ArrayLike, end: float) -> Array:
    """Return the times as an array; refuse those before 0 or after `end` (s)."""
    times = np.asarray(time, dtype=np.float64)
    if times.size and not (times.min() >= 0.0 and times.max() <= end * (1.0 + 1e-12)):
        raise BadInputError(
            "lies outside the solution",
            where="time",
            value=(float(times.min()), float(times.max())),
            bound=f"0 to {end:g} s",
        )
    return times


@dataclass(frozen=True)
class Summary:
    """
    Performance over the last quarter of the periods, from rest.

    A value that does not exist is NaN, and `reasons` says why, under the name of the field.

    Attributes
    ----------
    mean_velocity : float
        Steady-state velocity (m/s).
    ripple : float
        (max - min) / |mean| of the slider velocity, equation (10).
    start_up_time : float
        t_0.99 or t_1.01 (s), see `regression.start_up_time`.
    durability : float
        F_c delta = |mean v_S| / mean |v_R - v_S|, section 6.
    force : float
        Mean load force (N) on spring, weight or end stops.
    is_steady : bool
        True if the two halves of the last quarter agree, in velocity and load force.
    reasons : dict of str to str
        Why a value is missing, or what is to be said of it.

    """

    mean_velocity: float
    ripple: float
    start_up_time: float
    durability: float
    force: float
    is_steady: bool
    reasons: dict[str, str]


STEADY_TOLERANCE = 1e-4
"""Relative difference of the halves of the last quarter that still counts as steady."""


def summarise(table: PeriodTable, *, has_load: bool) -> Summary:
    """
    Return the performance over the last quarter of the periods.

    Parameters
    ----------
    table : PeriodTable
        The solution from rest.
    has_load : bool
        Whether there is a load whose force is worth reporting.

    Raises
    ------
    BadInputError
        If there are no periods.

    """
    if table.periods < 1:
        raise BadInputError("is too small", where="periods", value=table.periods, bound=">= 1")
    last = slice(table.periods - max(table.periods // 4, 1), None)
    means = table.mean_velocity[last]
    mean = float(means.mean())
    speed = float(table.mean_relative_speed[last].mean())
    reasons: dict[str, str] = {}
    # What is left after whole strides of the rod cancel is rounding, not motion.
    moves = abs(mean) > 1e-9 * max(speed, float(np.max(np.abs(table.max_velocity[last]))))
    ripple = durability = start_up = math.nan
    if moves:
        ripple = float(table.max_velocity[last].max() - table.min_velocity[last].min()) / abs(mean)
    else:
        reasons["ripple"] = "the slider does not move on the average"
    if speed > 0.0:
        durability = abs(mean) / speed if moves else 0.0
        if not moves:
            reasons["durability"] = "the slider does not move on the average"
    else:
        reasons["durability"] = "the slider never slides"
    force = float(table.mean_load_force[last].mean()) if has_load else math.nan
    if not has_load:
        reasons["force"] = "there is no load"
    is_steady = _is_steady(means, max(abs(mean), 1e-4 * speed)) and (
        not has_load or _is_steady(table.mean_load_force[last], abs(force))
    )
    if not is_steady:
        reasons["mean_velocity"] = "not steady yet: the last quarter of the periods still changes"
    if not moves:
        reasons["start_up_time"] = "the slider does not move on the average"
    else:
        start_up_result = start_up_time(table.mean_velocity, table.period)
        start_up = start_up_result.value
        if start_up_result.reason:
            reasons["start_up_time"] = start_up_result.reason
        elif start_up_result.is_bound:
            reasons["start_up_time"] = "an upper bound: steady from that period on"
    return Summary(mean, ripple, start_up, durability, force, is_steady, reasons)


def _is_steady(values: Array, scale: float) -> bool:
    half = values.size // 2
    if half == 0:
        return False
    return abs(float(values[:half].mean() - values[-half:].mean())) <= STEADY_TOLERANCE * scale

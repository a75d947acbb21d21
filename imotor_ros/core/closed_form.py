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

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.closed_form_kernels import decay_arrays, solve
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.period_case import TURN, PeriodCase, integrated, tabulate
from imotor_ros.core.phases import trigonometric_value
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.solution import PeriodTable, SliderMotion, check_start, check_times
from imotor_ros.errors import BadInputError, SolverError

Array = NDArray[np.float64]


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
    until_steady: bool = False,
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
    until_steady : bool
        Whether to solve only until a period ends as it began, to rounding: all periods after it
        are taken to be the same. Not with `record`.

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
    if not applies(friction, load):
        raise BadInputError(
            "has no closed form",
            where="friction, load",
            value=(type(friction).__name__, load),
            bound="a straight friction law and no spring or end stops",
        )
    check_start(periods, initial_velocity)
    case = tabulate(motion, slider, friction, load)
    rows, final_velocity, segments = _run(
        case, periods, initial_velocity, record, until_steady and not record
    )
    positive, negative, low, high, stick = rows
    # The rod returns after each period, so that the slip is what is left.
    mean = -(positive + negative) / TURN
    return PeriodTable(
        period=motion.period,
        mean_velocity=mean,
        min_velocity=low,
        max_velocity=high,
        mean_relative_speed=(positive - negative) / TURN,
        stick_share=stick / TURN,
        mean_load_force=np.full(periods, load.constant_force if load else 0.0),
        final_position=float(np.sum(mean)) * motion.period,
        final_velocity=final_velocity,
        trajectory=_Segments(case, segments, periods) if record else None,
    )


def _run(
    case: PeriodCase, periods: int, initial_velocity: float, record: bool, until_steady: bool
) -> tuple[Array, float, Array]:
    """Return the rows of the periods, the final slider velocity, and the stretches if wanted."""
    most = max(table.knots.size for table in case.sliding)
    arguments = (
        case.decay,
        case.levels,
        case.turns_while_sliding,
        np.array([case.velocity.real, case.velocity.imag, case.response.real, case.response.imag]),
        np.array([table.knots.size for table in case.sliding]),
        # Both signs in one array each, padded to equal length.
        *(
            np.array([_padded(values, most) for values in pair])
            for pair in zip(*case.sliding, strict=True)
        ),
        np.array([_padded(_region_of(case.regions, table.knots), most) for table in case.sliding]),
        case.regions,
        case.region_sides,
        case.exit_gaps,
        case.exit_values,
        case.rests,
        case.rest_velocities,
        initial_velocity,
        until_steady,
    )
    rows = np.empty((5, periods))
    capacity = 6 * periods if record else 0
    while True:
        segments = np.empty((capacity, 4))
        count, final_velocity = solve(*arguments, rows, segments)
        if count < 0:
            raise SolverError("the closed form found no end of a period's events")
        if count <= capacity:
            return rows, float(final_velocity), segments[:count]
        capacity = count


def _padded(values: NDArray[np.generic], length: int) -> NDArray[np.generic]:
    padded = np.zeros((length, *values.shape[1:]), dtype=values.dtype)
    padded[: values.shape[0]] = values
    return padded


def _region_of(regions: Array, phases: Array) -> NDArray[np.int64]:
    """Return in which region each phase lies; one on an edge belongs to the region after it."""
    found = np.searchsorted(regions, phases, side="right") - 1
    return np.clip(found, 0, regions.size - 2).astype(np.int64)


class _Segments:
    """The recorded stretches of a solution, from which the motion at any time follows."""

    def __init__(self, case: PeriodCase, segments: Array, periods: int) -> None:
        self._case = case
        self._periods = periods
        self._period, self._theta, self._mode, self._w = segments.T
        self._turns = self._period + self._theta / TURN
        ends = np.append(self._theta[1:], TURN)
        ends[ends == 0.0] = TURN
        slid = self._slid(np.arange(ends.size), ends)[1]
        self._slid_before = np.concatenate([[0.0], np.cumsum(slid)[:-1]])

    @property
    def event_times(self) -> Array:
        """Times (s) at which stretches of sticking or sliding begin."""
        return np.asarray(self._turns[self._theta > 0.0] * TURN / self._case.omega)

    def sample(self, time: ArrayLike) -> SliderMotion:
        """Return the motion at the times (s) since the start."""
        case = self._case
        times = check_times(time, self._periods * TURN / case.omega)
        turns = times * (case.omega / TURN)
        index = np.clip(np.searchsorted(self._turns, turns, side="right") - 1, 0, None)
        theta = (turns - self._period[index]) * TURN
        w, slid = self._slid(index, theta)
        rod_velocity = trigonometric_value(case.velocity, theta)
        travel = integrated(case.velocity)
        distance = trigonometric_value(travel, theta) - travel.real.sum()
        position = (distance - self._slid_before[index] - slid) / case.omega
        return SliderMotion(
            times, position, rod_velocity - w, rod_velocity, np.asarray(self._mode[index] == 0)
        )

    def _slid(self, index: NDArray[np.int64], theta: Array) -> tuple[Array, Array]:
        """Return w and its integral over the phase since the start of segment `index`."""
        case, start, mode = self._case, self._theta[index], self._mode[index]
        h, total = case.response, integrated(case.response)
        distance = trigonometric_value(total, theta) - trigonometric_value(total, start)
        rest = self._w[index] - trigonometric_value(h, start)
        level = np.where(mode > 0, *case.levels)
        left, first, second = decay_arrays(case.decay, theta - start)
        w = trigonometric_value(h, theta) - level * first + rest * left
        slid = distance - level * second + rest * first
        return np.where(mode == 0, 0.0, w), np.where(mode == 0, 0.0, slid)

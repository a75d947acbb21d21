"""What the model of the motor predicts for an ideal rod motion, without instruments."""

from __future__ import annotations

from dataclasses import dataclass

from imotor_ros.core import closed_form, sampled, taylor
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.solution import PeriodTable, summarise

PERIODS = 4000
"""Drive periods by default: ten times what the slowest point of figure 12 takes to settle."""


@dataclass(frozen=True)
class Prediction:
    """
    Indicators of section 6, over the last quarter of the periods.

    A value that does not exist is None. `reasons` says why, and what else is to be said of a
    value, under the name of the field.

    Attributes
    ----------
    mean_velocity : float
        Steady-state velocity (m/s).
    ripple : float or None
        (max - min) / |mean| of the slider velocity, equation (10).
    start_up_time : float or None
        t_0.99 or t_1.01 (s) from an exponential regression, `regression.start_up_time`.
    durability : float or None
        F_c delta = |mean v_S| / mean |v_R - v_S|.
    force : float or None
        Mean load force (N); None without a load.
    is_steady : bool
        Whether the last quarter is steady.
    periods : int
        Number of drive periods solved.
    solver : str
        "closed_form", "taylor" or "stepping".
    reasons : dict of str to str
        See above.

    """

    mean_velocity: float
    ripple: float | None
    start_up_time: float | None
    durability: float | None
    force: float | None
    is_steady: bool
    periods: int
    solver: str
    reasons: dict[str, str]


def predict(
    motion: HarmonicMotion,
    slider: SliderParameters,
    friction: FrictionLaw,
    load: LoadParameters | None = None,
    periods: int = PERIODS,
    sample_rate: float | None = None,
) -> Prediction:
    """
    Predict the indicators of a motor that starts from rest.

    Parameters
    ----------
    motion : HarmonicMotion
        Rod displacement.
    slider : SliderParameters
        Mass, inclination, constant outer forces.
    friction : FrictionLaw
        Friction law at the nominal contact force.
    load : LoadParameters, optional
        Spring, weight, end stops; by default none at all.
    periods : int
        Number of drive periods.
    sample_rate : float, optional
        With it, the sampled solver of the virtual plant at so many samples per second (Hz);
        without it, the closed form where there is one, else power series.

    Returns
    -------
    Prediction
        Over the last quarter of the periods.

    Raises
    ------
    BadInputError
        If a number is out of bounds.
    SolverError
        If a solver cannot go on.

    """
    table, solver = _solve(motion, slider, friction, load, periods, sample_rate)
    has_load = load is not None and (load.numbers.depends_on_position or load.constant_force != 0.0)
    found = summarise(table, has_load=has_load)
    return Prediction(
        mean_velocity=found.mean_velocity,
        ripple=_or_none(found.ripple),
        start_up_time=_or_none(found.start_up_time),
        durability=_or_none(found.durability),
        force=_or_none(found.force),
        is_steady=found.is_steady,
        periods=periods,
        solver=solver,
        reasons=found.reasons,
    )


def _solve(
    motion: HarmonicMotion,
    slider: SliderParameters,
    friction: FrictionLaw,
    load: LoadParameters | None,
    periods: int,
    sample_rate: float | None,
) -> tuple[PeriodTable, str]:
    if sample_rate is not None:
        table = sampled.simulate(
            motion, slider, friction, load=load, periods=periods, sample_rate=sample_rate
        )
        return table, "stepping"
    if closed_form.applies(friction, load):
        table = closed_form.simulate(
            motion, slider, friction, load=load, periods=periods, until_steady=True
        )
        return table, "closed_form"
    return taylor.simulate(motion, slider, friction, load=load, periods=periods), "taylor"


def _or_none(value: float) -> float | None:
    return None if value != value else value

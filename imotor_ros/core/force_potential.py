"""
How much force a motor can generate, as its model has it: against springs and under weights.

Section 6 of the paper: the mean force of a slider that runs against a spring does not depend on
the stiffness of the spring as long as it is soft (figure 11). The velocity under a constant force
falls from that of the free run to zero at the stall force.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.model import predict
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.errors import BadInputError

STIFFNESSES = tuple(float(k) for k in np.logspace(2, 8, 25))
"""Stiffnesses (N/m) of a sweep by default: far softer to far stiffer than any load of a motor."""

DROP = 0.05
"""Share of the plateau by which the force has fallen at the critical stiffness; figure 11."""

_FEWEST_PERIODS = 500
_MOST_PERIODS = 32_000
_FLATNESS = 0.01
_MEASURED_FLATNESS = 0.03
_FEWEST_ON_PLATEAU = 3

# Stiffer than any spring or stop: slider and rod themselves have some 1e8 N/m.
_STIFFEST = 1e9
_REFINEMENTS = 24
_BISECTIONS = 30


@dataclass(frozen=True)
class SpringForce:
    """
    The steady mean force on a spring.

    Attributes
    ----------
    stiffness : float
        Of the spring (N/m).
    force : float
        Mean spring force (N).
    is_steady : bool
        Whether it has settled.
    periods : int
        Drive periods from rest that were solved, the last quarter of which is averaged.

    """

    stiffness: float
    force: float
    is_steady: bool
    periods: int


@dataclass(frozen=True)
class Estimate:
    """A value with its standard uncertainty (same unit); NaN, and a reason, if there is none."""

    value: float = math.nan
    uncertainty: float = math.nan
    reason: str = ""


@dataclass(frozen=True)
class SpringSweep:
    """
    Mean force over stiffness, figure 11.

    Attributes
    ----------
    forces : tuple of SpringForce
        By rising stiffness.
    plateau : Estimate
        Force (N) against soft springs.
    critical_stiffness : Estimate
        Lowest stiffness (N/m) at which the force is 5 % below the plateau.

    """

    forces: tuple[SpringForce, ...]
    plateau: Estimate
    critical_stiffness: Estimate


@dataclass(frozen=True)
class VelocityForceCurve:
    """
    Velocity over a constant load, from free run to stall; arrays of one length.

    Attributes
    ----------
    load_force, mean_velocity : tuple of float
        Load (N) and steady mean velocity (m/s).
    is_steady : tuple of bool
        Whether the velocity has settled.
    stall_force : Estimate
        Smallest load (N) under which the slider makes no headway.

    """

    load_force: tuple[float, ...]
    mean_velocity: tuple[float, ...]
    is_steady: tuple[bool, ...]
    stall_force: Estimate


def spring_force(
    motion: HarmonicMotion,
    slider: SliderParameters,
    friction: FrictionLaw,
    stiffness: float,
    *,
    pushes_only: bool = False,
) -> SpringForce:
    """
    Return the steady mean force of a slider that starts from rest at a relaxed spring.

    Parameters
    ----------
    motion, slider, friction
        The motor.
    stiffness : float
        Of the spring (N/m).
    pushes_only : bool
        Whether the slider may leave it, as it may leave an end stop; otherwise it pulls as well.

    Raises
    ------
    BadInputError
        If the stiffness is not positive.

    """
    if not 0.0 < stiffness <= _STIFFEST:
        raise BadInputError(
            "is out of bounds", where="stiffness", value=stiffness,
            bound=f"> 0 and <= {_STIFFEST:g} N/m",
        )  # fmt: skip
    load = LoadParameters.free().replace(spring_stiffness=float(stiffness))
    if pushes_only:
        load = LoadParameters(
            upper_stop=0.0, lower_stop=-1.0, stop_stiffness=float(stiffness), stop_damping=0.0
        )
    periods = _FEWEST_PERIODS
    while True:
        found = predict(motion, slider, friction, load, periods)
        if found.is_steady or periods >= _MOST_PERIODS:
            assert found.force is not None
            return SpringForce(float(stiffness), found.force, found.is_steady, periods)
        periods *= 2


def sweep_springs(
    motion: HarmonicMotion,
    slider: SliderParameters,
    friction: FrictionLaw,
    stiffnesses: ArrayLike = STIFFNESSES,
    *,
    pushes_only: bool = False,
) -> SpringSweep:
    """
    Return the mean spring force over stiffness, its plateau, and where that ends.

    Parameters
    ----------
    motion, slider, friction
        The motor.
    stiffnesses : array_like, shape (n,)
        Stiffnesses (N/m), the lowest of which should be on the plateau.
    pushes_only : bool
        See `spring_force`.

    Raises
    ------
    BadInputError
        If a stiffness is not positive, or there is none.

    Notes
    -----
    The plateau is the median of the softest springs as far as their forces agree to 1 %; its
    uncertainty is half their range. The critical stiffness is refined between the first two
    stiffnesses that enclose it; its uncertainty is what remains of that interval, and that of
    the plateau over the slope of the force. At the resonance of slider and spring, where the
    stiffness is the mass times the square of 2 pi f_1, the force has a narrow gap, which a coarse
    sweep may or may not meet.

    """
    values = np.unique(np.atleast_1d(np.asarray(stiffnesses, dtype=np.float64)))
    if values.size == 0:
        raise BadInputError("is empty", where="stiffnesses")

    def force_on(stiffness: float) -> SpringForce:
        return spring_force(motion, slider, friction, stiffness, pushes_only=pushes_only)

    forces = [force_on(float(k)) for k in values]
    plateau = find_plateau(forces)
    critical = _critical_stiffness(force_on, forces, plateau)
    return SpringSweep(tuple(forces), plateau, critical)


def find_plateau(forces: Sequence[SpringForce], flatness: float = _FLATNESS) -> Estimate:
    """Return the force on the softest springs, given by rising stiffness; see `sweep_springs`."""
    flat: list[float] = []
    for one in forces:
        if not one.is_steady:
            continue
        longer = [*flat, one.force]
        if max(longer) - min(longer) > flatness * abs(float(np.mean(longer))):
            break
        flat = longer
    if len(flat) < _FEWEST_ON_PLATEAU:
        return Estimate(
            reason=f"the forces on {len(flat)} of the softest springs agree within {flatness:.0%}, "
            f"at least {_FEWEST_ON_PLATEAU} are needed: give more or softer ones"
        )
    return Estimate(float(np.median(flat)), 0.5 * (max(flat) - min(flat)))


@dataclass(frozen=True)
class MeasuredForce:
    """The mean force (N) that was measured on a spring of a stiffness (N/m)."""

    stiffness: float
    force: Estimate


def evaluate_measured(forces: Sequence[MeasuredForce]) -> tuple[Estimate, Estimate]:
    """
    Return plateau (N) and critical stiffness (N/m) of forces that were measured.

    Parameters
    ----------
    forces : sequence of MeasuredForce
        By rising stiffness; those without a value count as not measured.

    Notes
    -----
    The plateau is the median of the softest springs as far as their forces agree to 3 %, with
    half their range and the median of their own uncertainties. The critical stiffness is
    interpolated, over the logarithm, between the first two stiffnesses that enclose it. The
    force's calibration, common to all, is in its uncertainty although it cancels.

    """
    found = [one for one in forces if not one.force.reason]
    plain = [SpringForce(one.stiffness, one.force.value, True, 0) for one in found]
    plateau = find_plateau(plain, _MEASURED_FLATNESS)
    if plateau.reason:
        return plateau, Estimate(reason=f"there is no plateau: {plateau.reason}")
    own = float(np.median([one.force.uncertainty for one in found]))
    plateau = Estimate(plateau.value, math.hypot(plateau.uncertainty, own))
    limit = (1.0 - DROP) * plateau.value
    below = next((i for i, one in enumerate(found) if one.force.value < limit), 0)
    if below == 0:
        return plateau, Estimate(
            reason=f"up to {found[-1].stiffness:.3g} N/m no force is {DROP:.0%} below the plateau"
        )
    low, high = found[below - 1], found[below]
    drop, width = low.force.value - high.force.value, math.log(high.stiffness / low.stiffness)
    share = (low.force.value - limit) / drop
    doubt = math.hypot(high.force.uncertainty, (1.0 - DROP) * plateau.uncertainty) / drop
    value = low.stiffness * math.exp(share * width)
    # where between the two it lies is as uncertain as the forces, and as the curve is unknown
    return plateau, Estimate(value, value * width * min(math.hypot(doubt, 12.0**-0.5), 1.0))


def _critical_stiffness(
    force_on: Callable[[float], SpringForce],
    forces: Sequence[SpringForce],
    plateau: Estimate,
) -> Estimate:
    if plateau.reason:
        return Estimate(reason=f"there is no plateau: {plateau.reason}")
    limit = (1.0 - DROP) * plateau.value
    below = next((i for i, one in enumerate(forces) if one.is_steady and one.force < limit), 0)
    if below == 0:
        return Estimate(
            reason=f"up to {forces[-1].stiffness:.3g} N/m the force never is {DROP:.0%} below "
            "the plateau"
        )
    low, high = forces[below - 1], forces[below]
    slope = (high.force - low.force) / (high.stiffness - low.stiffness)
    for _ in range(_REFINEMENTS):
        middle = force_on(math.sqrt(low.stiffness * high.stiffness))
        if middle.force < limit:
            high = middle
        else:
            low = middle
        # the local slope, as long as the two forces are well apart
        if abs(high.force - low.force) > _FLATNESS * plateau.value:
            slope = (high.force - low.force) / (high.stiffness - low.stiffness)
        if high.stiffness - low.stiffness < 1e-4 * high.stiffness:
            break
    width = (high.stiffness - low.stiffness) / math.sqrt(12.0)
    doubt = (1.0 - DROP) * plateau.uncertainty / abs(slope)
    return Estimate(0.5 * (low.stiffness + high.stiffness), math.hypot(width, doubt))


def velocity_force_curve(
    motion: HarmonicMotion, slider: SliderParameters, friction: FrictionLaw, points: int = 11
) -> VelocityForceCurve:
    """
    Return the velocity over a constant load, from none to the stall force.

    Parameters
    ----------
    motion, slider, friction
        The motor.
    points : int
        Number of loads, at least 2.

    Raises
    ------
    BadInputError
        If there are too few points.

    """
    if points < 2:
        raise BadInputError("is out of bounds", where="points", value=points, bound=">= 2")

    def velocity(force: float) -> tuple[float, bool]:
        load = LoadParameters.free().replace(constant_force=float(force))
        found = predict(motion, slider, friction, load)
        return found.mean_velocity, found.is_steady

    free, free_is_steady = velocity(0.0)
    # rounding lets a symmetric drive creep
    if free <= 1e-6 * motion.stroke * motion.fundamental_frequency:
        reason = f"the free slider does not move forward: {free:.3g} m/s"
        return VelocityForceCurve((0.0,), (free,), (free_is_steady,), Estimate(reason=reason))
    low, high = 0.0, float(friction.break_away) * slider.friction_scale
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        # rounding leaves a slider at rest some velocity
        low, high = (middle, high) if velocity(middle)[0] > 1e-9 * free else (low, middle)
    loads = np.linspace(0.0, high, points)
    found = [velocity(float(force)) for force in loads]
    return VelocityForceCurve(
        tuple(map(float, loads)),
        tuple(v for v, _ in found),
        tuple(steady for _, steady in found),
        Estimate(high, (high - low) / math.sqrt(12.0)),
    )

"""How much force a motor generates, as a campaign: springs, weights and an end stop."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from imotor_ros.campaign.campaign import Campaign, NamedPoint
from imotor_ros.campaign.plan import drive_program
from imotor_ros.campaign.point import DriveParameters, PointParameters
from imotor_ros.campaign.results import PointResult
from imotor_ros.core.force_potential import (
    Estimate,
    MeasuredForce,
    evaluate_measured,
    velocity_force_curve,
)
from imotor_ros.core.friction import FrictionLaw, VelocityDependentFriction
from imotor_ros.core.model import predict
from imotor_ros.core.motor import VirtualMotor
from imotor_ros.core.slider import LoadParameters
from imotor_ros.errors import BadInputError

STIFFNESSES = (3e2, 1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 1e6)
"""Stiffnesses (N/m) that are measured by default."""

_SHORTEST_HOLD = 0.08
_FEWEST_PERIODS = 100
_TIME_CONSTANTS = 8.0
_LARGEST_SHARE_OF_STALL = 0.95


@dataclass(frozen=True)
class MeasuredVelocity:
    """The steady velocity (m/s) that was measured under a constant load (N)."""

    load_force: float
    velocity: Estimate


@dataclass(frozen=True)
class ForcePotential:
    """
    What was measured.

    Attributes
    ----------
    springs : tuple of MeasuredForce
        By rising stiffness, figure 11.
    plateau, critical_stiffness : Estimate
        Force (N) on soft springs, and stiffness (N/m) at which it is 5 % lower.
    characteristic : tuple of MeasuredVelocity
        By rising load.
    stop_force : Estimate
        Force (N) against an end stop.

    """

    springs: tuple[MeasuredForce, ...]
    plateau: Estimate
    critical_stiffness: Estimate
    characteristic: tuple[MeasuredVelocity, ...]
    stop_force: Estimate


def force_campaign(
    base: PointParameters, stiffnesses: Sequence[float] = STIFFNESSES, loads: int = 6
) -> Campaign:
    """
    Return the campaign that measures the force of an operating point.

    One run for each spring, into which the slider runs after a steady free run; one for each of
    the constant loads from none to 95 % of the stall force that friction model 2 predicts; and
    one against an end stop. How long they take follows from the same model. A spring is an end
    stop of its stiffness without damping: it pushes only.

    Parameters
    ----------
    base : PointParameters
        Signal, motor and instruments; load and hold time are replaced.
    stiffnesses : sequence of float
        Of the springs (N/m).
    loads : int
        Number of constant loads, at least 2.

    Raises
    ------
    BadInputError
        If a number cannot be used, or the model does not move forward.

    """
    if not stiffnesses:
        raise BadInputError("is empty", where="stiffnesses")
    for one in stiffnesses:
        if not (math.isfinite(one) and one > 0.0):
            raise BadInputError("is out of bounds", where="stiffness", value=one, bound="> 0 N/m")
    motion, slider = base.signal.motion, base.stand.motor.slider
    law = cast("FrictionLaw", VelocityDependentFriction())
    curve = velocity_force_curve(motion, slider, law, max(loads, 2))
    if loads < 2:
        raise BadInputError("is out of bounds", where="points", value=loads, bound=">= 2")
    if curve.stall_force.reason:
        raise BadInputError(curve.stall_force.reason, where="signal")
    stall, free = curve.stall_force.value, curve.mean_velocity[0]
    start_up = predict(motion, slider, law).start_up_time or 0.0
    hold = max(_SHORTEST_HOLD, _FEWEST_PERIODS * motion.period, _TIME_CONSTANTS * start_up)
    rest = rest_position(base)
    none = LoadParameters.free()
    points = []
    reach = rest + free * hold
    for k in sorted(set(stiffnesses)):
        # a stop without damping is a spring that pushes only, and may stand in the slider's way
        load = LoadParameters(upper_stop=reach, stop_stiffness=k, stop_damping=0.0)
        settling = _TIME_CONSTANTS * stall / free / k
        points.append(_point(base, f"k{k:.4g}", load, 2.0 * hold + settling))
    for i in range(loads):
        force = _LARGEST_SHARE_OF_STALL * stall * i / (loads - 1)
        points.append(_point(base, f"f{force:.4g}", none.replace(constant_force=force), hold))
    points.append(_point(base, "stop", LoadParameters(upper_stop=reach), 2.0 * hold))
    return Campaign("force", "force over stiffness, and velocity over load", tuple(points))


def rest_position(base: PointParameters) -> float:
    """Return where the slider stands once the voltage has reached its offset (m)."""
    program = drive_program(base, "rest")
    motor = VirtualMotor(
        base.stand.motor.replace(load=LoadParameters.free()), program.sample_rate, base.seed
    )
    _, end = program.span("bias")
    return float(motor.process(program.render(0, max(end, 1))).slider_position[-1])


def _point(base: PointParameters, name: str, load: LoadParameters, hold: float) -> NamedPoint:
    drive = cast("DriveParameters", base.drive).replace(hold_time=hold)
    motor = base.stand.motor.replace(load=load)
    # in a folder's name, "1e+05" reads like a sum
    return NamedPoint(
        name.replace("e+0", "e"), base.replace(drive=drive, stand=base.stand.replace(motor=motor))
    )


def evaluate_results(campaign: Campaign, results: Sequence[PointResult]) -> ForcePotential:
    """Return what the results of a campaign of `force_campaign` say."""
    springs, characteristic = [], []
    stop_force = Estimate(reason="no run against an end stop")
    found: Mapping[str, PointResult] = {one.name: one for one in results}
    for point in campaign.points:
        load, result = point.parameters.stand.motor.load, found[point.name]
        if load.stop_stiffness > 0.0 and load.stop_damping == 0.0:
            springs.append(MeasuredForce(load.stop_stiffness, _estimate(result, "force")))
        elif load.stop_stiffness > 0.0:
            stop_force = _estimate(result, "force")
        else:
            velocity = _estimate(result, "mean_velocity")
            characteristic.append(MeasuredVelocity(load.constant_force, velocity))
    plateau, critical = evaluate_measured(springs)
    return ForcePotential(tuple(springs), plateau, critical, tuple(characteristic), stop_force)


def _estimate(result: PointResult, name: str) -> Estimate:
    if result.performance is None:
        return Estimate(reason=result.error)
    indicator = result.performance.indicator(name)
    return Estimate(indicator.value, indicator.uncertainty, indicator.reason)

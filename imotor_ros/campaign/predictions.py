"""What the two models of the paper predict for a point, beside what was measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from imotor_ros.campaign.point import DriveParameters, PointParameters
from imotor_ros.core.excitation import voltage_for_motion
from imotor_ros.core.friction import CoulombFriction, FrictionLaw, VelocityDependentFriction
from imotor_ros.core.model import predict
from imotor_ros.core.motor import VirtualMotor
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.errors import SolverError

MODELS: dict[str, FrictionLaw] = {
    "model_1": CoulombFriction(),
    "model_2": VelocityDependentFriction(),
}
"""Friction model 1, equation (9), and model 2, equation (8), as the paper identified them."""

_PREDICTED = ("mean_velocity", "start_up_time", "ripple", "durability", "force")


def predict_point(
    parameters: PointParameters, laws: Mapping[str, FrictionLaw] = MODELS
) -> dict[str, dict[str, Any]]:
    """
    Return what each model predicts for a point.

    The rod moves as wanted, without ramp. Velocity, ripple, start-up and durability are those
    of the free slider; the force is that against the end stop in its way, if there is one. The
    power follows from the wanted voltage and the current of the linear stator.

    Parameters
    ----------
    parameters : PointParameters
        The point.
    laws : mapping
        Friction law by model, by default those of the paper.

    Returns
    -------
    dict
        By model: value or None by indicator (SI), and "reasons" why one is None. Empty where
        the run is not driven by the point's signal.

    """
    if not isinstance(parameters.drive, DriveParameters):
        return {}
    motion = parameters.signal.motion
    motor = parameters.stand.motor
    power = apparent_power(parameters, motion)
    result = {}
    for name, friction in laws.items():
        free = _predict(motion, motor.slider, friction, _without_stops(motor.load))
        velocity = free["mean_velocity"]
        free["efficiency"] = None if velocity is None else velocity / power
        stopped = _against_stop(motor.load)
        if stopped is not None:
            pushing = _predict(motion, motor.slider, friction, stopped)
            free["force"] = pushing["force"]
            free["reasons"].pop("force", None)
            free["reasons"].update({k: v for k, v in pushing["reasons"].items() if k == "force"})
        result[name] = free
    return result


def _predict(
    motion: HarmonicMotion, slider: SliderParameters, friction: FrictionLaw, load: LoadParameters
) -> dict[str, Any]:
    """Return values and reasons; a solver that fails is a reason, for the run was measured."""
    try:
        found = predict(motion, slider, friction, load)
    except SolverError as error:
        return {**dict.fromkeys(_PREDICTED), "reasons": dict.fromkeys(_PREDICTED, str(error))}
    return {**{key: getattr(found, key) for key in _PREDICTED}, "reasons": dict(found.reasons)}


def apparent_power(parameters: PointParameters, motion: HarmonicMotion) -> float:
    """
    Return the amplitude of the complex power (V A) that a motion asks for, DC left out.

    U_rms * I_rms over all harmonics, with the current of the linear stator.
    """
    stand = parameters.stand
    motor = VirtualMotor(stand.motor, stand.sample_rate, parameters.seed)
    amplitudes, _ = voltage_for_motion(motion, motor.displacement_response)
    orders = np.arange(1, motion.harmonics + 1)
    admittances = np.abs(motor.current_response(orders * motion.fundamental_frequency))
    voltages = np.asarray(amplitudes)
    voltage = math.sqrt(0.5 * float(np.sum(voltages**2)))
    current = math.sqrt(0.5 * float(np.sum((admittances * voltages) ** 2)))
    return voltage * current


def _without_stops(load: LoadParameters) -> LoadParameters:
    return load.replace(stop_stiffness=0.0)


def _against_stop(load: LoadParameters) -> LoadParameters | None:
    """Return the load of a slider that is at the upper stop from the start."""
    if load.stop_stiffness == 0.0:
        return None
    return load.replace(upper_stop=0.0, lower_stop=min(load.lower_stop, -1.0))

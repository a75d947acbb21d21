"""What the two models of the paper predict for a point, beside what was measured."""

from __future__ import annotations

from typing import Any

from imotor_ros.campaign.point import PointParameters
from imotor_ros.core.excitation import voltage_for_motion
from imotor_ros.core.friction import CoulombFriction, FrictionLaw, VelocityDependentFriction
from imotor_ros.core.model import predict
from imotor_ros.core.motor import VirtualMotor
from imotor_ros.core.slider import LoadParameters

MODELS: dict[str, FrictionLaw] = {
    "model_1": CoulombFriction(),
    "model_2": VelocityDependentFriction(),
}
"""Friction model 1, equation (9), and model 2, equation (8)."""

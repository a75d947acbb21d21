"""The whole virtual stand as one object of parameters, from which every part takes its own."""

from __future__ import annotations

from dataclasses import dataclass

from imotor_ros.core.force_sensor import ForceSensorParameters
from imotor_ros.core.motor import MotorParameters
from imotor_ros.core.parameters import Parameters, group, parameter
from imotor_ros.core.vibrometer import VibrometerParameters


@dataclass(frozen=True)
class StandParameters(Parameters):
    """Motor, instruments and sampling of the stand; by default those of the paper."""

    sample_rate: float = parameter(
        1e6, "samples per second of every channel", unit="Hz", low=1e4, high=1e8,
        source="assumed: 54 samples per period at 18.5 kHz",
    )  # fmt: skip
    block_length: int = parameter(
        10_000, "samples sent at a time", unit="samples", low=1, high=10_000_000, source="assumed"
    )
    motor: MotorParameters = group(MotorParameters)
    rod_vibrometer: VibrometerParameters = group(VibrometerParameters)
    slider_vibrometer: VibrometerParameters = group(VibrometerParameters)
    force_sensor: ForceSensorParameters = group(ForceSensorParameters)

"""The virtual force sensor with its charge amplifier."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.context import Context

from imotor_ros.contracts.topics import LOAD_FORCE, TRUE_LOAD_FORCE
from imotor_ros.core.force_sensor import ForceSensor, ForceSensorParameters
from imotor_ros.core.parameters import group, parameter
from imotor_ros.nodes.instrument import InstrumentNode
from imotor_ros.nodes.stand_node import NodeParameters, run_node


@dataclass(frozen=True)
class ForceSensorNodeParameters(NodeParameters):
    """Parameters of the force sensor node."""

    seed: int = parameter(1, "seed of all that is random in the run", low=0, high=2**63 - 1)
    force_sensor: ForceSensorParameters = group(ForceSensorParameters)


class ForceSensorNode(InstrumentNode[ForceSensorNodeParameters]):
    """Measures truth/load_force and publishes load/force."""

    truth_topic = TRUE_LOAD_FORCE
    measured_topic = LOAD_FORCE

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("force_sensor", ForceSensorNodeParameters, context=context, **options)

    def make_instrument(self, sample_rate: float, channel: str) -> ForceSensor:
        """Return the sensor; see `InstrumentNode.make_instrument`."""
        settings = self.parameters
        return ForceSensor(settings.force_sensor, sample_rate, settings.seed, channel)


def main() -> int:
    """Run the node."""
    return run_node(ForceSensorNode)

"""The virtual laser vibrometer: one process for each head."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.context import Context

from imotor_ros.contracts.topics import Intent, Topic
from imotor_ros.core.parameters import group, parameter
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters
from imotor_ros.nodes.instrument import InstrumentNode
from imotor_ros.nodes.stand_node import NodeParameters, run_node

TRUE_VELOCITY = Topic("true_velocity", "imotor_msgs/msg/SampleBlock", Intent.STREAM, "m/s")
VELOCITY = Topic("velocity", "imotor_msgs/msg/SampleBlock", Intent.STREAM, "m/s")


@dataclass(frozen=True)
class VibrometerNodeParameters(NodeParameters):
    """Parameters of the vibrometer node."""

    seed: int = parameter(1, "seed of all that is random in the run", low=0, high=2**63 - 1)
    vibrometer: VibrometerParameters = group(VibrometerParameters)


class VibrometerNode(InstrumentNode[VibrometerNodeParameters]):
    """
    Measures ``true_velocity`` and publishes ``velocity``.

    Both names are remapped, e.g. to truth/rod_velocity and rod/velocity.
    """

    truth_topic = TRUE_VELOCITY
    measured_topic = VELOCITY

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("vibrometer", VibrometerNodeParameters, context=context, **options)

    def make_instrument(self, sample_rate: float, channel: str) -> Vibrometer:
        """Return the vibrometer; see `InstrumentNode.make_instrument`."""
        settings = self.parameters
        return Vibrometer(settings.vibrometer, sample_rate, settings.seed, channel)


def main() -> int:
    """Run the node."""
    return run_node(VibrometerNode)

"""The plant: the virtual motor, in the place that a hardware driver takes on a rig."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.context import Context
from rclpy.publisher import Publisher

from imotor_ros.campaign.roles.plant import PlantRole
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.contracts.messages import channel_to_message, progress_to_message
from imotor_ros.contracts.topics import (
    CHANNELS,
    CURRENT,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    TRUTH_TOPICS,
    VOLTAGE_MONITOR,
)
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.parameters import group, parameter
from imotor_ros.nodes.run_follower import RunFollowerNode
from imotor_ros.nodes.stand_node import NodeParameters, run_node


@dataclass(frozen=True)
class PlantParameters(NodeParameters):
    """Parameters of the plant node."""

    seed: int = parameter(1, "seed of all that is random in the run", low=0, high=2**63 - 1)
    motor: MotorParameters = group(MotorParameters)


class PlantNode(RunFollowerNode[PlantParameters]):
    """Consumes drive/voltage as fast as it computes; publishes truth, monitors and progress."""

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("plant", PlantParameters, context=context, **options)
        self._role: PlantRole | None = None
        self._progress: Publisher | None = None
        self._channels: Publisher | None = None

    def configure(self) -> None:
        """Make the endpoints."""
        self.follow_run()
        for topic in (*TRUTH_TOPICS, VOLTAGE_MONITOR, CURRENT):
            self.add_publisher(topic)
        self._progress = self.add_publisher(DRIVE_PROGRESS)
        self._channels = self.add_publisher(CHANNELS)
        self.follow_stream(DRIVE_VOLTAGE)
        # compiled code is loaded, or compiled after a change, now and not when samples wait
        VirtualMotor(self.parameters.motor, 1e6, 0).process(np.zeros(2))

    def begin_run(self, program: DriveProgram) -> None:
        """Put the motor at rest, and say what its monitors are."""
        self._role = PlantRole(self.parameters.motor, self.parameters.seed, program)
        for channel in self._role.channels:
            message = channel_to_message(self.types, channel, program.run_id, program.epoch)
            self.publish(self._channels, message)

    def process_block(self, block: SampleBlock) -> None:
        """Drive the motor with a block."""
        assert self._role is not None
        output = self._role.process(block)
        for made in output.blocks:
            self.publish_block(made)
        self._report(self._role.consumed, output.flags)

    def _report(self, consumed: int, flags: int, fault: str = "") -> None:
        assert self.program is not None
        program = self.program
        moment = sample_time(program.epoch, consumed, program.sample_rate)
        message = progress_to_message(self.types, program.run_id, moment, consumed, flags, fault)
        self.publish(self._progress, message)

    def on_fault(self, reason: str) -> None:
        """Tell the generator, which ends the run."""
        super().on_fault(reason)
        if self.program is not None:
            self._report(self._role.consumed if self._role else 0, 0, f"plant: {reason}")

    def status_values(self) -> dict[str, object]:
        """Return run id and progress."""
        if self.program is None or self._role is None:
            return {}
        return {"run_id": self.program.run_id, "consumed": self._role.consumed}


def main() -> int:
    """Run the node."""
    return run_node(PlantNode)

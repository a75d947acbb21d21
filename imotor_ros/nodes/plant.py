"""The plant: the virtual motor, in the place that a hardware driver takes on a rig."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.context import Context
from rclpy.publisher import Publisher

from imotor_ros.campaign.roles.plant import PlantOutput, PlantRole
from imotor_ros.contracts.blocks import SampleBlock
from imotor_ros.contracts.messages import channel_to_message
from imotor_ros.contracts.topics import CHANNELS, CURRENT, TRUTH_TOPICS, VOLTAGE_MONITOR
from imotor_ros.core.channel import SampleFlag, flag_names
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.parameters import group, parameter
from imotor_ros.nodes.guarded_driver import GuardedDriverNode, GuardedDriverParameters
from imotor_ros.nodes.stand_node import run_node


@dataclass(frozen=True)
class PlantParameters(GuardedDriverParameters):
    """Parameters of the plant node."""

    seed: int = parameter(1, "seed of all that is random in the run", low=0, high=2**63 - 1)
    motor: MotorParameters = group(MotorParameters)


class PlantNode(GuardedDriverNode[PlantParameters]):
    """Consumes drive/voltage as fast as it computes; publishes truth, monitors and progress."""

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("plant", PlantParameters, context=context, **options)
        self._role: PlantRole | None = None
        self._flags = SampleFlag(0)
        self._channels: Publisher | None = None

    def configure(self) -> None:
        """Make the endpoints."""
        super().configure()
        for topic in (*TRUTH_TOPICS, VOLTAGE_MONITOR, CURRENT):
            self.add_publisher(topic)
        self._channels = self.add_publisher(CHANNELS)
        # compiled code is loaded, or compiled after a change, now and not when samples wait
        VirtualMotor(self.parameters.motor, 1e6, 0).process(np.zeros(2))

    def begin_run(self, program: DriveProgram) -> None:
        """Put the motor at rest, and say what its monitors are."""
        super().begin_run(program)
        self._role = PlantRole(self.parameters.motor, self.parameters.seed, program)
        self._flags = SampleFlag(0)
        assert self._channels is not None
        for channel in self._role.channels:
            message = channel_to_message(self.types, channel, program.run_id, program.epoch)
            self.publish(self._channels, message)

    def change_run(self, program: DriveProgram) -> None:
        """Take note of the new end."""
        assert self._role is not None
        self._role.program = program
        super().change_run(program)

    @property
    def consumed(self) -> int:
        """Number of samples that the motor was driven with."""
        return 0 if self._role is None else self._role.consumed

    @property
    def is_voltage_on(self) -> bool:
        """Whether the motor is within a program."""
        return self._role is not None and self._role.is_voltage_on

    def put_out(self, block: SampleBlock) -> int:
        """Drive the motor with a block."""
        assert self._role is not None
        return self._publish(self._role.process(block))

    def ramp_down(self) -> None:
        """Drive the motor with a ramp to zero."""
        assert self._role is not None
        self._publish(self._role.ramp_down())

    def _publish(self, output: PlantOutput) -> int:
        self._flags |= SampleFlag(output.flags)
        for made in output.blocks:
            self.publish_block(made)
        return output.flags

    def status_values(self) -> dict[str, object]:
        """Return run id, progress, last voltage and flags."""
        if self._role is None:
            return {}
        role = self._role
        return {
            "run_id": role.program.run_id,
            "length": role.program.length,
            "consumed": role.consumed,
            "voltage": f"{role.voltage:.4g} V",
            "flags": flag_names(self._flags),
        }

    def warning(self) -> str:
        """Return what the amplifier did to the voltage."""
        limited = self._flags & ~SampleFlag.RAMPED_DOWN
        return f"voltage limited: {flag_names(limited)}" if limited else ""


def main() -> int:
    """Run the node."""
    return run_node(PlantNode)

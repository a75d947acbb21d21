"""The plant: the virtual motor between drive/voltage and truth, monitors and progress."""

from __future__ import annotations

from dataclasses import dataclass

from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, StreamLedger
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.motor import MotorParameters, VirtualMotor


@dataclass(frozen=True)
class PlantOutput:
    """What the plant makes of one block of voltage: blocks to publish, and the flags raised."""

    blocks: tuple[SampleBlock, ...]
    flags: int


class PlantRole:
    """
    The virtual motor between the streams drive/voltage, truth/... and the monitors.

    Parameters
    ----------
    motor : MotorParameters
        The motor.
    seed : int
        Seed of the run.
    program : DriveProgram
        The run.

    """

    def __init__(self, motor: MotorParameters, seed: int, program: DriveProgram) -> None:
        self._motor = VirtualMotor(motor, program.sample_rate, seed)
        self._ledger = StreamLedger(
            topics.DRIVE_VOLTAGE.name, program.run_id, sample_rate=program.sample_rate
        )

    @property
    def channels(self) -> tuple[ChannelDescription, ...]:
        """The monitors of the amplifier."""
        return self._motor.channels

    @property
    def consumed(self) -> int:
        """Number of samples consumed."""
        return self._ledger.received

    def process(self, block: SampleBlock) -> PlantOutput:
        """
        Drive the motor with a block of voltage.

        Raises
        ------
        SamplesLostError
            If the block does not follow the one before.

        """
        self._ledger.accept(block)
        response = self._motor.process(block.samples)
        derived = (
            (topics.TRUE_ROD_VELOCITY, response.rod_velocity, 0),
            (topics.TRUE_SLIDER_VELOCITY, response.slider_velocity, 0),
            (topics.TRUE_LOAD_FORCE, response.load_force, 0),
            (topics.VOLTAGE_MONITOR, response.voltage_monitor, response.voltage_monitor_flags),
            (topics.CURRENT, response.current, response.current_flags),
        )
        blocks = tuple(block.derive(t.name, t.unit, x, int(f)) for t, x, f in derived)
        return PlantOutput(blocks, int(response.flags))

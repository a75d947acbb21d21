"""The plant: the virtual motor between drive/voltage and truth, monitors and progress."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, StreamLedger, sample_time
from imotor_ros.core.channel import ChannelDescription, SampleFlag
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.motor import MotorParameters, VirtualMotor

RAMP_TIME = 0.01
"""Time (s) in which the plant brings the voltage to zero by itself."""

REST_TIME = 0.002
"""Time (s) at 0 V after that, in which the monitors come to rest too."""


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
        self.program = program
        self.consumed = 0
        self._blocks = 0
        self.voltage = 0.0
        self._motor = VirtualMotor(motor, program.sample_rate, seed)
        self._ledger = StreamLedger(
            topics.DRIVE_VOLTAGE.name, program.run_id, sample_rate=program.sample_rate
        )

    @property
    def channels(self) -> tuple[ChannelDescription, ...]:
        """The monitors of the amplifier."""
        return self._motor.channels

    @property
    def is_voltage_on(self) -> bool:
        """Whether the last sample put out is one of the program, but not its end."""
        return 0 < self.consumed < self.program.length

    def process(self, block: SampleBlock) -> PlantOutput:
        """
        Drive the motor with a block of voltage.

        Raises
        ------
        SamplesLostError
            If the block does not follow the one before.

        """
        self._ledger.accept(block)
        output = self._drive(block, 0)
        self.consumed, self._blocks = block.end_index, self._blocks + 1
        if block.samples.size:
            self.voltage = float(block.samples[-1])
        return output

    def ramp_down(self) -> PlantOutput:
        """
        Bring the voltage to zero, whatever the program is; return what comes of it.

        The blocks continue the streams and carry the flag RAMPED_DOWN. Nothing can be consumed
        after that.
        """
        program, rate = self.program, self.program.sample_rate
        block = SampleBlock(
            stream=topics.DRIVE_VOLTAGE.name,
            run_id=program.run_id,
            time=sample_time(program.epoch, self.consumed, rate),
            sequence=self._blocks,
            first_index=self.consumed,
            sample_rate=rate,
            unit=topics.DRIVE_VOLTAGE.unit,
            flags=int(SampleFlag.RAMPED_DOWN),
            samples=_ramp(self.voltage, rate),
        )
        self.voltage = 0.0
        return self._drive(block, block.flags)

    def _drive(self, block: SampleBlock, flags: int) -> PlantOutput:
        response = self._motor.process(block.samples)
        derived = (
            (topics.TRUE_ROD_VELOCITY, response.rod_velocity, 0),
            (topics.TRUE_SLIDER_VELOCITY, response.slider_velocity, 0),
            (topics.TRUE_LOAD_FORCE, response.load_force, 0),
            (topics.VOLTAGE_MONITOR, response.voltage_monitor, response.voltage_monitor_flags),
            (topics.CURRENT, response.current, response.current_flags),
        )
        blocks = tuple(block.derive(t.name, t.unit, x, int(f) | flags) for t, x, f in derived)
        return PlantOutput(blocks, int(response.flags) | flags)


def _ramp(voltage: float, sample_rate: float) -> NDArray[np.float64]:
    """Return samples (V) from a voltage to zero, and a rest there."""
    steps = max(1, round(RAMP_TIME * sample_rate))
    falling = voltage * (1.0 - np.arange(1, steps + 1) / steps)
    return np.concatenate([falling, np.zeros(max(1, round(REST_TIME * sample_rate)))])

"""
What each part of the stand does with blocks, without ROS.

The nodes and the in-process bench both call these, so that the same program and the same seed
give the same samples on either.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, StreamLedger, sample_time
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.evaluator import EvaluatorParameters, RunEvaluator
from imotor_ros.core.force_sensor import ForceSensor, ForceSensorParameters
from imotor_ros.core.indicators import Performance
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters
from imotor_ros.errors import BadInputError


class GeneratorRole:
    """
    Renders a drive program block by block, a bounded number of samples ahead of the plant.

    Parameters
    ----------
    program : DriveProgram
        What to play.
    block_length : int
        Samples in a block.
    window : int
        Blocks that may be under way: sent, but not consumed.

    """

    def __init__(self, program: DriveProgram, block_length: int, window: int) -> None:
        self.program = program
        self.sent = 0
        self.consumed = 0
        self.is_stopping = False
        self._sequence = 0
        self._block_length = block_length
        self._allowance = window * block_length

    @property
    def is_finished(self) -> bool:
        """Whether the plant has consumed the whole program."""
        return self.consumed >= self.program.length

    def next_block(self) -> SampleBlock | None:
        """Return the next block, or None if nothing may be sent for now."""
        count = min(self._block_length, self.program.length - self.sent)
        if count <= 0 or self.sent - self.consumed >= self._allowance:
            return None
        program = self.program
        block = SampleBlock(
            stream=topics.DRIVE_VOLTAGE.name,
            run_id=program.run_id,
            time=sample_time(program.epoch, self.sent, program.sample_rate),
            sequence=self._sequence,
            first_index=self.sent,
            sample_rate=program.sample_rate,
            unit="V",
            flags=0,
            samples=program.render(self.sent, count),
        )
        self._sequence += 1
        self.sent += count
        return block

    def acknowledge(self, consumed: int) -> None:
        """
        Take note of what the plant has consumed.

        Raises
        ------
        BadInputError
            If it claims to have consumed what was not sent, or takes back what it had.

        """
        if not self.consumed <= consumed <= self.sent:
            raise BadInputError(
                "acknowledges the wrong number of samples",
                where=topics.DRIVE_PROGRESS.name,
                value=consumed,
                bound=f"{self.consumed} to {self.sent}",
            )
        self.consumed = consumed

    def stop(self) -> DriveProgram:
        """Cut the program at the next sample to be sent, bring the voltage to zero, return it."""
        if not self.is_stopping:
            self.is_stopping = True
            self.program = self.program.stopped_at(self.sent)
        return self.program


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
        flags = int(response.flags)
        derived = (
            (topics.TRUE_ROD_VELOCITY, response.rod_velocity, 0),
            (topics.TRUE_SLIDER_VELOCITY, response.slider_velocity, 0),
            (topics.TRUE_LOAD_FORCE, response.load_force, 0),
            (topics.VOLTAGE_MONITOR, response.voltage_monitor, flags),
            (topics.CURRENT, response.current, flags),
        )
        blocks = tuple(block.derive(t.name, t.unit, x, f) for t, x, f in derived)
        return PlantOutput(blocks, flags)


class InstrumentRole:
    """
    A virtual instrument between a stream of truth and a measured stream.

    Parameters
    ----------
    parameters : VibrometerParameters or ForceSensorParameters
        The instrument.
    channel : str
        Name of the measured channel, e.g. "slider/velocity".
    seed : int
        Seed of the run.
    program : DriveProgram
        The run.

    """

    def __init__(
        self,
        parameters: VibrometerParameters | ForceSensorParameters,
        channel: str,
        seed: int,
        program: DriveProgram,
    ) -> None:
        instrument = Vibrometer if isinstance(parameters, VibrometerParameters) else ForceSensor
        self._instrument = instrument(parameters, program.sample_rate, seed, channel)
        self._ledger = StreamLedger(channel, program.run_id, sample_rate=program.sample_rate)

    @property
    def channels(self) -> tuple[ChannelDescription, ...]:
        """The one channel of the instrument."""
        return (self._instrument.channel,)

    def process(self, block: SampleBlock) -> SampleBlock:
        """
        Measure a block of truth.

        Raises
        ------
        SamplesLostError
            If the block does not follow the one before.

        """
        self._ledger.accept(block)
        samples, flags = self._instrument.process(block.samples)
        channel = self._instrument.channel
        return block.derive(channel.name, channel.unit, samples, int(flags))


class EvaluatorRole:
    """
    The evaluator: takes the measured blocks, gives provisional indicators and the final ones.

    Parameters
    ----------
    parameters : EvaluatorParameters
        How to evaluate.
    channels : sequence of str
        Names of the channels that the run has.
    report_interval : float
        Stream time between provisional indicators (s); 0 for none.
    program : DriveProgram
        The run.

    """

    def __init__(
        self,
        parameters: EvaluatorParameters,
        channels: tuple[str, ...],
        report_interval: float,
        program: DriveProgram,
    ) -> None:
        self._evaluator = RunEvaluator(parameters)
        self._evaluator.begin(program)
        self._program = program
        self._described: set[str] = set()
        self._ends = dict.fromkeys(channels, 0)
        self._is_done = False
        self._step = round(report_interval * program.sample_rate)
        self._next_report = self._step

    def change_program(self, program: DriveProgram) -> None:
        """Take note that the program was cut short."""
        self._program = program
        self._evaluator.change_program(program)

    def add_channel(self, channel: ChannelDescription) -> None:
        """Take note of what a channel is."""
        if channel.name in self._ends:
            self._described.add(channel.name)
            self._evaluator.add_channel(channel)

    def add_block(self, block: SampleBlock) -> None:
        """Take a measured block."""
        self._evaluator.add_samples(
            block.stream, block.first_index, block.samples, block.flags
        )
        self._ends[block.stream] = max(self._ends[block.stream], block.end_index)

    def reports(self) -> Iterator[Performance]:
        """
        Yield what can be said now and has not been: provisional indicators, then the final ones.

        Provisional indicators are due at fixed numbers of samples and rest on those only, so
        that they do not depend on how the streams were cut into blocks or interleaved.
        """
        if self._is_done or len(self._described) < len(self._ends):
            return
        end = min(self._ends.values())
        while self._step and self._next_report <= min(end, self._program.length - 1):
            yield self._evaluator.performance(until=self._next_report)
            self._next_report += self._step
        if end >= self._program.length:
            self._is_done = True
            yield self._evaluator.performance()

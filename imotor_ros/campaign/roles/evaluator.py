"""The evaluator: from the measured streams to indicators."""

from __future__ import annotations

from collections.abc import Iterator

from imotor_ros.contracts.blocks import SampleBlock, stamp_error
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.evaluator import EvaluatorParameters, RunEvaluator
from imotor_ros.core.indicators import Performance


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
            block.stream, block.first_index, block.samples, block.flags, block.sample_rate,
            stamp_error(block, self._program.epoch, self._program.sample_rate),
        )  # fmt: skip
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

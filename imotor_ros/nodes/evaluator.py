"""The performance evaluator: the indicators of the run, live."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.context import Context
from rclpy.publisher import Publisher

from imotor_ros.campaign.roles.evaluator import EvaluatorRole
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.contracts.messages import channel_from_message, performance_to_message
from imotor_ros.contracts.topics import CHANNELS, MEASURED_TOPICS, PERFORMANCE, topic_named
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.evaluator import EvaluatorParameters
from imotor_ros.core.parameters import group, parameter
from imotor_ros.errors import BadInputError
from imotor_ros.nodes.run_follower import RunFollowerNode
from imotor_ros.nodes.stand_node import NodeParameters, run_node


@dataclass(frozen=True)
class EvaluatorNodeParameters(NodeParameters):
    """Parameters of the evaluator node."""

    channels: str = parameter(
        " ".join(topic.name for topic in MEASURED_TOPICS), "channels that the run has"
    )
    report_interval: float = parameter(
        0.05, "stream time between provisional indicators, 0 for none", unit="s", low=0.0, high=3600
    )
    evaluator: EvaluatorParameters = group(EvaluatorParameters)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return tuple(self.channels.split())

    def check(self) -> None:
        """Check that there are such channels."""
        super().check()
        known = [topic.name for topic in MEASURED_TOPICS]
        for name in self.channel_names:
            if name not in known:
                raise BadInputError(
                    "is not a measured channel",
                    where="channels",
                    value=name,
                    bound="some of " + ", ".join(known),
                )


class EvaluatorNode(RunFollowerNode[EvaluatorNodeParameters]):
    """Takes the measured streams and publishes the indicators on performance."""

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("evaluator", EvaluatorNodeParameters, context=context, **options)
        self._role: EvaluatorRole | None = None
        self._performance: Publisher | None = None
        self._early_channels: dict[str, list[ChannelDescription]] = {}

    def configure(self) -> None:
        """Make the endpoints."""
        self._performance = self.add_publisher(PERFORMANCE)
        self.follow_run()
        self.add_subscription(CHANNELS, self._on_channel)
        for name in self.parameters.channel_names:
            self.follow_stream(topic_named(name))

    def activate(self) -> None:
        """Forget the last run."""
        super().activate()
        self._early_channels = {}

    def begin_run(self, program: DriveProgram) -> None:
        """Begin to evaluate a run."""
        settings = self.parameters
        self._role = EvaluatorRole(
            settings.evaluator, settings.channel_names, settings.report_interval, program
        )
        for channel in self._early_channels.pop(program.run_id, []):
            self._role.add_channel(channel)

    def change_run(self, program: DriveProgram) -> None:
        """Take note that the run was cut short."""
        assert self._role is not None
        self._role.change_program(program)
        self._report()

    def process_block(self, block: SampleBlock) -> None:
        """Take a block, and publish what can be said then."""
        assert self._role is not None
        self._role.add_block(block)
        self._report()

    def _on_channel(self, message: Any) -> None:
        channel = channel_from_message(message)
        if self.program is None or self._role is None or message.run_id != self.program.run_id:
            self._early_channels.setdefault(message.run_id, []).append(channel)
            return
        self._role.add_channel(channel)
        self._report()

    def _report(self) -> None:
        assert self._role is not None
        assert self.program is not None
        program = self.program
        for performance in self._role.reports():
            end = sample_time(program.epoch, performance.end_index, program.sample_rate)
            message = performance_to_message(self.types, performance, end)
            self.publish(self._performance, message)

    def status_values(self) -> dict[str, object]:
        """Return the run id."""
        return {} if self.program is None else {"run_id": self.program.run_id}


def main() -> int:
    """Run the node."""
    return run_node(EvaluatorNode)

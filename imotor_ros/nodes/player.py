"""The player: a recorded run in place of generator, plant and instruments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.timer import Timer

from imotor_ros.bag.reader import BagMessage, RunBag
from imotor_ros.contracts import topics
from imotor_ros.core.parameters import parameter
from imotor_ros.errors import BadInputError, ImotorError
from imotor_ros.nodes.stand_node import NodeParameters, StandNode, run_node

PLAYED_TOPICS = (
    topics.RUN_INFO,
    topics.DRIVE_PROGRAM,
    topics.CHANNELS,
    topics.DRIVE_VOLTAGE,
    topics.DRIVE_PROGRESS,
    *topics.MEASURED_TOPICS,
)
"""What is played: all that a stand publishes, but what the evaluator says of it."""


@dataclass(frozen=True)
class PlayerParameters(NodeParameters):
    """Parameters of the player node."""

    path: str = parameter("", "folder of the bag to play")


class PlayerNode(StandNode[PlayerParameters]):
    """Publishes the messages of a bag on the topics where they were recorded, unchanged."""

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("player", PlayerParameters, context=context, **options)
        self._bag: RunBag | None = None
        self._messages: Iterator[BagMessage] = iter(())
        self._played = 0
        self._timer: Timer | None = None
        self._publisher_of: dict[str, Any] = {}

    def configure(self) -> None:
        """Open the bag and make the endpoints."""
        if not self.parameters.path:
            raise BadInputError("is not set", where="path", bound="the folder of a bag")
        self._bag = RunBag(Path(self.parameters.path))
        self._publisher_of = {topic.name: self.add_publisher(topic) for topic in PLAYED_TOPICS}

    def activate(self) -> None:
        """Begin to play."""
        assert self._bag is not None
        self._messages = self._bag.messages(*(topic.name for topic in PLAYED_TOPICS))
        self._played = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(0.0, self._on_timer, clock=steady)

    def _on_timer(self) -> None:
        # one message a call: services and signals are heard in between
        try:
            message = next(self._messages)
            self.publish(self._publisher_of[message.topic], message.data)
            self._played += 1
        except StopIteration:
            self._stop_timer()
        except ImotorError as error:
            self._stop_timer()
            self.on_fault(str(error))

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None

    def deactivate(self) -> None:
        """Stop playing."""
        self._stop_timer()

    def cleanup(self) -> None:
        """Close the bag."""
        if self._bag is not None:
            self._bag.close()
            self._bag = None

    def finish(self) -> None:
        """Close the bag because the process ends."""
        self.cleanup()

    def status_values(self) -> dict[str, object]:
        """Return the bag and how many messages were played."""
        return {"path": self.parameters.path, "played": self._played}


def main() -> int:
    """Run the node."""
    return run_node(PlayerNode)

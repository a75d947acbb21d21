"""The recorder: the run's bag."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imotor_msgs.msg import DriveProgram as DriveProgramMessage
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message

from imotor_ros.bag.types import installed_types
from imotor_ros.campaign.roles.recorder import RecorderRole
from imotor_ros.contracts import topics
from imotor_ros.contracts.messages import program_from_message, recording_to_message
from imotor_ros.contracts.topics import Topic
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.parameters import parameter
from imotor_ros.errors import BadInputError, RecordingError
from imotor_ros.nodes.message_types import message_class
from imotor_ros.nodes.stand_node import NodeParameters, StandNode, run_node

_LATCHED = {topic.name for topic in topics.ALL_TOPICS if topic.intent is topics.Intent.LATCHED}


@dataclass(frozen=True)
class RecorderParameters(NodeParameters):
    """Parameters of the recorder node."""

    path: str = parameter(
        "", "folder of the bag, new for every run; if empty, the run id below the present folder"
    )
    run_info: str = parameter("{}", "JSON: all that is needed to repeat the run")
    provenance: str = parameter("{}", "JSON: versions, host and start of the run")
    is_simulated: bool = parameter(True, "log times follow the sample index, not the reception")
    has_truth: bool = parameter(
        True, "whether the run has the streams truth/..., which only a virtual motor has"
    )
    channel_count: int = parameter(
        len(topics.MEASURED_TOPICS), "number of channels that are described", low=0, high=1000
    )
    report_interval: float = parameter(
        0.05, "stream time between provisional indicators, 0 for none", unit="s", low=0.0, high=3600
    )

    def check(self) -> None:
        """Check that the texts are JSON objects."""
        super().check()
        for name in ("run_info", "provenance"):
            _read_json(name, getattr(self, name))


def _read_json(name: str, text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except ValueError as error:
        raise BadInputError(f"is not JSON: {error}", where=name, value=text[:40]) from error
    if not isinstance(content, dict):
        raise BadInputError("is not a JSON object", where=name, value=text[:40])
    return content


class RecorderNode(StandNode[RecorderParameters]):
    """
    Writes every topic of a run to a bag.

    Recording begins with the drive program. The bag is closed when every stream has come to the
    program's end and the final indicators are in; at deactivation, at shutdown or with the next
    program at the latest. What of a run comes before its program waits for it.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("recorder", RecorderParameters, context=context, **options)
        self._role: RecorderRole | None = None
        self._done: set[str] = set()
        self._received = 0
        self._early: deque[tuple[str, bytes, int]] = deque()
        self._state: Publisher | None = None
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._commit_timer = self.create_timer(0.5, self._on_commit_timer, clock=steady)

    def configure(self) -> None:
        """Make the endpoints."""
        installed_types()  # parsed now, not when the first blocks wait
        self._state = self.add_publisher(topics.RECORDING)
        for topic in self._recorded():
            self.add_subscription(topic, self._receiver(topic), raw=True)

    def _recorded(self) -> tuple[Topic, ...]:
        left_out = () if self.parameters.has_truth else topics.TRUTH_TOPICS
        return tuple(topic for topic in topics.ALL_TOPICS if topic not in left_out)

    def activate(self) -> None:
        """Make ready for a run: what is latched may have come before, samples may not."""
        self._done.clear()
        self._early = deque(one for one in self._early if one[0] in _LATCHED)

    def deactivate(self) -> None:
        """Close the bag of a run that has not come to its end."""
        self._close("the recorder was deactivated")

    def received_count(self) -> int:
        """Return the number of messages received."""
        return self._received

    def finish(self) -> None:
        """Close the bag because the process ends."""
        self._close("the recorder was stopped")

    def status_values(self) -> dict[str, object]:
        """Return run id, path, messages, lost samples and what else went wrong."""
        if self._role is None:
            return {}
        role = self._role
        return {
            "run_id": role.program.run_id,
            "path": role.path,
            "messages": role.messages,
            "lost": role.lost,
            **role.troubles,
        }

    def _receiver(self, topic: Topic) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            now = time.time_ns()
            self._received += topic is not topics.DIAGNOSTICS
            if self.is_active and topic is topics.DRIVE_PROGRAM:
                self._begin(data)
            if self._role is not None:
                self._add(topic.name, data, now)
            elif topic is not topics.DIAGNOSTICS and (self.is_active or topic.name in _LATCHED):
                self._early.append((topic.name, data, now))

        return receive

    def _begin(self, data: bytes) -> None:
        """Open the bag of the run whose program this is, unless it is open or was closed."""
        program = program_from_message(deserialize_message(data, DriveProgramMessage))
        if self._role is not None and self._role.program.run_id == program.run_id:
            return
        if program.run_id != self._expected_run(program.run_id):
            return
        self._close(f"run {program.run_id} began")
        if program.run_id in self._done:
            return
        path = Path(self.parameters.path or program.run_id).absolute()
        try:
            self._role = self._open(path, program)
        except (BadInputError, OSError) as error:
            self._done.add(program.run_id)
            self._publish_state("FAILED", program, path, error=str(error))
            raise
        self.get_logger().info(f"recording run {program.run_id} to {path}")
        self._publish_state("RECORDING", program, path)
        early, self._early = self._early, deque()
        for topic, earlier, received in early:
            self._add(topic, earlier, received)

    def _expected_run(self, otherwise: str) -> str:
        """Return the id of the run to record: a trial may have been played just before."""
        return str(_read_json("run_info", self.parameters.run_info).get("run_id", otherwise))

    def _open(self, path: Path, program: DriveProgram) -> RecorderRole:
        settings = self.parameters
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            cause = error.strerror or str(error)
            raise RecordingError(f"{path}: cannot be written: {cause}") from error
        return RecorderRole(
            path,
            program,
            run_info=_read_json("run_info", settings.run_info),
            provenance=_read_json("provenance", settings.provenance),
            recorded=self._recorded(),
            channel_count=settings.channel_count,
            report_interval=settings.report_interval,
            namespace=self.get_namespace(),
            is_simulated=settings.is_simulated,
        )

    def _add(self, topic: str, data: bytes, received: int) -> None:
        if self._role is None:
            return
        self._role.add(topic, bytes(data), received)
        if self._role.is_complete:
            self._close()

    def _close(self, reason: str = "") -> None:
        if self._role is None:
            return
        role, self._role = self._role, None
        self._done.add(role.program.run_id)
        counts = {"messages": role.messages, "lost": role.lost}
        try:
            role.close(reason)
        except RecordingError as error:
            self._publish_state("FAILED", role.program, role.path, error=str(error), **counts)
            self.set_fault(str(error))
        else:
            self._publish_state("CLOSED", role.program, role.path, error=reason, **counts)

    def _publish_state(self, state: str, program: DriveProgram, path: Path, **details: Any) -> None:
        assert self._state is not None
        code = int(getattr(message_class(topics.RECORDING.type_name), f"STATE_{state}"))
        self._state.publish(
            recording_to_message(
                self.types, program.run_id, program.epoch, code, str(path), **details
            )
        )

    def on_fault(self, reason: str) -> None:
        """Close the bag with what it has."""
        self._close(reason)
        super().on_fault(reason)

    def _on_commit_timer(self) -> None:
        if self._role is not None and not self.fault:
            try:
                self._role.commit_if_due()
            except RecordingError as error:
                self.on_fault(str(error))


def main() -> int:
    """Run the node."""
    return run_node(RecorderNode)

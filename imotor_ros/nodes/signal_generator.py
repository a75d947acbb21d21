"""The signal generator: plays drive programs, a bounded number of samples ahead of the plant."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from imotor_msgs.action import PlayProgram
from imotor_msgs.msg import RecordingState
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.publisher import Publisher
from rclpy.task import Future
from std_srvs.srv import Trigger

from imotor_ros.campaign.roles.generator import GeneratorRole
from imotor_ros.contracts.messages import program_from_message, program_to_message
from imotor_ros.contracts.topics import (
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    RECORDING,
)
from imotor_ros.core.parameters import parameter
from imotor_ros.errors import ImotorError
from imotor_ros.nodes.stand_node import NodeParameters, StandNode, run_node

COMPLETED = "completed"
CANCELLED = "cancelled"


@dataclass(frozen=True)
class SignalGeneratorParameters(NodeParameters):
    """Parameters of the signal generator node."""

    block_length: int = parameter(10_000, "samples in a block", low=1, high=10_000_000)
    window: int = parameter(
        8, "blocks that may be under way: sent, but not consumed", low=1, high=1000
    )
    progress_timeout: float = parameter(
        10.0, "longest wait for the plant to consume something", unit="s", low=0.1, high=3600.0
    )
    awaits_recording: bool = parameter(
        False, "whether the voltage waits until the recorder has opened the bag of the run"
    )


class SignalGeneratorNode(StandNode[SignalGeneratorParameters]):
    """
    Plays drive programs given by the action ``drive/play``.

    The goal is a DriveProgram; the feedback tells samples sent and consumed. Cancelling, or
    the service ``drive/stop``, brings the voltage to zero by a ramp. With the parameter
    ``awaits_recording`` the program is announced at once, but played only when its bag is open:
    nothing of the run is lost, and a motor is not driven for a run that cannot be recorded.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("signal_generator", SignalGeneratorParameters, context=context, **options)
        self._role: GeneratorRole | None = None
        self._finished: Future | None = None
        self._goal: ServerGoalHandle | None = None
        self._last_progress = 0.0
        self._is_held = False
        self._program_publisher: Publisher | None = None
        self._action = ActionServer(
            self,
            PlayProgram,
            "drive/play",
            execute_callback=self._on_play,
            cancel_callback=self._on_cancel,
        )
        self._stop_service = self.create_service(Trigger, "drive/stop", self._on_stop)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._watchdog = self.create_timer(0.2, self._on_watchdog, clock=steady)

    def configure(self) -> None:
        """Make the endpoints."""
        self._program_publisher = self.add_publisher(DRIVE_PROGRAM)
        self.add_publisher(DRIVE_VOLTAGE)
        self.add_subscription(DRIVE_PROGRESS, self._on_progress)
        self.add_subscription(RECORDING, self._on_recording)

    def deactivate(self) -> None:
        """End the program that is being played, if any."""
        self._end("the signal generator was deactivated")

    def status_values(self) -> dict[str, object]:
        """Return run id and progress."""
        if self._role is None:
            return {}
        role = self._role
        return {
            "run_id": role.program.run_id,
            "length": role.program.length,
            "sent": role.sent,
            "consumed": role.consumed,
        }

    async def _on_play(self, goal: ServerGoalHandle) -> PlayProgram.Result:
        refusal = self._begin(goal)
        outcome = refusal
        if not refusal:
            self._finished = Future()
            self._pump()
            outcome = await self._finished
        consumed = self._role.consumed if self._role is not None and not refusal else 0
        if not refusal:
            self._role, self._goal, self._finished = None, None, None
        if outcome == CANCELLED and goal.is_cancel_requested:
            goal.canceled()
        elif outcome in (COMPLETED, CANCELLED):
            goal.succeed()
        else:
            self.get_logger().error(f"program not played: {outcome}")
            goal.abort()
        return PlayProgram.Result(consumed=consumed, outcome=outcome)

    def _begin(self, goal: ServerGoalHandle) -> str:
        """Take up a program; return why not, or nothing."""
        if not self.is_active:
            return "the signal generator is not active"
        if self.fault:
            return f"the signal generator has a fault: {self.fault}"
        if self._role is not None:
            return f"run {self._role.program.run_id} is being played"
        if goal.is_cancel_requested:
            return CANCELLED
        try:
            program = program_from_message(goal.request.program)
        except ImotorError as error:
            return str(error)
        settings = self.parameters
        self._role = GeneratorRole(program, settings.block_length, settings.window)
        self._goal = goal
        self._is_held = settings.awaits_recording
        self._last_progress = time.monotonic()
        self._announce()
        return ""

    def _announce(self) -> None:
        assert self._role is not None
        assert self._program_publisher is not None
        self._program_publisher.publish(program_to_message(self.types, self._role.program))

    def _pump(self) -> None:
        """Send what may be sent."""
        if self._role is None or self._is_held:
            return
        try:
            while (block := self._role.next_block()) is not None:
                self.publish_block(block)
        except ImotorError as error:
            self.on_fault(str(error))

    def _on_recording(self, message: Any) -> None:
        """Let the voltage flow once the bag is open."""
        role = self._role
        if role is None or not self._is_held or message.run_id != role.program.run_id:
            return
        if message.state == RecordingState.STATE_FAILED:
            self._end(f"recorder: {message.error}")
        elif message.state == RecordingState.STATE_RECORDING:
            self._is_held = False
            self._last_progress = time.monotonic()
            self._pump()

    def _on_progress(self, message: Any) -> None:
        role = self._role
        if role is None or message.run_id != role.program.run_id:
            return
        if message.fault:
            self._end(message.fault)
            return
        role.acknowledge(int(message.consumed))
        self._last_progress = time.monotonic()
        if self._goal is not None:
            feedback = PlayProgram.Feedback(sent=role.sent, consumed=role.consumed)
            self._goal.publish_feedback(feedback)
        if role.is_finished:
            self._end(CANCELLED if role.is_stopping else COMPLETED)
        else:
            self._pump()

    def _end(self, outcome: str) -> None:
        if self._finished is not None and not self._finished.done():
            self._finished.set_result(outcome)

    def on_fault(self, reason: str) -> None:
        """End the program with the reason."""
        super().on_fault(reason)
        self._end(reason)

    def _on_cancel(self, _goal: ServerGoalHandle) -> CancelResponse:
        self._stop()
        return CancelResponse.ACCEPT

    def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._role is not None
        response.message = "the voltage goes to zero" if self._role else "nothing is being played"
        self._stop()
        return response

    def _stop(self) -> None:
        if self._role is not None and not self._role.is_stopping:
            self._role.stop()
            self._announce()
            self._pump()

    def _on_watchdog(self) -> None:
        waited = time.monotonic() - self._last_progress
        if self._role is None or self.fault or waited < self.parameters.progress_timeout:
            return
        if self._is_held:
            self.on_fault(f"the recorder has opened no bag for {waited:.1f} s")
        else:
            self.on_fault(
                f"the plant has consumed nothing for {waited:.1f} s "
                f"(sent {self._role.sent} samples, consumed {self._role.consumed})"
            )


def main() -> int:
    """Run the node."""
    return run_node(SignalGeneratorNode)

"""The signal generator: plays drive programs, a bounded number of samples ahead of the plant."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from imotor_msgs.action import CorrectExcitation, PlayProgram
from imotor_msgs.msg import RecordingState
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.publisher import Publisher
from rclpy.task import Future
from std_srvs.srv import Trigger

from imotor_ros.campaign.roles.generator import GeneratorRole
from imotor_ros.contracts.excitation_messages import (
    CORRECT_ACTION,
    excitation_fields,
    feedback_fields,
    refusal_to_message,
    request_from_message,
)
from imotor_ros.contracts.messages import program_from_message, program_to_message
from imotor_ros.contracts.topics import (
    CHANNELS,
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    RECORDING,
    ROD_VELOCITY,
)
from imotor_ros.core.correction import Excitation
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.drive_limits import DriveLimits
from imotor_ros.core.parameters import group, parameter
from imotor_ros.core.trial import Steps
from imotor_ros.errors import DriveFaultError, DriveLimitError, ImotorError
from imotor_ros.nodes.stand_node import NodeParameters, StandNode, run_node
from imotor_ros.nodes.trial_collector import TrialCollector

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
    limits: DriveLimits = group(DriveLimits)


class SignalGeneratorNode(StandNode[SignalGeneratorParameters]):
    """
    Plays drive programs given by the action ``drive/play``, within the limits of the motor.

    The goal is a DriveProgram; the feedback tells samples sent and consumed. Cancelling, or
    the service ``drive/stop``, brings the voltage to zero by a ramp. With the parameter
    ``awaits_recording`` the program is announced at once, but played only when its bag is open:
    nothing of the run is lost, and a motor is not driven for a run that cannot be recorded.

    The action ``drive/correct`` finds the voltage for a wanted rod motion: it plays trials and
    measures what the rod did, by the topic rod/velocity. These are never recorded.
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
        self._correction = ActionServer(
            self,
            CorrectExcitation,
            CORRECT_ACTION,
            execute_callback=self._on_correct,
            cancel_callback=self._on_cancel,
        )
        self._collector: TrialCollector | None = None
        self._is_correcting = False
        self._stop_service = self.create_service(Trigger, "drive/stop", self._on_stop)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._watchdog = self.create_timer(0.2, self._on_watchdog, clock=steady)

    def configure(self) -> None:
        """Make the endpoints."""
        self._program_publisher = self.add_publisher(DRIVE_PROGRAM)
        self.add_publisher(DRIVE_VOLTAGE)
        self.add_subscription(DRIVE_PROGRESS, self._on_progress)
        self.add_subscription(RECORDING, self._on_recording)
        self.add_subscription(CHANNELS, self._on_channel)
        # raw, because it is of no interest but in a correction; without one it need not be there
        self.add_subscription(ROD_VELOCITY, self._on_rod_velocity, raw=True, is_awaited=False)

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
        outcome, role = self._why_not(goal), None
        if not outcome:
            try:
                program = program_from_message(goal.request.program)
                role = self._take_up(program)
            except ImotorError as error:
                outcome = str(error)
        if role is not None:
            self._goal = goal
            self._is_held = self.parameters.awaits_recording
            outcome = await self._play(role)
            self._goal = None
        _conclude(goal, outcome)
        if outcome not in (COMPLETED, CANCELLED):
            self.get_logger().error(f"program not played: {outcome}")
        consumed = 0 if role is None else role.consumed
        return PlayProgram.Result(consumed=consumed, outcome=outcome)

    def _why_not(self, goal: ServerGoalHandle) -> str:
        """Return why nothing can be played now, or nothing."""
        if not self.is_active:
            return "the signal generator is not active"
        if self.fault:
            return f"the signal generator has a fault: {self.fault}"
        if self._role is not None:
            return f"run {self._role.program.run_id} is being played"
        if self._is_correcting:
            return "an excitation is being corrected"
        return CANCELLED if goal.is_cancel_requested else ""

    def _take_up(self, program: DriveProgram) -> GeneratorRole:
        settings = self.parameters
        return GeneratorRole(program, settings.block_length, settings.window, settings.limits)

    async def _play(self, role: GeneratorRole) -> str:
        """Play a program to its end, and return the outcome."""
        self._role, self._finished = role, Future()
        self._last_progress = time.monotonic()
        self._announce()
        self._pump()
        outcome = str(await self._finished)
        self._role, self._finished, self._is_held = None, None, False
        return outcome

    # ---- correction ----------------------------------------------------------------------

    async def _on_correct(self, goal: ServerGoalHandle) -> CorrectExcitation.Result:
        result = CorrectExcitation.Result(outcome=self._why_not(goal))
        if not result.outcome:
            self._is_correcting = True
            try:
                found = await self._search(goal)
                result = CorrectExcitation.Result(**excitation_fields(self.types, found))
                result.outcome = COMPLETED
            except DriveLimitError as error:
                result.outcome = str(error)
                result.refusals = [refusal_to_message(self.types, error)]
            except ImotorError as error:
                result.outcome = str(error)
            self._is_correcting, self._collector = False, None
        _conclude(goal, result.outcome)
        if result.outcome not in (COMPLETED, CANCELLED):
            self.get_logger().warning(f"no excitation found: {result.outcome}")
        return result

    async def _search(self, goal: ServerGoalHandle) -> Excitation:
        """
        Play trial after trial until the voltage is found.

        Raises
        ------
        ImotorError
            If it is not found, or a trial does not come to its end.

        """
        request = request_from_message(goal.request)
        search = Steps(request.procedure(self.parameters.limits))
        while search.trial is not None:
            goal.publish_feedback(CorrectExcitation.Feedback(**feedback_fields(search.trial)))
            self._collector = TrialCollector(search.trial.program)
            outcome = await self._play(self._take_up(search.trial.program))
            if outcome != COMPLETED or goal.is_cancel_requested:
                raise DriveFaultError(CANCELLED if goal.is_cancel_requested else outcome)
            search.send(self._collector.recording())
        return search.result

    def _on_channel(self, message: Any) -> None:
        if self._collector is not None:
            self._collector.add_channel(message)
            self._end_if_finished()

    def _on_rod_velocity(self, data: bytes) -> None:
        if self._collector is not None:
            self._collector.add_block(data)
            self._last_progress = time.monotonic()
            self._end_if_finished()

    # ---- playing -------------------------------------------------------------------------

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
        self._end_if_finished()
        if not role.is_finished:
            self._pump()

    def _end_if_finished(self) -> None:
        """End the program once it is consumed, and in a trial measured as well."""
        role, collector = self._role, self._collector
        if role is None or not role.is_finished:
            return
        if role.is_stopping:
            self._end(CANCELLED)
        elif collector is None or collector.is_complete:
            self._end(COMPLETED)

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
        elif self._role.is_finished and self._collector is not None:
            self.on_fault(
                f"no rod velocity has come for {waited:.1f} s ({self._collector.progress})"
            )
        else:
            self.on_fault(
                f"the plant has consumed nothing for {waited:.1f} s "
                f"(sent {self._role.sent} samples, consumed {self._role.consumed})"
            )


def _conclude(goal: ServerGoalHandle, outcome: str) -> None:
    """Bring a goal into the state that its outcome asks for."""
    if outcome == CANCELLED and goal.is_cancel_requested:
        goal.canceled()
    elif outcome in (COMPLETED, CANCELLED):
        goal.succeed()
    else:
        goal.abort()


def main() -> int:
    """Run the node."""
    return run_node(SignalGeneratorNode)

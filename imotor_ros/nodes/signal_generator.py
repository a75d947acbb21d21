"""The signal generator: plays drive programs, a bounded number of samples ahead of the plant."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from imotor_msgs.action import CorrectExcitation, PlayProgram
from imotor_msgs.msg import RecordingState, StandState
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.publisher import Publisher
from rclpy.task import Future
from std_srvs.srv import Trigger

from imotor_ros.campaign.roles.generator import GeneratorRole
from imotor_ros.contracts.blocks import SampleBlock
from imotor_ros.contracts.excitation_messages import (
    CORRECT_ACTION,
    excitation_fields,
    feedback_fields,
    refusal_to_message,
    request_from_message,
)
from imotor_ros.contracts.messages import program_from_message, program_to_message
from imotor_ros.contracts.outcomes import CANCELLED, COMPLETED
from imotor_ros.contracts.topics import (
    CHANNELS,
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    RECORDING,
    ROD_VELOCITY,
)
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.correction import Excitation
from imotor_ros.core.drive import DriveProgram, Ending
from imotor_ros.core.drive_limits import DriveLimits
from imotor_ros.core.parameters import group, parameter
from imotor_ros.core.trial import Steps
from imotor_ros.errors import (
    BadInputError,
    DeadlineError,
    DriveFaultError,
    DriveLimitError,
    ImotorError,
)
from imotor_ros.nodes.stand_node import NodeParameters, StandNode, run_node
from imotor_ros.nodes.stand_state import PULSE_INTERVAL, StatePublisher
from imotor_ros.nodes.trial_collector import TrialCollector

STOP_PATIENCE = 2.0
"""Longest time (s) in which a stopped program may make no progress; then the driver is told."""

_RETRY_INTERVAL = 0.005
"""Pause (s) before a block that a slow reader has not let through is sent again."""


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

    When a program cannot be brought to its end, the driver is told to bring the voltage to zero
    by itself. The topic ``state`` tells what the stand does and which node has a fault, whatever
    state of its lifecycle this node is in.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("signal_generator", SignalGeneratorParameters, context=context, **options)
        self._role: GeneratorRole | None = None
        self._finished: Future | None = None
        self._goal: ServerGoalHandle | None = None
        self._last_progress = 0.0
        self._is_held = False
        self._unsent: SampleBlock | None = None
        self._unsent_since = 0.0
        self._left_on = ""
        self._played: set[str] = set()
        self._stops = 0
        self._stops_at_acceptance: dict[bytes, int] = {}
        self._program_publisher: Publisher | None = None
        self._collector: TrialCollector | None = None
        self._is_correcting = False
        self._actions = [
            ActionServer(
                self,
                kind,
                name,
                execute_callback=carry_out,
                handle_accepted_callback=self._on_accepted,
                cancel_callback=self._on_cancel,
            )
            for kind, name, carry_out in (
                (PlayProgram, "drive/play", self._on_play),
                (CorrectExcitation, CORRECT_ACTION, self._on_correct),
            )
        ]
        self._stop_service = self.create_service(Trigger, "drive/stop", self._on_stop)
        self._state = StatePublisher(self, self.types)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._watchdog = self.create_timer(PULSE_INTERVAL, self._on_watchdog, clock=steady)
        self._retry_timer = self.create_timer(_RETRY_INTERVAL, self._on_retry_timer, clock=steady)
        self._retry_timer.cancel()
        self._tell_state()

    def configure(self) -> None:
        """Make the endpoints."""
        self._program_publisher = self.add_publisher(DRIVE_PROGRAM)
        self.add_publisher(DRIVE_VOLTAGE)
        self.add_subscription(DRIVE_PROGRESS, self._on_progress, hears_in_fault=True)
        self.add_subscription(RECORDING, self._on_recording)
        self.add_subscription(CHANNELS, self._on_channel)
        # raw, because it is of no interest but in a correction; without one it need not be there
        self.add_subscription(ROD_VELOCITY, self._on_rod_velocity, raw=True, is_awaited=False)

    def activate(self) -> None:
        """Forget the runs before."""
        self._played.clear()

    def deactivate(self) -> None:
        """End the program that is being played, if any."""
        self._end("the signal generator was deactivated")

    def leave_output(self) -> None:
        """Have the voltage brought to zero because the process is about to end."""
        self._end("the signal generator was ended")

    def finish(self) -> None:
        """Have the voltage brought to zero because the process ends."""
        self.leave_output()

    def status_values(self) -> dict[str, object]:
        """Return run id and progress."""
        values: dict[str, object] = {"stops": self._stops}
        if self._role is not None:
            role = self._role
            values |= {
                "run_id": role.program.run_id,
                "ending": role.program.ending.name,
                "length": role.program.length,
                "sent": role.sent,
                "consumed": role.consumed,
                "awaits_recording": self._is_held,
                "correcting": self._is_correcting,
            }
        return values

    def _tell_state(self) -> None:
        role = self._role
        state = StandState.STATE_PREPARING if self._is_correcting else StandState.STATE_IDLE
        if role is None:
            self._state.publish(state, self.fault, "", 0, 0)
            return
        if role.is_stopping:
            state = StandState.STATE_STOPPING
        else:
            state = StandState.STATE_RUNNING if role.sent else StandState.STATE_PREPARING
        self._state.publish(state, self.fault, role.program.run_id, role.sent, role.consumed)

    def set_fault(self, reason: str) -> None:
        """Enter a fault, and show it in the state too."""
        super().set_fault(reason)
        self._tell_state()

    def _on_accepted(self, goal: ServerGoalHandle) -> None:
        # a stop that comes before the goal is carried out is meant for it too
        self._stops_at_acceptance[bytes(goal.goal_id.uuid)] = self._stops
        goal.execute()

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
        if self._stops_at_acceptance.pop(bytes(goal.goal_id.uuid), self._stops) != self._stops:
            return CANCELLED
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
        if program.run_id in self._played:
            # the nodes know a run by its id: they would take the second for the end of the first
            raise BadInputError(
                "was played already",
                where="run_id",
                value=program.run_id,
                bound="another one, or deactivate and activate all nodes first",
            )
        settings = self.parameters
        role = GeneratorRole(program, settings.block_length, settings.window, settings.limits)
        self._played.add(program.run_id)
        return role

    async def _play(self, role: GeneratorRole) -> str:
        """Play a program to its end, and return the outcome."""
        self._role, self._finished = role, Future()
        self._last_progress = time.monotonic()
        self._left_on = ""
        self._announce()
        self._pump()
        outcome = str(await self._finished)
        self._role, self._finished, self._is_held, self._unsent = None, None, False, None
        self._tell_state()
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
            self._tell_state()
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
        stops = self._stops
        request = request_from_message(goal.request)
        search = Steps(request.procedure(self.parameters.limits))
        while search.trial is not None:
            goal.publish_feedback(CorrectExcitation.Feedback(**feedback_fields(search.trial)))
            self._collector = TrialCollector(search.trial.program)
            outcome = await self._play(self._take_up(search.trial.program))
            if goal.is_cancel_requested or self._stops != stops:
                outcome = CANCELLED
            if outcome != COMPLETED:
                raise DriveFaultError(outcome)
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
        self._tell_state()

    def _pump(self) -> None:
        """Send what may be sent; while a reader is slow, stops and goals are heard in between."""
        role = self._role
        if role is None or self._is_held or role.program.ending is Ending.ABANDONED:
            return
        try:
            while (block := self._unsent or role.next_block()) is not None:
                if not self.try_to_publish_block(block):
                    self._try_later(block)
                    return
                self._unsent = None
        except ImotorError as error:
            self.on_fault(str(error))

    def _try_later(self, block: SampleBlock) -> None:
        now = time.monotonic()
        if self._unsent is None:
            self._unsent, self._unsent_since = block, now
        longest = self.parameters.publish_timeout
        if now - self._unsent_since > longest:
            raise DeadlineError("a reader of drive/voltage to take samples", longest)
        self._retry_timer.reset()

    def _on_retry_timer(self) -> None:
        self._retry_timer.cancel()
        self._pump()

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
        if message.run_id == self._left_on and message.flags & SampleFlag.RAMPED_DOWN:
            self._left_on = ""
        role = self._role
        if self.fault or role is None or message.run_id != role.program.run_id:
            return
        if message.fault:
            self._end(message.fault, is_driver_told=True)
            return
        role.acknowledge(int(message.consumed))
        self._last_progress = time.monotonic()
        if self._goal is not None:
            feedback = PlayProgram.Feedback(sent=role.sent, consumed=role.consumed)
            self._goal.publish_feedback(feedback)
        self._end_if_finished()
        if not role.is_finished:
            self._pump()
        self._tell_state()

    def _end_if_finished(self) -> None:
        """End the program once it is consumed, and in a trial measured as well."""
        role, collector = self._role, self._collector
        if role is None or not role.is_finished:
            return
        if role.is_stopping:
            self._end(CANCELLED)
        elif collector is None or collector.is_complete:
            self._end(COMPLETED)

    def _end(self, outcome: str, *, is_driver_told: bool = False) -> None:
        """End the program; a driver that does not know it yet brings the voltage to zero."""
        if self._finished is None or self._finished.done():
            return
        if outcome not in (COMPLETED, CANCELLED) and not is_driver_told:
            self._abandon()
        self._finished.set_result(outcome)

    def _abandon(self) -> None:
        assert self._role is not None
        if self._role.is_voltage_on:
            self._left_on = self._role.program.run_id
        self._role.abandon()
        self._announce()

    def on_fault(self, reason: str) -> None:
        """End the program with the reason."""
        super().on_fault(reason)
        self._end(reason)

    def _on_cancel(self, _goal: ServerGoalHandle) -> CancelResponse:
        self._stop()
        return CancelResponse.ACCEPT

    def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._stops += 1
        self._stop()
        response.success = not self._left_on
        if self._left_on:
            response.message = (
                f"the driver was told to bring the voltage of run {self._left_on} to zero, "
                "but has not confirmed it"
            )
        elif self._role is not None:
            response.message = "the voltage goes to zero"
        else:
            response.message = "the voltage is at zero"
        return response

    def _stop(self) -> None:
        if self._role is not None and not self._role.is_stopping:
            self._role.stop()
            self._last_progress = time.monotonic()
            self._announce()
            self._pump()

    def _on_watchdog(self) -> None:
        self._state.advance()
        self._tell_state()
        role, waited = self._role, time.monotonic() - self._last_progress
        if role is None or self.fault:
            return
        if role.is_stopping and role.is_voltage_on and waited > STOP_PATIENCE:
            self._end(f"stopped, but the driver has consumed nothing for {waited:.1f} s")
        elif waited > self.parameters.progress_timeout and self._unsent is None:
            self.on_fault(self._complaint(role, waited))

    def _complaint(self, role: GeneratorRole, waited: float) -> str:
        """Return what has been waited for in vain."""
        if self._is_held:
            return f"the recorder has opened no bag for {waited:.1f} s"
        if role.is_finished and self._collector is not None:
            return f"no rod velocity has come for {waited:.1f} s ({self._collector.progress})"
        return (
            f"the plant has consumed nothing for {waited:.1f} s "
            f"(sent {role.sent} samples, consumed {role.consumed})"
        )


def _conclude(goal: ServerGoalHandle, outcome: str) -> None:
    """Bring a goal into the state that its outcome asks for; one that was stopped is aborted."""
    if outcome == CANCELLED and goal.is_cancel_requested:
        goal.canceled()
    elif outcome == COMPLETED:
        goal.succeed()
    else:
        goal.abort()


def main() -> int:
    """Run the node."""
    return run_node(SignalGeneratorNode)

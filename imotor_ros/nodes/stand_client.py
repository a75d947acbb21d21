"""The orchestrator's side of the stand: services, the play action, and what the nodes report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imotor_msgs.action import CorrectExcitation, PlayProgram
from imotor_msgs.msg import Performance as PerformanceMessage
from imotor_msgs.msg import RecordingState, RunInfo
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import ListParameters, SetParametersAtomically
from rclpy.action import ActionClient
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from imotor_ros.contracts.excitation_messages import CORRECT_ACTION, request_fields
from imotor_ros.contracts.messages import program_to_message, run_info_to_message
from imotor_ros.contracts.topics import DIAGNOSTICS, PERFORMANCE, RECORDING, RUN_INFO
from imotor_ros.core.correction import ExcitationRequest
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.parameters import Parameters
from imotor_ros.errors import DeadlineError, RecordingError, RunError
from imotor_ros.nodes.excitation_search import ExcitationSearch
from imotor_ros.nodes.message_types import RclpyTypes
from imotor_ros.nodes.middleware import join_graph
from imotor_ros.nodes.namespace_claim import DISCOVERY_TIME, namespace_taken
from imotor_ros.nodes.parameters import parameter_values
from imotor_ros.nodes.qos import qos_profile

CONFIGURE = Transition.TRANSITION_CONFIGURE
ACTIVATE = Transition.TRANSITION_ACTIVATE
DEACTIVATE = Transition.TRANSITION_DEACTIVATE
CLEAN_UP = Transition.TRANSITION_CLEANUP

TRANSITION_NAMES = {
    CONFIGURE: "configure",
    ACTIVATE: "activate",
    DEACTIVATE: "deactivate",
    CLEAN_UP: "clean up",
}

_TARGETS = {
    CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    ACTIVATE: State.PRIMARY_STATE_ACTIVE,
    DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    CLEAN_UP: State.PRIMARY_STATE_UNCONFIGURED,
}

_FAULT_TIMEOUT = 2.0
"""Longest wait (s) for the reason of a failed transition."""

_RETRY_INTERVAL = 3.0
"""Time (s) after which a request without answer is sent again."""


class StandClient:
    """
    Talks to the nodes of one stand, from the thread that calls it.

    Parameters
    ----------
    namespace : str
        Namespace of the stand.
    watch : callable
        Called again and again while waiting; raises if a node has gone.

    """

    def __init__(self, namespace: str, watch: Callable[[], None]) -> None:
        self._context = Context()
        join_graph(self._context)
        self.node = Node("run_campaign", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._watch = watch
        self._namespace = namespace.rstrip("/")
        self._types = RclpyTypes()
        self._clients: dict[tuple[str, str], Client] = {}
        self._faults: dict[str, str] = {}
        self.performances: list[PerformanceMessage] = []
        self.recordings: list[RecordingState] = []
        self._player = ActionClient(self.node, PlayProgram, "drive/play")
        self._corrector = ActionClient(self.node, CorrectExcitation, CORRECT_ACTION)
        self._run_info = self.node.create_publisher(RunInfo, RUN_INFO.name, qos_profile(RUN_INFO))
        subscribe = self.node.create_subscription
        for topic, kind, callback in (
            (PERFORMANCE, PerformanceMessage, self.performances.append),
            (RECORDING, RecordingState, self.recordings.append),
            (DIAGNOSTICS, DiagnosticArray, self._on_diagnostics),
        ):
            subscribe(kind, topic.name, callback, qos_profile(topic))

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown(timeout_sec=1.0)
        for client in (self._player, self._corrector):
            client.destroy()  # it would keep the node, and its name, in the graph
        self.node.destroy_node()
        self._context.try_shutdown()

    # ---- waiting -------------------------------------------------------------------------

    def spin(self, seconds: float) -> None:
        """Handle what comes within so many seconds, at least one thing; watch the nodes."""
        self._executor.spin_once(timeout_sec=seconds)
        self._watch()

    def spin_until(
        self, condition: Callable[[], bool], awaited: str | Callable[[], str], timeout: float
    ) -> None:
        """
        Wait for a condition.

        Raises
        ------
        DeadlineError
            If it does not come true in time.

        """
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                text = awaited if isinstance(awaited, str) else awaited()
                raise DeadlineError(text, timeout)
            self.spin(0.02)

    def refuse_occupied_namespace(self) -> None:
        """
        Check that no other stand is in the namespace: its nodes would mix with ours.

        Raises
        ------
        BadInputError
            If there are nodes in it already.

        """
        deadline = time.monotonic() + DISCOVERY_TIME
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)
            found = self.node.get_node_names_and_namespaces()
            others = {name for name, space in found if space.rstrip("/") == self._namespace}
            if others - {self.node.get_name()} or self._has_twin(found):
                holders = sorted(others - {self.node.get_name()} or others)
                raise namespace_taken(self._namespace, ", ".join(holders))

    def _has_twin(self, found: list[tuple[str, str]]) -> bool:
        own = (self.node.get_name(), self.node.get_namespace())
        return found.count(own) > 1

    # ---- nodes ---------------------------------------------------------------------------

    def fault_of(self, node: str) -> str:
        """Return the fault that a node has reported, or nothing."""
        return self._faults.get(node, "")

    def check_faults(self) -> None:
        """
        Check that no node has reported a fault.

        Raises
        ------
        RecordingError
            If the recorder has failed.
        RunError
            If another node has a fault.

        """
        if self.recordings and self.recordings[-1].state == RecordingState.STATE_FAILED:
            raise RecordingError(self.recordings[-1].error)
        for node, fault in self._faults.items():
            if fault:
                raise RunError(f"{node}: {fault}")

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            node = status.name.partition(":")[0].rpartition("/")
            if f"/{node[0]}" == self._namespace:
                is_fault = status.level == DiagnosticStatus.ERROR
                self._faults[node[2]] = status.message if is_fault else ""

    def _client(self, kind: Any, node: str, service: str) -> Client:
        key = (node, service)
        if key not in self._clients:
            name = f"{self._namespace}/{node}/{service}"
            self._clients[key] = self.node.create_client(kind, name)
        return self._clients[key]

    def wait_for_nodes(self, nodes: Iterable[str], timeout: float) -> None:
        """
        Wait until nodes can be managed.

        Raises
        ------
        DeadlineError
            If they do not come up in time.

        """
        clients = {
            node: (
                self._client(ChangeState, node, "change_state"),
                self._client(SetParametersAtomically, node, "set_parameters_atomically"),
            )
            for node in nodes
        }

        def absent() -> list[str]:
            return [n for n, pair in clients.items() if not all(c.service_is_ready() for c in pair)]

        self.spin_until(
            lambda: not absent(), lambda: f"node(s) {', '.join(absent())} to come up", timeout
        )

    def declared_parameters(self, node: str, timeout: float) -> list[str]:
        """Return the names of the parameters that a node has."""
        requests = {node: ListParameters.Request()}
        answers = self._call(
            ListParameters, "list_parameters", requests, "to list its parameters", timeout
        )
        return list(answers[node].result.names)

    def set_parameters(
        self, values: Mapping[str, Parameters | Mapping[str, Any]], timeout: float
    ) -> None:
        """
        Set parameters of several nodes, given as parameter objects or by dotted name.

        Raises
        ------
        RunError
            If a node refuses.

        """
        requests = {}
        for node, parameters in values.items():
            request = SetParametersAtomically.Request()
            request.parameters = [
                Parameter(name, value=value).to_parameter_msg()
                for name, value in _leaves(parameters).items()
            ]
            requests[node] = request
        answers = self._call(
            SetParametersAtomically, "set_parameters_atomically", requests,
            "to take parameters", timeout,
        )  # fmt: skip
        for node, answer in answers.items():
            if not answer.result.successful:
                raise RunError(f"{node} refuses its parameters: {answer.result.reason}")

    def change_state(self, nodes: Iterable[str], transition: int, timeout: float) -> None:
        """
        Make several nodes take a lifecycle transition, together.

        Raises
        ------
        RunError
            If one fails.

        """
        request = ChangeState.Request(transition=Transition(id=transition))
        what = TRANSITION_NAMES[transition]
        answers = self._call(
            ChangeState, "change_state", dict.fromkeys(nodes, request), f"to {what}", timeout
        )
        refused = [node for node, answer in answers.items() if not answer.success]
        # a node asked twice, because its answer was lost, refuses the second time
        for node in self._not_in_state(refused, _TARGETS[transition], timeout):
            self._await_fault(node)
            raise RunError(f"{node} did not {what}: {self.fault_of(node) or 'no reason given'}")

    def _not_in_state(self, nodes: list[str], state: int, timeout: float) -> list[str]:
        requests = dict.fromkeys(nodes, GetState.Request())
        answers = self._call(GetState, "get_state", requests, "to tell its state", timeout)
        return [node for node, answer in answers.items() if answer.current_state.id != state]

    def _call(
        self, kind: Any, service: str, requests: Mapping[str, Any], what: str, timeout: float
    ) -> dict[str, Any]:
        """
        Call a service of several nodes at once, and return their answers.

        On a busy machine an answer is lost if the client has found the server, but not yet the
        server the client: a request that stays without answer is sent again.
        """
        futures: dict[str, list[Future]] = {node: [] for node in requests}
        deadline = time.monotonic() + timeout
        while late := [n for n, sent in futures.items() if not any(f.done() for f in sent)]:
            for node in late:
                client = self._client(kind, node, service)
                futures[node].append(client.call_async(requests[node]))
            pause = time.monotonic() + _RETRY_INTERVAL
            while time.monotonic() < pause and any(
                not any(f.done() for f in futures[node]) for node in late
            ):
                if time.monotonic() > deadline:
                    raise DeadlineError(f"{', '.join(late)} {what}", timeout)
                self.spin(0.02)
        return {n: next(f for f in sent if f.done()).result() for n, sent in futures.items()}

    def _await_fault(self, node: str) -> None:
        """Give a node's diagnostics a moment to come."""
        deadline = time.monotonic() + _FAULT_TIMEOUT
        while not self.fault_of(node) and time.monotonic() < deadline:
            self.spin(0.02)

    def await_performance(self, count: int, timeout: float) -> None:
        """
        Wait until the evaluator has reported more than `count` times, or the bag is closed.

        Raises
        ------
        DeadlineError
            If neither happens in time.

        """
        self.spin_until(
            lambda: len(self.performances) > count or self.is_recorded,
            "the evaluator and the recorder to finish the run",
            timeout,
        )

    @property
    def is_recorded(self) -> bool:
        """Whether the recorder has closed the bag of the run, or failed to."""
        ends = (RecordingState.STATE_CLOSED, RecordingState.STATE_FAILED)
        return bool(self.recordings) and self.recordings[-1].state in ends

    # ---- the run -------------------------------------------------------------------------

    def begin_run(self, program: DriveProgram, run_info_json: str) -> None:
        """Forget the last run, and announce what the next one is."""
        self.performances.clear()
        self.recordings.clear()
        self._faults.clear()
        message = run_info_to_message(self._types, program.run_id, program.epoch, run_info_json)
        self._run_info.publish(message)

    def search(self, request: ExcitationRequest, timeout: float) -> ExcitationSearch:
        """
        Have the signal generator find a voltage; return at once what stands for the search.

        Raises
        ------
        DeadlineError
            If the generator does not take the request.

        """
        self._faults.clear()
        search = ExcitationSearch(request)
        self.spin_until(
            self._corrector.server_is_ready, f"the action {CORRECT_ACTION} of signal_generator",
            timeout,
        )  # fmt: skip
        goal = CorrectExcitation.Goal(**request_fields(self._types, request))
        accepted = self._corrector.send_goal_async(goal, feedback_callback=search.on_feedback)
        self.spin_until(accepted.done, "signal_generator to take the request", timeout)
        search.follow(accepted.result())
        return search

    def play(self, program: DriveProgram, timeout: float) -> PlayedProgram:
        """
        Have the signal generator play a program; return at once what stands for it.

        Raises
        ------
        DeadlineError
            If the generator does not take the program.

        """
        played = PlayedProgram()
        self.spin_until(
            self._player.server_is_ready, "the action drive/play of signal_generator", timeout
        )
        goal = PlayProgram.Goal(program=program_to_message(self._types, program))
        accepted = self._player.send_goal_async(goal, feedback_callback=played.on_feedback)
        self.spin_until(accepted.done, "signal_generator to take the program", timeout)
        played.follow(accepted.result())
        return played


def _leaves(parameters: Parameters | Mapping[str, Any]) -> Mapping[str, Any]:
    return parameter_values(parameters) if isinstance(parameters, Parameters) else parameters


class PlayedProgram:
    """A program that is being played."""

    def __init__(self) -> None:
        self.consumed = 0
        self.outcome = ""
        self.is_done = False
        self._handle: Any = None

    def has_passed(self, consumed: int) -> bool:
        """Whether more samples than these are consumed, or the program has ended."""
        return self.is_done or self.consumed > consumed

    def follow(self, handle: Any) -> None:
        """Take the goal's handle, and ask for its result."""
        self._handle = handle
        if not handle.accepted:
            self.is_done, self.outcome = True, "refused"
            return
        handle.get_result_async().add_done_callback(self._on_result)

    def on_feedback(self, message: Any) -> None:
        """Take note of progress."""
        self.consumed = max(self.consumed, int(message.feedback.consumed))

    def _on_result(self, future: Future) -> None:
        answer = future.result()
        self.consumed = max(self.consumed, int(answer.result.consumed))
        self.outcome = answer.result.outcome
        self.is_done = True
        if answer.status == GoalStatus.STATUS_UNKNOWN and not self.outcome:
            self.outcome = "unknown"

    def cancel(self) -> None:
        """Ask for the voltage to go to zero and the program to end."""
        if self._handle is not None and not self.is_done:
            self._handle.cancel_goal_async()

"""The lifecycle that all nodes share: peers, reasons of failure, refused transitions, clean-up."""

from __future__ import annotations

from typing import Any

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.lifecycle import TransitionCallbackReturn

from imotor_ros.contracts.topics import LOAD_FORCE, RUN_INFO, TRUE_LOAD_FORCE
from imotor_ros.errors import RunError
from imotor_ros.nodes.force_sensor import ForceSensorNode

DONE, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)

IMPATIENT = {"match_timeout": 0.1}


def state(node: Any) -> str:
    """Return the lifecycle state of a node."""
    return str(node._state_machine.current_state[1])


class Fragile(ForceSensorNode):
    """A force sensor whose next transition raises `error`."""

    error: Exception | None = None

    def _break(self) -> None:
        error, self.error = self.error, None
        if error is not None:
            raise error

    def configure(self) -> None:
        super().configure()
        self._break()

    def activate(self) -> None:
        super().activate()
        if self.is_configured:
            self._break()

    def deactivate(self) -> None:
        self._break()

    def cleanup(self) -> None:
        self._break()

    @property
    def is_configured(self) -> bool:
        return state(self) == "activating"


# ---- peers -----------------------------------------------------------------------------------


def test_activation_without_a_writer_fails_with_the_reason(graph: Any) -> None:
    node = graph.add(ForceSensorNode, expected_readers="load/force=0", **IMPATIENT)
    assert node.trigger_configure() is DONE
    assert node.trigger_activate() is FAILURE
    assert state(node) == "inactive"
    graph.await_fault(node, "waited 0.1 s for a writer of truth/load_force, in vain")


def test_activation_without_readers_fails_with_their_number(graph: Any) -> None:
    graph.write(TRUE_LOAD_FORCE)
    graph.hear(LOAD_FORCE)
    node = graph.add(ForceSensorNode, expected_readers="load/force=2", **IMPATIENT)
    assert node.trigger_configure() is DONE
    assert node.trigger_activate() is FAILURE
    graph.await_fault(node, "waited 0.1 s for 2 reader(s) of load/force (found 1), in vain")


def test_activation_is_granted_once_the_peers_are_there(graph: Any) -> None:
    """And the fault of the first attempt is gone, from the diagnostics as well."""
    node = graph.add(ForceSensorNode)
    node.trigger_configure()
    node.set_parameters([_timeout(0.1)])
    assert node.trigger_activate() is FAILURE
    graph.await_fault(node, "in vain")
    graph.write(TRUE_LOAD_FORCE)
    graph.hear(LOAD_FORCE)
    node.set_parameters([_timeout(10.0)])
    assert node.trigger_activate() is DONE
    assert state(node) == "active"
    graph.spin_until(lambda: last_message(graph) == "active", "diagnostics without fault")


def _timeout(seconds: float) -> Any:
    from rclpy.parameter import Parameter

    return Parameter("match_timeout", value=seconds)


def last_message(graph: Any) -> str:
    """Return what the last diagnostics say."""
    return graph.diagnostics[-1].status[0].message if graph.diagnostics else ""


# ---- transitions -----------------------------------------------------------------------------


def change_state(graph: Any, node: Any, transition: int) -> bool:
    """Ask for a transition over the service; return the answer."""
    client = graph.probe.create_client(ChangeState, f"{node.get_name()}/change_state")
    graph.spin_until(client.service_is_ready, "the service change_state")
    answer = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
    graph.spin_until(answer.done, "the answer of change_state")
    return bool(answer.result().success)


@pytest.mark.parametrize(
    "transition",
    [Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CLEANUP, 99],
    ids=["activate", "clean up", "unknown"],
)
def test_transition_that_the_state_does_not_have_is_answered_no(
    graph: Any, transition: int
) -> None:
    node = graph.add(ForceSensorNode)
    assert change_state(graph, node, transition) is False
    client = graph.probe.create_client(GetState, "force_sensor/get_state")
    graph.spin_until(client.service_is_ready, "the service get_state")
    answer = client.call_async(GetState.Request())
    graph.spin_until(answer.done, "the node to tell its state")
    assert answer.result().current_state.id == State.PRIMARY_STATE_UNCONFIGURED
    assert change_state(graph, node, Transition.TRANSITION_CONFIGURE) is True


def test_round_trips_through_the_lifecycle(graph: Any) -> None:
    """Activated again, and configured again, a node has its endpoints once."""
    graph.write(TRUE_LOAD_FORCE)
    graph.hear(LOAD_FORCE)
    node = graph.add(ForceSensorNode)
    name = f"{graph.namespace}/load/force"
    for _ in range(2):
        assert node.trigger_configure() is DONE
        for _ in range(2):
            assert node.trigger_activate() is DONE
            assert node.is_active
            assert node.trigger_deactivate() is DONE
            assert not node.is_active
        assert node.count_publishers(name) == 1
        assert node.trigger_cleanup() is DONE
        graph.spin_until(lambda: node.count_publishers(name) == 0, "the endpoints to be gone")
    assert state(node) == "unconfigured"


@pytest.mark.parametrize(
    ("error", "answer", "text"),
    [
        (RunError("no sensor is connected"), FAILURE, "cannot configure: no sensor is connected"),
        (ZeroDivisionError("oops"), ERROR, "ZeroDivisionError: oops"),
    ],
)
def test_exception_in_configure_fails_the_transition_and_is_told(
    graph: Any, error: Exception, answer: TransitionCallbackReturn, text: str,
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """What is foreseen is told in one line, the rest with traceback; both can be mended."""
    node = graph.add(Fragile)
    node.error = error
    assert node.trigger_configure() is answer
    assert state(node) == "unconfigured"
    graph.await_fault(node, text)
    assert text in capfd.readouterr().err, "the log has it too"
    name = f"{graph.namespace}/load/force"
    graph.spin_until(lambda: node.count_publishers(name) == 0, "the endpoints to be taken down")
    assert node.trigger_configure() is DONE
    assert node.fault == ""


def test_exception_in_activate_takes_the_node_back(graph: Any) -> None:
    graph.write(TRUE_LOAD_FORCE)
    graph.hear(LOAD_FORCE)
    node = graph.add(Fragile)
    node.trigger_configure()
    node.error = RunError("the sensor is overloaded")
    assert node.trigger_activate() is FAILURE
    assert (state(node), node.is_active) == ("inactive", False)
    node.error = ZeroDivisionError("oops")
    assert node.trigger_activate() is ERROR
    assert (state(node), node.is_active) == ("unconfigured", False)
    graph.await_fault(node, "ZeroDivisionError: oops")
    graph.start(node)


def test_exception_in_deactivate_and_cleanup_is_told(graph: Any) -> None:
    graph.write(TRUE_LOAD_FORCE)
    graph.hear(LOAD_FORCE)
    node = graph.add(Fragile)
    graph.start(node)
    node.error = ValueError("stuck")
    assert node.trigger_deactivate() is ERROR
    assert not node.binding.is_locked
    graph.await_fault(node, "ValueError: stuck")
    node.trigger_configure()
    node.error = ValueError("glued")
    assert node.trigger_cleanup() is ERROR
    graph.await_fault(node, "ValueError: glued")


def test_exception_in_a_callback_becomes_a_fault_and_the_node_lives(graph: Any) -> None:
    class Grumpy(ForceSensorNode):
        def configure(self) -> None:
            super().configure()
            self.add_subscription(RUN_INFO, self._on_run_info)

        def _on_run_info(self, message: Any) -> None:
            raise KeyError(message.run_id)

    from imotor_ros.contracts.messages import run_info_to_message

    node = graph.add(Grumpy)
    node.trigger_configure()
    graph.send(RUN_INFO, run_info_to_message(graph.types, "run-1", 0, "{}"))
    graph.await_fault(node, "KeyError: 'run-1'")
    assert change_state(graph, node, Transition.TRANSITION_CLEANUP) is True


def test_shutdown_leaves_a_node_that_does_nothing_more(graph: Any) -> None:
    graph.write(TRUE_LOAD_FORCE)
    graph.hear(LOAD_FORCE)
    node = graph.add(ForceSensorNode)
    graph.start(node)
    assert change_state(graph, node, Transition.TRANSITION_ACTIVE_SHUTDOWN) is True
    assert state(node) == "finalized"
    assert node.is_shut_down, "which ends its process"
    assert not node.is_active

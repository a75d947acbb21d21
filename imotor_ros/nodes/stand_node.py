"""What all nodes of the stand have in common: lifecycle, streams, peers, faults, diagnostics."""

from __future__ import annotations

import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from imotor_ros.contracts.blocks import SampleBlock
from imotor_ros.contracts.messages import block_from_message, block_to_message
from imotor_ros.contracts.topics import DEFAULT_NAMESPACE, DIAGNOSTICS, Intent, Topic
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.errors import BadInputError, DeadlineError, ImotorError
from imotor_ros.nodes.message_types import RclpyTypes, message_class
from imotor_ros.nodes.middleware import join_graph
from imotor_ros.nodes.parameters import ParameterBinding
from imotor_ros.nodes.qos import qos_profile


@dataclass(frozen=True)
class NodeParameters(Parameters):
    """Parameters that every node of the stand has."""

    match_timeout: float = parameter(
        15.0, "longest wait for the peers at activation", unit="s", low=0.0, high=3600.0
    )
    publish_timeout: float = parameter(
        30.0, "longest wait for a slow reader of a stream", unit="s", low=0.0, high=3600.0
    )
    expected_readers: str = parameter(
        "", 'readers to wait for at activation, e.g. "drive/voltage=2"; where not named, one'
    )

    @property
    def reader_counts(self) -> dict[str, int]:
        """Number of readers to wait for, by topic."""
        pairs = (item.partition("=") for item in self.expected_readers.split())
        return {topic: int(count) for topic, _, count in pairs}

    def check(self) -> None:
        """Check the form of `expected_readers`."""
        for item in self.expected_readers.split():
            topic, _, count = item.partition("=")
            if not topic or not count.isdigit():
                raise BadInputError(
                    "does not parse",
                    where="expected_readers",
                    value=item,
                    bound='a list like "drive/voltage=2 load/force=1"',
                )


P = TypeVar("P", bound=NodeParameters)

_DRAIN_TIMEOUT = 5.0
"""Longest time (s) that a node goes on reading after it was told to end."""

_HAND_OVER_TIMEOUT = 3.0
"""Longest time (s) that a node that ends waits for its readers to have what it sent."""

_QUIET_TIME = 0.2
"""Time (s) without a message after which there is nothing left to read: some heartbeats."""


class StandNode(LifecycleNode, Generic[P]):
    """
    A lifecycle node of the stand.

    Derived classes extend `configure`, `activate`, `deactivate` and `cleanup`, which raise an
    `ImotorError` where they cannot do what is asked: the transition then fails, and the reason
    is logged and shown in the diagnostics.

    Parameters
    ----------
    role : str
        Default name of the node.
    parameters_class : type
        Parameter class of the node.
    context : Context, optional
        rclpy context.
    **options
        Passed on to `rclpy.lifecycle.LifecycleNode`.

    """

    hardware_id = "virtual"
    """What the node drives or measures with, for the diagnostics."""

    def __init__(
        self,
        role: str,
        parameters_class: type[P],
        *,
        context: Context | None = None,
        **options: Any,
    ) -> None:
        options.setdefault("namespace", DEFAULT_NAMESPACE)
        super().__init__(role, context=context, **options)
        self.types = RclpyTypes()
        self.binding = ParameterBinding(self, parameters_class)
        self.fault = ""
        self.is_active = False
        self.is_shut_down = False
        self._stream_publishers: dict[str, Publisher] = {}
        self._stream_subscriptions: dict[str, Subscription] = {}
        self._other_endpoints: list[Publisher | Subscription] = []
        self._diagnostics = self.create_publisher(
            DiagnosticArray, DIAGNOSTICS.name, qos_profile(DIAGNOSTICS)
        )
        self._refuse_transitions_politely()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics_timer = self.create_timer(1.0, self._publish_diagnostics, clock=steady)

    def _refuse_transitions_politely(self) -> None:
        """Answer "no" to a transition that the state does not have: rclpy 7 ends the node."""
        change_state = self._service_change_state.callback

        def answer(request: Any, response: Any) -> Any:
            try:
                return change_state(request, response)
            except RCLError as error:
                self.get_logger().warning(f"transition refused: {error}")
                response.success = False
                return response

        self._service_change_state.callback = answer

    @property
    def parameters(self) -> P:
        """The parameters as they are now."""
        return self.binding.value

    # ---- for derived classes -------------------------------------------------------------

    def configure(self) -> None:
        """Make the endpoints."""

    def activate(self) -> None:
        """Make ready for a new run with the parameters as they are; all peers are there."""

    def deactivate(self) -> None:
        """Stop working; whatever is under way is brought to its end."""

    def cleanup(self) -> None:
        """Let go of what `configure` made; the endpoints go by themselves."""

    def received_count(self) -> int:
        """Return how many messages came; while it grows, an ending process goes on reading."""
        return 0

    def finish(self) -> None:
        """Bring open work to its end because the process is about to end."""

    def leave_output(self) -> None:
        """Put out nothing that must not stay: the process was just told to end."""

    def status_values(self) -> dict[str, object]:
        """Return what the diagnostics show beside the state."""
        return {}

    def warning(self) -> str:
        """Return what is not as it should be, but no fault; empty if there is nothing."""
        return ""

    def subject(self, topic: Topic) -> str:
        """Return a topic's name below the namespace after remapping, e.g. "slider/velocity"."""
        resolved = str(self.resolve_topic_name(topic.name))
        return resolved.removeprefix(self.get_namespace().rstrip("/") + "/")

    def add_publisher(self, topic: Topic) -> Publisher:
        """Create the publisher of a topic; it lives until clean-up."""
        publisher = self.create_publisher(
            message_class(topic.type_name), topic.name, qos_profile(topic)
        )
        if topic.intent is Intent.STREAM:
            self._stream_publishers[self.subject(topic)] = publisher
        else:
            self._other_endpoints.append(publisher)
        return publisher

    def add_subscription(
        self,
        topic: Topic,
        callback: Callable[[Any], None],
        *,
        raw: bool = False,
        is_awaited: bool = True,
        hears_in_fault: bool = False,
    ) -> Subscription:
        """
        Subscribe to a topic until clean-up; what the callback raises becomes a fault.

        Parameters
        ----------
        topic : Topic
            The topic.
        callback : callable
            Takes each message.
        raw : bool
            Whether it takes the serialised message.
        is_awaited : bool
            Whether activation waits for the writer of a stream.
        hears_in_fault : bool
            Whether the callback is called also while the node has a fault.

        """
        subscription = self.create_subscription(
            message_class(topic.type_name),
            topic.name,
            self._guarded(callback, hears_in_fault=hears_in_fault),
            qos_profile(topic),
            raw=raw,
        )
        if topic.intent is Intent.STREAM and is_awaited:
            self._stream_subscriptions[self.subject(topic)] = subscription
        else:
            self._other_endpoints.append(subscription)
        return subscription

    def add_block_subscription(
        self, topic: Topic, callback: Callable[[SampleBlock], None]
    ) -> Subscription:
        """Subscribe to a stream of samples until clean-up."""
        return self.add_subscription(topic, lambda message: callback(block_from_message(message)))

    def publish_block(self, block: SampleBlock) -> None:
        """Publish a block on the topic of its stream; see `publish`."""
        self.publish(self._stream_publishers[block.stream], block_to_message(self.types, block))

    def publish(self, publisher: Publisher, message: Any) -> None:
        """
        Publish a message, waiting for slow readers.

        Raises
        ------
        DeadlineError
            If a reader takes nothing for `publish_timeout`.

        """
        deadline = time.monotonic() + self.parameters.publish_timeout
        while True:
            try:
                publisher.publish(message)
            except RCLError as error:  # the histories of both sides are full
                if time.monotonic() > deadline:
                    awaited = f"a reader of {publisher.topic_name} to take samples"
                    raise DeadlineError(awaited, self.parameters.publish_timeout) from error
            else:
                return

    def try_to_publish_block(self, block: SampleBlock) -> bool:
        """Publish a block if its readers can take it within the middleware's patience (0.1 s)."""
        try:
            self._stream_publishers[block.stream].publish(block_to_message(self.types, block))
        except RCLError:  # the histories of both sides are full
            return False
        return True

    def set_fault(self, reason: str) -> None:
        """Enter a fault: log it and show it in the diagnostics at once."""
        if not self.fault:
            self.fault = reason
            self.get_logger().error(reason)
            self._publish_diagnostics()

    # ---- lifecycle -----------------------------------------------------------------------

    def on_configure(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Run `configure`; the endpoints of a failed attempt are taken down again."""
        self.fault = ""
        done = self._attempt("configure", self.configure)
        if done is not TransitionCallbackReturn.SUCCESS:
            self._destroy_endpoints()
        return done

    def on_activate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Wait for the peers, then run `activate`."""
        self.fault = ""

        def start() -> None:
            self.wait_for_peers()
            self.activate()
            self.is_active = True
            self.binding.is_locked = True

        return self._attempt("activate", start)

    def on_deactivate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Run `deactivate`; what was sent goes on its way as long as the endpoints live."""

        def stop() -> None:
            self._leave_active()
            self.deactivate()

        return self._attempt("deactivate", stop)

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """See that what was sent is received, run `cleanup` and take the endpoints down."""

        def clean() -> None:
            self._flush()
            self.cleanup()
            self._destroy_endpoints()

        return self._attempt("clean up", clean)

    def on_shutdown(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Bring open work to its end; the process ends then."""

        def shut_down() -> None:
            self._leave_active()
            self.is_shut_down = True
            self.finish()

        return self._attempt("shut down", shut_down)

    def on_error(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to unconfigured after an error."""
        self._leave_active()
        self._destroy_endpoints()
        return TransitionCallbackReturn.SUCCESS

    def _leave_active(self) -> None:
        self.is_active = False
        self.binding.is_locked = False

    def _attempt(self, what: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        # rclpy swallows exceptions in transitions without a trace: report them here
        try:
            action()
        except ImotorError as error:
            self.set_fault(f"cannot {what}: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception:
            self.set_fault(f"cannot {what}:\n{traceback.format_exc()}")
            return TransitionCallbackReturn.ERROR
        self._publish_diagnostics()
        return TransitionCallbackReturn.SUCCESS

    def _guarded(
        self, callback: Callable[[Any], None], *, hears_in_fault: bool = False
    ) -> Callable[[Any], None]:
        def call(message: Any) -> None:
            if self.fault and not hears_in_fault:
                return
            try:
                callback(message)
            except ImotorError as error:
                self.on_fault(str(error))
            except Exception:
                self.on_fault(traceback.format_exc())

        return call

    def on_fault(self, reason: str) -> None:
        """Handle what a callback raised; derived classes may tell their peers."""
        self.set_fault(reason)

    def _destroy_endpoints(self) -> None:
        for endpoint in (
            *self._stream_publishers.values(),
            *self._stream_subscriptions.values(),
            *self._other_endpoints,
        ):
            destroy = (
                self.destroy_publisher
                if isinstance(endpoint, Publisher)
                else self.destroy_subscription
            )
            destroy(endpoint)
        self._stream_publishers.clear()
        self._stream_subscriptions.clear()
        self._other_endpoints.clear()

    # ---- peers ---------------------------------------------------------------------------

    def wait_for_peers(self) -> None:
        """
        Wait until every stream has its readers and its writer: earlier blocks would be lost.

        Raises
        ------
        DeadlineError
            If they are not all there within `match_timeout`.

        """
        deadline = time.monotonic() + self.parameters.match_timeout
        while missing := self._missing_peer():
            if time.monotonic() > deadline:
                raise DeadlineError(missing, self.parameters.match_timeout)
            time.sleep(0.005)

    def _missing_peer(self) -> str:
        counts = self.parameters.reader_counts
        for name, publisher in self._stream_publishers.items():
            wanted, found = counts.get(name, 1), publisher.get_subscription_count()
            if found < wanted:
                return f"{wanted} reader(s) of {name} (found {found})"
        for name, subscription in self._stream_subscriptions.items():
            if subscription.get_publisher_count() < 1:
                return f"a writer of {name}"
        return ""

    def hand_over(self, timeout: float) -> None:
        """See that readers have what was sent before the process ends; dead ones never will."""
        deadline = time.monotonic() + timeout
        for publisher in self._stream_publishers.values():
            left = max(0.0, deadline - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left))

    def _flush(self) -> None:
        for publisher in self._stream_publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=self.parameters.publish_timeout))

    # ---- diagnostics ---------------------------------------------------------------------

    def say_goodbye(self) -> None:
        """Tell the operator that this node has not fallen silent, but ended."""
        self._publish_diagnostics(has_ended=True)

    def _health(self) -> tuple[bytes, str]:
        """Return level and message of the diagnostics."""
        if self.fault:
            return DiagnosticStatus.ERROR, self.fault
        if warning := self.warning():
            return DiagnosticStatus.WARN, warning
        return DiagnosticStatus.OK, "active" if self.is_active else "ready"

    def _publish_diagnostics(self, *, has_ended: bool = False) -> None:
        status = DiagnosticStatus()
        status.name = f"{self.get_fully_qualified_name().lstrip('/')}: run"
        status.hardware_id = self.hardware_id
        status.level, status.message = self._health()
        if has_ended:
            status.level, status.message = DiagnosticStatus.STALE, "ended"
        values = self.status_values()
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        try:
            self._diagnostics.publish(message)
        except RCLError:
            self.get_logger().warning("diagnostics could not be published")


def run_node(factory: Callable[..., StandNode[Any]], arguments: list[str] | None = None) -> int:
    """
    Run one node until it is told to end, let it finish its work, and return the exit code.

    SIGINT, SIGTERM and the lifecycle's shutdown all tell it to end.

    Parameters
    ----------
    factory : callable
        Makes the node; called with `context`.
    arguments : list of str, optional
        Command line; by default that of the process.

    """
    stopped_by: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stopped_by.append(received))
    context = Context()
    try:
        join_graph(context, sys.argv if arguments is None else arguments)
        node = factory(context=context)
    except (ImotorError, ParameterException) as error:
        sys.stderr.write(f"error: {error}\n")
        context.try_shutdown()
        return 2 if isinstance(error, BadInputError | ParameterException) else 1
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        while not (stopped_by or node.is_shut_down):
            executor.spin_once(timeout_sec=0.1)
        node.leave_output()
        _drain(node, executor)
    except ExternalShutdownException:
        pass
    finally:
        node.finish()
        node.hand_over(_HAND_OVER_TIMEOUT)
        node.say_goodbye()
        executor.shutdown(timeout_sec=1.0)
        node.destroy_node()
        context.try_shutdown()
    return 0


def _drain(node: StandNode[Any], executor: SingleThreadedExecutor) -> None:
    """Handle what has been received already, but not read."""
    deadline = time.monotonic() + _DRAIN_TIMEOUT
    seen = -1
    quiet_since = time.monotonic()
    while time.monotonic() < min(deadline, quiet_since + _QUIET_TIME):
        if node.received_count() != seen:
            seen, quiet_since = node.received_count(), time.monotonic()
        executor.spin_once(timeout_sec=0.02)

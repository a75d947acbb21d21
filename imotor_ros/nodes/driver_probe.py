"""The generator's part of the stand, and all readers of a driver, for the check of drivers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imotor_msgs.msg import StandState
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.task import Future

from imotor_ros.campaign.conformance.record import (
    Acknowledgement,
    Description,
    Published,
    RunRecord,
)
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.contracts.messages import (
    block_from_message,
    block_to_message,
    channel_from_message,
    message_time,
    program_from_message,
    program_to_message,
    stand_state_to_message,
)
from imotor_ros.contracts.topics import (
    CHANNELS,
    DIAGNOSTICS,
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    MEASURED_TOPICS,
    STATE,
    Topic,
)
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.samples import Samples
from imotor_ros.errors import DeadlineError
from imotor_ros.nodes.message_types import RclpyTypes, message_class
from imotor_ros.nodes.middleware import join_graph
from imotor_ros.nodes.qos import pulse_profile, qos_profile

UNDER_WAY_TIME = 30e-3
"""Voltage (s) that may be sent, but not acknowledged."""

BLOCK_TIME = 10e-3
"""Longest block (s)."""

_RETRY_INTERVAL = 3.0
"""Time (s) after which a request without answer is sent again."""

_PATIENCE = 30.0
"""Longest time (s) in which a driver may say that it is still at work on the same sample."""

STATES = {
    State.PRIMARY_STATE_UNCONFIGURED: "unconfigured",
    State.PRIMARY_STATE_INACTIVE: "inactive",
    State.PRIMARY_STATE_ACTIVE: "active",
    State.PRIMARY_STATE_FINALIZED: "finalized",
}


class DriverProbe:
    """
    Plays all peers of a driver: writes what the generator writes, and keeps what the driver says.

    Parameters
    ----------
    namespace : str
        Namespace of the stand.
    watch : callable
        Called again and again while waiting; raises if the driver has gone.

    """

    def __init__(self, namespace: str, watch: Callable[[], None]) -> None:
        self.namespace = namespace.rstrip("/")
        self.watch = watch
        self._context = Context()
        join_graph(self._context, [])
        self.node = Node("driver_check", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._types = RclpyTypes()
        self._clients: dict[tuple[str, str], Client] = {}
        self._readers: dict[str, Any] = {}
        self.runs: dict[str, RunRecord] = {}
        self.strays: list[str] = []
        self._current: RunRecord | None = None
        self._sequence = 0
        self.is_pulsing = True
        self.is_replay = False
        self._early: list[Callable[[], None]] = []
        self._program = self._writer(DRIVE_PROGRAM)
        self._voltage = self._writer(DRIVE_VOLTAGE)
        self._state = self.node.create_publisher(
            message_class(STATE.type_name), STATE.name, pulse_profile(is_writer=True)
        )
        for topic in (*MEASURED_TOPICS, DRIVE_PROGRESS, CHANNELS):
            self.read(topic)
        self.statuses: dict[str, tuple[bool, str]] = {}
        self.node.create_subscription(
            DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, qos_profile(DIAGNOSTICS)
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.node.create_timer(0.1, self._pulse, clock=steady)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown(timeout_sec=1.0)
        self.node.destroy_node()
        self._context.try_shutdown()

    # ---- endpoints -----------------------------------------------------------------------

    def _writer(self, topic: Topic) -> Publisher:
        return self.node.create_publisher(
            message_class(topic.type_name), topic.name, qos_profile(topic)
        )

    def read(self, topic: Topic) -> None:
        """Subscribe to what a driver, or a player in its place, publishes."""
        if topic.name in self._readers:
            return
        if topic is DRIVE_PROGRESS:
            callback: Any = self._on_progress
        elif topic is CHANNELS:
            callback = self._on_channel
        elif topic is DRIVE_PROGRAM:
            callback = self._on_program
        elif topic is DRIVE_VOLTAGE:
            callback = self._on_voltage
        else:
            callback = self._block_callback(topic.name)
        self._readers[topic.name] = self.node.create_subscription(
            message_class(topic.type_name), topic.name, callback, qos_profile(topic)
        )

    def stop_reading(self, topic: Topic) -> None:
        """Take a subscription down."""
        self.node.destroy_subscription(self._readers.pop(topic.name))

    def give_way_to_player(self) -> None:
        """Read what a generator writes instead of writing it: a player has it in its bag."""
        self.is_replay = True
        for publisher in (self._program, self._voltage, self._state):
            self.node.destroy_publisher(publisher)
        self.is_pulsing = False
        self.read(DRIVE_PROGRAM)
        self.read(DRIVE_VOLTAGE)

    def _block_callback(self, stream: str) -> Callable[[Any, Any], None]:
        def on_block(message: Any, info: Any) -> None:
            record = self._record_of(message.run_id, stream)
            if record is not None:
                block = block_from_message(message)
                record.blocks.setdefault(stream, []).append(Published(_moment(info), block))
            elif self.is_replay:
                self._early.append(lambda: on_block(message, info))

        return on_block

    def _on_progress(self, message: Any, info: Any) -> None:
        record = self._record_of(message.run_id, DRIVE_PROGRESS.name)
        if record is not None:
            record.progress.append(
                Acknowledgement(
                    _moment(info), record.sent, message_time(message), int(message.consumed),
                    int(message.flags), message.fault,
                )
            )  # fmt: skip
        elif self.is_replay:
            self._early.append(lambda: self._on_progress(message, info))

    def _on_channel(self, message: Any) -> None:
        record = self._record_of(message.run_id, CHANNELS.name)
        if record is not None:
            channel = channel_from_message(message)
            record.descriptions[channel.name] = Description(
                message.run_id, message_time(message), channel
            )
        elif self.is_replay:
            self._early.append(lambda: self._on_channel(message))

    def _on_program(self, message: Any) -> None:
        program = program_from_message(message)
        known = self.runs.get(program.run_id)
        if known is None:
            self.runs[program.run_id] = RunRecord(program)
            early, self._early = self._early, []
            for handle in early:
                handle()
        else:
            known.program = program

    def _on_voltage(self, message: Any, _info: Any) -> None:
        record = self._record_of(message.run_id, DRIVE_VOLTAGE.name)
        if record is not None:
            block = block_from_message(message)
            record.voltage.append(block.samples)
            record.sent = block.end_index
        elif self.is_replay:
            self._early.append(lambda: self._on_voltage(message, _info))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Keep of every status whether it is an error, and what it says."""
        for status in message.status:
            is_error = status.level == DiagnosticStatus.ERROR
            self.statuses[status.name] = (is_error, status.message)

    def status_of(self, nodes: Iterable[str]) -> list[tuple[bool, str]]:
        """Return the last status of nodes: whether it is an error, and what it says."""
        inside = self.namespace.lstrip("/")
        names = tuple(f"{inside}/{node}" for node in nodes)
        return [
            status
            for name, status in self.statuses.items()
            if name.lstrip("/").partition(":")[0] in names
        ]

    def _record_of(self, run_id: str, topic: str) -> RunRecord | None:
        record = self.runs.get(run_id)
        if record is None and not self.is_replay:
            self.strays.append(f"{topic}: run {run_id!r}")
        return record

    def _pulse(self) -> None:
        if not self.is_pulsing:
            return
        record = self._current
        state = StandState.STATE_IDLE if record is None else StandState.STATE_RUNNING
        message = stand_state_to_message(
            self._types, time.time_ns(), state, "" if record is None else record.program.run_id,
            sent=0 if record is None else record.sent,
            consumed=0 if record is None else record.consumed,
        )  # fmt: skip
        self._state.publish(message)

    # ---- waiting -------------------------------------------------------------------------

    def spin(self, seconds: float) -> None:
        """Handle what comes within so many seconds, at least one thing."""
        self._executor.spin_once(timeout_sec=seconds)
        self.watch()

    def spin_for(self, seconds: float) -> None:
        """Handle all that comes in a time (s), to see what comes without being asked for."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self.spin(min(0.02, left))

    def waits_for(self, condition: Callable[[], object], timeout: float) -> bool:
        """Wait for a condition; return whether it came true within the timeout (s)."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            self.spin(0.02)
        return True

    # ---- lifecycle -----------------------------------------------------------------------

    def managed_nodes(self) -> list[str]:
        """Return the nodes of the namespace that have a lifecycle."""
        ending = "/change_state"
        names = [
            name
            for name, types in self.node.get_service_names_and_types()
            if name.endswith(ending) and "lifecycle_msgs/srv/ChangeState" in types
        ]
        prefix = f"{self.namespace}/"
        inner = [name.removesuffix(ending) for name in names if name.startswith(prefix)]
        return sorted(name.removeprefix(prefix) for name in inner)

    def await_managed(self, nodes: Sequence[str], timeout: float) -> list[str]:
        """Wait until nodes can be managed; return those that still cannot after the timeout (s)."""
        kinds = (("change_state", ChangeState), ("get_state", GetState))
        ready = {
            node: [self._client(kind, node, service) for service, kind in kinds] for node in nodes
        }

        def absent() -> list[str]:
            return [n for n, both in ready.items() if not all(c.service_is_ready() for c in both)]

        self.waits_for(lambda: not absent(), timeout)
        return absent()

    def _client(self, kind: Any, node: str, service: str) -> Client:
        key = (node, service)
        if key not in self._clients:
            name = f"{self.namespace}/{node}/{service}"
            self._clients[key] = self.node.create_client(kind, name)
        return self._clients[key]

    def states(self, nodes: Iterable[str], timeout: float) -> dict[str, str]:
        """
        Return the lifecycle states of nodes by name.

        Raises
        ------
        DeadlineError
            If one does not answer within the timeout (s).

        """
        request = GetState.Request()
        answers = self._call(GetState, "get_state", dict.fromkeys(nodes, request), timeout)
        return {
            node: STATES.get(answer.current_state.id, answer.current_state.label)
            for node, answer in answers.items()
        }

    def change(self, nodes: Iterable[str], transition: int, timeout: float) -> dict[str, bool]:
        """
        Ask nodes to take a transition, together; return what each answers.

        Raises
        ------
        DeadlineError
            If one does not answer within the timeout (s).

        """
        request = ChangeState.Request()
        request.transition.id = transition
        answers = self._call(ChangeState, "change_state", dict.fromkeys(nodes, request), timeout)
        return {node: bool(answer.success) for node, answer in answers.items()}

    def get_parameters(self, nodes: Iterable[str], name: str, timeout: float) -> dict[str, float]:
        """Return the value of a number among the parameters of nodes, of those who have it."""
        request = GetParameters.Request(names=[name])
        answers = self._call(
            GetParameters, "get_parameters", dict.fromkeys(nodes, request), timeout
        )
        return {
            node: float(answer.values[0].double_value)
            for node, answer in answers.items()
            if answer.values and answer.values[0].type == ParameterType.PARAMETER_DOUBLE
        }

    def set_parameters(self, values: Mapping[str, float], name: str, timeout: float) -> None:
        """Set a number among the parameters of nodes; whoever refuses keeps what it has."""
        requests = {}
        for node, value in values.items():
            parameter = Parameter(name, value=value).to_parameter_msg()
            requests[node] = SetParameters.Request(parameters=[parameter])
        self._call(SetParameters, "set_parameters", requests, timeout)

    def _call(
        self, kind: Any, service: str, requests: dict[str, Any], timeout: float
    ) -> dict[str, Any]:
        """Call a service of several nodes; a request that stays without answer is sent again."""
        futures: dict[str, list[Future]] = {node: [] for node in requests}
        end = time.monotonic() + timeout

        def late() -> list[str]:
            return [node for node, sent in futures.items() if not any(f.done() for f in sent)]

        while waiting := late():
            if time.monotonic() > end:
                raise DeadlineError(f"{', '.join(waiting)} to answer {service}", timeout)
            for node in waiting:
                client = self._client(kind, node, service)
                futures[node].append(client.call_async(requests[node]))
            left = max(0.05, min(_RETRY_INTERVAL, end - time.monotonic()))
            self.waits_for(lambda: not late(), left)
        return {n: next(f for f in sent if f.done()).result() for n, sent in futures.items()}

    # ---- playing -------------------------------------------------------------------------

    def announce(self, program: DriveProgram) -> RunRecord:
        """Announce a program, or the new end of one; return the record of its run."""
        record = self.runs.get(program.run_id)
        if record is None:
            record = self.runs[program.run_id] = RunRecord(program)
            self._sequence = 0
        record.program = program
        self._current = record
        self._program.publish(program_to_message(self._types, program))
        return record

    def close_run(self) -> None:
        """Be idle: no run is played any more."""
        self._current = None

    def send(self, record: RunRecord, count: int, samples: Samples | None = None) -> None:
        """Send the next samples of a run: those of its program, or others (V) in their place."""
        program = record.program
        voltage = program.render(record.sent, count) if samples is None else samples
        block = SampleBlock(
            stream=DRIVE_VOLTAGE.name,
            run_id=program.run_id,
            time=sample_time(program.epoch, record.sent, program.sample_rate),
            sequence=self._sequence,
            first_index=record.sent,
            sample_rate=program.sample_rate,
            unit="V",
            flags=0,
            samples=np.asarray(voltage, dtype=np.float64),
        )
        self._sequence += 1
        record.voltage.append(block.samples)
        record.sent += count
        self._voltage.publish(block_to_message(self._types, block))

    def skip(self, record: RunRecord, count: int) -> None:
        """Leave samples of a program out, as a generator that loses them would."""
        record.voltage.append(record.program.render(record.sent, count))
        record.sent += count

    def play(
        self,
        record: RunRecord,
        *,
        until: int | None = None,
        lengths: Iterable[int] = (),
        stall_timeout: float,
    ) -> bool:
        """
        Send a program, with as much under way as the generator allows itself.

        Parameters
        ----------
        record : RunRecord
            The run, announced.
        until : int, optional
            Sample at which to stop sending; by default the program's length.
        lengths : iterable of int
            Lengths of the blocks (samples), again and again; by default the longest allowed.
        stall_timeout : float
            Longest wait (s) for an acknowledgement, be it one that says that nothing more is done.

        Returns
        -------
        bool
            Whether all was sent and acknowledged; False if it was not in time, or a fault came.

        """
        rate = record.program.sample_rate
        room = round(UNDER_WAY_TIME * rate)
        sizes: Iterator[int] = cycle(list(lengths) or [round(BLOCK_TIME * rate)])
        end = record.program.length if until is None else until
        size = next(sizes)
        moved = time.monotonic()
        while record.consumed < end:
            if record.fault:
                return False
            count = min(size, end - record.sent)
            if count > 0 and record.sent + count - record.consumed <= room:
                self.send(record, count)
                size = next(sizes)
                self.spin(0.0)
                continue
            before, heard = record.consumed, len(record.progress)
            if not self.waits_for(lambda: len(record.progress) > heard, stall_timeout):  # noqa: B023
                return False
            moved = time.monotonic() if record.consumed > before else moved
            if time.monotonic() - moved > _PATIENCE:
                return False
        return True

    def receives_all(
        self, record: RunRecord, streams: Sequence[str], *, stall_timeout: float
    ) -> bool:
        """Wait until all streams have come to the end of the program, as long as any moves on."""

        def received() -> int:
            return sum(record.end_index(stream) for stream in streams)

        while not record.is_complete(tuple(streams)):
            before = received()
            if not self.waits_for(lambda: received() > before, stall_timeout):  # noqa: B023
                return record.is_complete(tuple(streams))
        return True

    def settle(self, record: RunRecord, quiet_time: float, timeout: float) -> None:
        """Read on until nothing of a run has come for some time (s)."""

        def count() -> int:
            return sum(map(len, record.blocks.values())) + len(record.progress)

        end = time.monotonic() + timeout
        while time.monotonic() < end:
            before = count()
            if not self.waits_for(lambda: count() > before, quiet_time):  # noqa: B023
                return

    def forget(self, run_id: str) -> RunRecord | None:
        """Let go of the record of a run, and return it."""
        return self.runs.pop(run_id, None)


def _moment(info: Any) -> int:
    return int(info["source_timestamp"])


def renamed(program: DriveProgram, run_id: str) -> DriveProgram:
    """Return the same program as another run."""
    return replace(program, run_id=run_id)

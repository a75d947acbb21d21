"""
Every test has a ROS domain of its own, so that tests may run beside each other and a stand.

Two ways to test a node: as the process that `ros2 run` starts, or in this process, in a `Graph`
whose one executor the test itself spins.
"""

from __future__ import annotations

import fcntl
import gc
import itertools
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.conformance.programs import CheckParameters
from imotor_ros.campaign.conformance.requirements import Result, conclude
from imotor_ros.campaign.plan import RunPlan, plan_run
from imotor_ros.campaign.point import PointParameters
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.contracts.messages import block_to_message, program_to_message
from imotor_ros.contracts.topics import DIAGNOSTICS, DRIVE_PROGRAM, Topic, topic_named

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("imotor_msgs", reason="needs the interface package")

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from imotor_ros.nodes.driver_session import driver_check
from imotor_ros.nodes.message_types import RclpyTypes, message_class
from imotor_ros.nodes.middleware import join_graph
from imotor_ros.nodes.qos import qos_profile
from imotor_ros.nodes.stand_node import StandNode

_FIRST_DOMAIN, _LAST_DOMAIN = 20, 99
_NUMBERS = itertools.count()

DONE = TransitionCallbackReturn.SUCCESS


@pytest.fixture(autouse=True)
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Lend a domain that no other test on this machine has, and keep discovery on this host."""
    folder = Path(tempfile.gettempdir()) / f"imotor-test-domains-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    for number in range(_FIRST_DOMAIN, _LAST_DOMAIN + 1):
        with (folder / str(number)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
            monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            yield number
            return
    pytest.fail(f"domains {_FIRST_DOMAIN} to {_LAST_DOMAIN} are all taken")


@pytest.fixture
def namespace(domain: int) -> str:
    """Return a namespace that nobody has, should somebody else be in the domain."""
    return f"/test_{os.getpid()}_{domain}"


@pytest.fixture
def make_plan(tmp_path: Path) -> Callable[..., RunPlan]:
    """Return a function that plans a run of so many seconds in a folder below tmp_path."""

    def make(folder: str, hold_time: float, **leaves: Any) -> RunPlan:
        named = {"drive.hold_time": hold_time, "stand.motor.load.upper_stop": 1e-3, **leaves}
        point = NamedPoint("point", PointParameters.from_leaves(named))
        return plan_run(point, tmp_path / folder)

    return make


@pytest.fixture
def check_driver(namespace: str, tmp_path: Path) -> Callable[..., dict[str, Result]]:
    """Return a function that checks a driver, and gives the results by requirement."""

    def run(driver: str, *, lives: int = 1, **parameters: Any) -> dict[str, Result]:
        path = None
        if parameters:
            path = tmp_path / "parameters.yaml"
            path.write_text(json.dumps({"/**": {"ros__parameters": parameters}}), "utf-8")
        with driver_check(
            driver, CheckParameters(), namespace=namespace, log_directory=tmp_path / "logs",
            parameter_file=path, lives=lives,
        ) as check:  # fmt: skip
            for _ in check.run():
                pass
        return {one.requirement.id: one for one in conclude(check.findings, check.unreached)}

    return run


class Graph:
    """
    Nodes of the stand in this process, and a probe that plays all their peers.

    Whatever the probe is told to write or hear it does from then on; nothing happens unless the
    test spins.
    """

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace
        self.types = RclpyTypes()
        self.context = Context()
        join_graph(self.context, [])
        self.executor = SingleThreadedExecutor(context=self.context)
        self.probe = Node("probe", context=self.context, namespace=namespace)
        self.executor.add_node(self.probe)
        self._nodes: list[StandNode[Any]] = []
        self._publishers: dict[str, Any] = {}
        self._heard: dict[str, list[Any]] = {}
        self.diagnostics = self.hear(DIAGNOSTICS)

    def close(self) -> None:
        """Leave the graph at once: the next test may have the same domain."""
        self.executor.shutdown(timeout_sec=1.0)
        for node in self._nodes:
            node.finish()
            node.destroy_node()
        self.probe.destroy_node()
        self.context.try_shutdown()
        self._nodes.clear()
        gc.collect()

    def add(
        self, kind: Callable[..., Any], remap: dict[str, str] | None = None, **parameters: Any
    ) -> Any:
        """Make a node of the stand."""
        arguments = [f"{name}:={target}" for name, target in (remap or {}).items()]
        node = kind(
            context=self.context,
            namespace=self.namespace,
            cli_args=["--ros-args", *(part for one in arguments for part in ("-r", one))],
            parameter_overrides=[Parameter(name, value=v) for name, v in parameters.items()],
        )
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def start(self, *nodes: StandNode[Any]) -> None:
        """Configure and activate nodes whose peers are there."""
        for node in nodes:
            assert node.trigger_configure() is DONE, node.fault
        self.start_again(*nodes)

    def start_again(self, *nodes: StandNode[Any]) -> None:
        """Activate nodes that are configured."""
        for node in nodes:
            assert node.trigger_activate() is DONE, node.fault

    def spin_until(
        self, condition: Callable[[], Any], awaited: str | Callable[[], str], seconds: float = 15.0
    ) -> None:
        """Spin until a condition holds, or fail with what was waited for."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                text = awaited if isinstance(awaited, str) else awaited()
                pytest.fail(f"waited {seconds} s for {text}")
            self.executor.spin_once(timeout_sec=0.02)

    def spin(self, seconds: float) -> None:
        """Handle all that comes in some time, to see that something does not come."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.01)

    def hear(self, topic: Topic, *, raw: bool = False) -> list[Any]:
        """Subscribe to a topic; return the list to which its messages will be added."""
        if topic.name not in self._heard:
            heard = self._heard[topic.name] = []
            kind = message_class(topic.type_name)
            self.probe.create_subscription(
                kind, topic.name, heard.append, qos_profile(topic), raw=raw
            )
        return self._heard[topic.name]

    def write(self, *topics: Topic) -> None:
        """Make publishers, so that readers find them."""
        for topic in topics:
            if topic.name not in self._publishers:
                kind = message_class(topic.type_name)
                self._publishers[topic.name] = self.probe.create_publisher(
                    kind, topic.name, qos_profile(topic)
                )

    def send(self, topic: Topic, message: Any) -> None:
        """Publish a message, or its bytes."""
        self.write(topic)
        self._publishers[topic.name].publish(message)

    def send_block(self, block: Any) -> None:
        """Publish a block on the topic of its stream."""
        self.send(topic_named(block.stream), block_to_message(self.types, block))

    def announce(self, program: Any) -> None:
        """Publish a drive program."""
        self.send(DRIVE_PROGRAM, program_to_message(self.types, program))

    def faults(self, node: StandNode[Any]) -> list[str]:
        """Return the faults that the diagnostics of a node have shown."""
        name = f"{self.namespace}/{node.get_name()}: run".lstrip("/")
        return [
            status.message
            for message in self.diagnostics
            for status in message.status
            if status.name == name and status.level == DiagnosticStatus.ERROR
        ]

    def await_fault(self, node: StandNode[Any], text: str) -> None:
        """Wait until the diagnostics of a node show a fault with a text in it."""
        self.spin_until(
            lambda: any(text in fault for fault in self.faults(node)),
            lambda: f"the fault {text!r} of {node.get_name()}; it has {self.faults(node)}",
        )


@pytest.fixture
def graph(domain: int) -> Iterator[Graph]:
    """Return a graph of this process alone."""
    made = Graph(f"/test_{os.getpid()}_{next(_NUMBERS)}")
    yield made
    made.close()


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> RunPlan:
    """Carry out a short run without ROS; return its plan, which says where the bag is."""
    leaves = {
        "drive.hold_time": 0.03,
        "stand.motor.load.upper_stop": 1e-3,
        "stand.block_length": 5000,
        "evaluator.guard_periods": 3,
        "report_interval": 0.01,
    }
    point = NamedPoint("recorded", PointParameters.from_leaves(leaves))
    plan = plan_run(point, tmp_path_factory.mktemp("recorded"))
    with SimBench() as bench:
        list(bench.run(plan))
    return plan


@pytest.fixture(scope="session")
def recorded_messages(recorded: RunPlan) -> list[tuple[Topic, bytes]]:
    """Return the messages of that run in the order of its bag."""
    with RunBag(recorded.bag_path) as bag:
        return [(topic_named(one.topic), bytes(one.data)) for one in bag.messages()]

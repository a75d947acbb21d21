"""Ctrl-C at any moment: nothing is left running, and the bag can be read."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from imotor_ros.bag.reader import RunBag
from imotor_ros.nodes.middleware import join_graph

CAMPAIGN = """
name: long
point: {drive: {hold_time: 30.0}}
"""

END_DEADLINE = 40.0
"""Longest time (s) from the Ctrl-C to the end of the command."""

MOMENT_DEADLINE = 90.0
"""Longest wait (s) for the moment to come."""


def start(folder: Path, namespace: str, campaign: str = CAMPAIGN) -> subprocess.Popen[str]:
    """Start a long campaign on the ROS graph."""
    (folder / "long.yaml").write_text(campaign)
    command = [sys.executable, "-m", "imotor_ros.cli", "run", "long.yaml", "--output", "out"]
    command += ["--namespace", namespace]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    return subprocess.Popen(
        command, cwd=folder, env=environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip


def nodes_of(domain: int) -> list[int]:
    """Return the processes of nodes in a ROS domain, by their environment."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            environment = (folder / "environ").read_bytes()
            command = (folder / "cmdline").read_bytes()
        except OSError:
            continue
        if f"ROS_DOMAIN_ID={domain}\0".encode() in environment and b"--ros-args" in command:
            found.append(int(folder.name))
    return found


def wait_for(condition: Callable[[], bool], awaited: str, seconds: float) -> None:
    """Wait for a condition, and fail with what was waited for."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f"waited {seconds} s for {awaited}")
        time.sleep(0.01)  # a poll of other processes, with the deadline above


def moments(folder: Path, domain: int) -> dict[str, Callable[[], bool]]:
    """Return when to interrupt, by name."""
    bag = folder / "out" / "point" / "bag" / "bag.mcap"
    return {
        "first node starts": lambda: len(nodes_of(domain)) >= 1,
        "all nodes run": lambda: len(nodes_of(domain)) == 7,
        "bag is opened": bag.exists,
        "drive is under way": lambda: bag.exists() and bag.stat().st_size > 3_000_000,
    }


@pytest.mark.parametrize(
    "moment", ["first node starts", "all nodes run", "bag is opened", "drive is under way"]
)
def test_interrupt_leaves_nothing_running(
    moment: str, tmp_path: Path, domain: int, namespace: str
) -> None:
    """The command ends with 130 and says how to go on; the bag, if any, is whole."""
    command = start(tmp_path, namespace)
    try:
        wait_for(moments(tmp_path, domain)[moment], moment, MOMENT_DEADLINE)
        command.send_signal(signal.SIGINT)
        _, errors = command.communicate(timeout=END_DEADLINE)
    finally:
        command.kill()
    assert command.returncode == 130, errors
    assert "--resume" in errors
    assert "Traceback" not in errors
    wait_for(lambda: not nodes_of(domain), "the nodes to be gone", 5.0)
    if moment == "drive is under way":
        with RunBag(tmp_path / "out" / "point" / "bag") as bag:
            assert bag.end_state == "cancelled"
            assert bag.performance.is_final
            samples, _, _ = bag.samples("drive/voltage")
            assert len(samples) == bag.program.length
            assert abs(samples[-1]) < 0.1, "the voltage went to zero"
            assert all(count["lost"] == 0 for count in bag.stream_counts.values())
    elif (tmp_path / "out" / "point" / "bag").exists():
        with RunBag(tmp_path / "out" / "point" / "bag") as bag:
            assert re.match("cancelled|aborted|recovered", bag.end_state)


def call_stop(namespace: str) -> str:
    """Call the service drive/stop as an operator does, and return its answer."""
    context = Context()
    join_graph(context, [])
    node, executor = Node("operator", context=context), SingleThreadedExecutor(context=context)
    try:
        executor.add_node(node)
        client = node.create_client(Trigger, f"{namespace}/drive/stop")
        assert client.wait_for_service(20.0), "no service drive/stop after 20 s"
        answer = client.call_async(Trigger.Request())
        executor.spin_until_future_complete(answer, 20.0)
        assert answer.done(), "no answer of drive/stop after 20 s"
        return str(answer.result().message)
    finally:
        executor.shutdown(timeout_sec=1.0)
        node.destroy_node()
        context.try_shutdown()


def test_campaign_ends_when_an_operator_stops_the_drive(
    tmp_path: Path, domain: int, namespace: str
) -> None:
    """The next run must not put the voltage on again behind the operator's back."""
    two = CAMPAIGN + "points: [{name: point}, {name: next}]\n"
    command = start(tmp_path, namespace, two)
    try:
        moment = moments(tmp_path, domain)["drive is under way"]
        wait_for(moment, "the drive", MOMENT_DEADLINE)
        call_stop(namespace)
        _, errors = command.communicate(timeout=END_DEADLINE)
    finally:
        command.kill()
    assert command.returncode == 1, errors
    assert "was stopped by an operator; the voltage is at zero" in errors
    assert "--resume" in errors
    assert not (tmp_path / "out" / "next").exists()
    wait_for(lambda: not nodes_of(domain), "the nodes to be gone", 5.0)
    with RunBag(tmp_path / "out" / "point" / "bag") as bag:
        assert bag.end_state == "cancelled"
        samples, _, _ = bag.samples("drive/voltage_monitor")
        assert abs(samples[-1]) < 0.1


def test_killed_orchestrator_takes_its_nodes_along(
    tmp_path: Path, domain: int, namespace: str
) -> None:
    """No node stays behind when the one that started it is killed."""
    command = start(tmp_path, namespace)
    try:
        wait_for(lambda: len(nodes_of(domain)) == 7, "seven nodes", MOMENT_DEADLINE)
    finally:
        command.kill()
        command.communicate(timeout=10.0)
    wait_for(lambda: not nodes_of(domain), "the nodes to be gone", 20.0)


def test_second_stand_in_the_namespace_is_refused(
    tmp_path: Path, domain: int, namespace: str
) -> None:
    """A second start beside a running one says so, and leaves the first alone."""
    command = start(tmp_path, namespace)
    second = tmp_path / "second"
    second.mkdir()
    try:
        wait_for(lambda: len(nodes_of(domain)) == 7, "seven nodes", MOMENT_DEADLINE)
        other = start(second, namespace)
        _, errors = other.communicate(timeout=MOMENT_DEADLINE)
        assert other.returncode == 2, errors
        assert f"namespace {namespace}: is taken" in errors
        assert not (second / "out").exists(), "what was refused leaves nothing"
        assert len(nodes_of(domain)) == 7
        assert command.poll() is None
    finally:
        command.send_signal(signal.SIGINT)
        command.communicate(timeout=END_DEADLINE)

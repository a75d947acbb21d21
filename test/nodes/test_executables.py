"""The executables as `ros2 run` finds them: they start, end when told to, and leave nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

from imotor_ros.errors import BadInputError, NodeDiedError
from imotor_ros.nodes.process import NodeProcess, find_executable, stop_processes

EXECUTABLES = (
    "signal_generator", "plant", "vibrometer", "force_sensor", "evaluator", "recorder", "player",
)  # fmt: skip

HOW_TO_END = dict(
    zip(EXECUTABLES, ("SIGINT", "SIGTERM", "SIGINT", "SIGTERM", "SIGINT", "SIGTERM", "shutdown"),
        strict=True)
)  # fmt: skip
"""Shared out, because each way is the same code in every node, and a start takes seconds."""


def test_executables_start_and_end_cleanly(graph: Any, tmp_path: Path) -> None:
    """Two at a time on two cores would be slower: all together, ended as soon as they are up."""
    nodes = {
        name: NodeProcess(find_executable(name), name, graph.namespace, tmp_path / f"{name}.log")
        for name in EXECUTABLES
    }
    clients = {
        name: graph.probe.create_client(ChangeState, f"{name}/change_state") for name in nodes
    }
    try:
        graph.spin_until(
            lambda: all(client.service_is_ready() for client in clients.values()),
            lambda: (
                "all nodes to come up, missing "
                + str([name for name, client in clients.items() if not client.service_is_ready()])
            ),
            seconds=60.0,
        )
        for name, way in HOW_TO_END.items():
            if way == "shutdown":
                transition = Transition(id=Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
                answer = clients[name].call_async(ChangeState.Request(transition=transition))
                graph.spin_until(answer.done, "the answer to shutdown")
                assert answer.result().success
            else:
                os.kill(nodes[name].pid, getattr(signal, way))
        deadline = time.monotonic() + 10.0
        late = [name for name, node in nodes.items() if not node.wait(deadline)]
        assert not late, "did not end"
    finally:
        for node in nodes.values():
            node.kill()
    for name, node in nodes.items():
        with pytest.raises(NodeDiedError, match="exit code 0"):
            node.check()
        assert "Traceback" not in node.log_path.read_text(), name
        assert not Path(f"/proc/{node.pid}").exists(), "nobody waits for it any more"


def test_unknown_executable_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(BadInputError, match="no such executable, got 'flux_capacitor'") as caught:
        find_executable("flux_capacitor")
    assert "signal_generator" in str(caught.value)
    with pytest.raises(BadInputError, match="package no_such_package: is not installed"):
        find_executable("plant", "no_such_package")


# ---- processes in general ----------------------------------------------------------------------


def script(folder: Path, text: str) -> Path:
    """Write an executable."""
    path = folder / "script"
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(0o755)
    return path


def test_process_gets_name_namespace_and_remappings(tmp_path: Path) -> None:
    path = script(tmp_path, 'printf "%s\\n" "$@"\n')
    node = NodeProcess(path, "head", "/stand", tmp_path / "deep" / "log", {"velocity": "rod/v"})
    assert node.wait(time.monotonic() + 10.0)
    assert node.last_lines(20) == (
        "--ros-args", "-r", "__node:=head", "-r", "__ns:=/stand", "-r", "velocity:=rod/v",
    )  # fmt: skip


def test_death_is_told_with_status_and_last_lines(tmp_path: Path) -> None:
    node = NodeProcess(
        script(tmp_path, "for i in $(seq 20); do echo line $i; done; echo; exit 3\n"),
        "head", "/stand", tmp_path / "log",
    )  # fmt: skip
    assert node.wait(time.monotonic() + 10.0)
    with pytest.raises(NodeDiedError) as caught:
        node.check()
    assert (caught.value.node, caught.value.status) == ("head", "exit code 3")
    assert caught.value.last_lines == tuple(f"line {i}" for i in range(13, 21))
    killed = NodeProcess(script(tmp_path, "kill -9 $$\n"), "head", "/stand", tmp_path / "log")
    assert killed.wait(time.monotonic() + 10.0)
    with pytest.raises(NodeDiedError, match="signal SIGKILL"):
        killed.check()


def test_process_that_does_not_listen_is_killed(tmp_path: Path) -> None:
    deaf = script(tmp_path, 'trap "" TERM\necho ready\nexec sleep 60\n')
    node = NodeProcess(deaf, "deaf", "/stand", tmp_path / "log")
    deadline = time.monotonic() + 10.0
    while node.last_lines() != ("ready",):
        assert time.monotonic() < deadline, "the script did not start"
    assert stop_processes([node], timeout=0.2) == ["deaf"]
    assert not node.is_running
    assert stop_processes([node], timeout=0.2) == [], "it has ended already"


def test_missing_log_is_no_error(tmp_path: Path) -> None:
    node = NodeProcess(script(tmp_path, "exit 0\n"), "n", "/stand", tmp_path / "log")
    assert node.wait(time.monotonic() + 10.0)
    (tmp_path / "log").unlink()
    assert node.last_lines() == ()


def test_parent_that_is_killed_takes_its_nodes_along(tmp_path: Path) -> None:
    import sys

    code = (
        "import sys, time; from pathlib import Path\n"
        "from imotor_ros.nodes.process import NodeProcess\n"
        "folder = Path(sys.argv[1])\n"
        "node = NodeProcess(folder / 'script', 'n', '/stand', folder / 'log')\n"
        "print(node.pid, flush=True); time.sleep(60)\n"
    )
    script(tmp_path, "exec sleep 60\n")
    parent = subprocess.Popen([sys.executable, "-c", code, tmp_path], stdout=subprocess.PIPE)
    try:
        assert parent.stdout is not None
        child = Path("/proc") / parent.stdout.readline().decode().strip()
        assert child.exists()
    finally:
        parent.kill()
        parent.communicate()
    deadline = time.monotonic() + 10.0
    while _is_running(child):
        assert time.monotonic() < deadline, "the child is still there"


def _is_running(process: Path) -> bool:
    try:
        return "\nState:\tZ" not in (process / "status").read_text()
    except OSError:
        return False

"""A whole run over topics: equal to the in-process one, evaluated, recorded, replayed."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from imotor_ros.bag.evaluate import evaluate_bag
from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.bench import Bench, DriveAdvanced, PerformanceReported
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.contracts import graph
from imotor_ros.contracts.topics import DIAGNOSTICS
from imotor_ros.core.indicators import Performance
from imotor_ros.errors import NodeDiedError
from imotor_ros.nodes.replay import replay
from imotor_ros.nodes.ros_bench import RosBench

SHORT = 0.06
"""Time of the steady drive (s) in which the slider starts, runs freely and reaches the stop."""

LONG = 20.0
"""Time of the steady drive (s) in which nothing that a test does comes too late."""

RECORDED = 4_000_000
"""Size (bytes) of the bag at which a node is killed: it then holds 50 ms or more of all streams."""

Plans = Callable[..., RunPlan]

KILL_DEADLINE = 25.0
"""Longest time (s) from a kill to the end of the run: stopping the others, mending the bag."""


def carry_out(bench: Bench, plan: RunPlan) -> list[Performance]:
    """Carry out a run and return what the evaluator said."""
    return [e.performance for e in bench.run(plan) if isinstance(e, PerformanceReported)]


def messages(bag: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Return log times and content of a bag's messages by topic, without the diagnostics."""
    result: dict[str, list[tuple[int, bytes]]] = {}
    with RunBag(bag) as opened:
        for message in opened.messages():
            if message.topic != DIAGNOSTICS.name:
                result.setdefault(message.topic, []).append((message.time, message.data))
    return result


def is_alive(pid: int) -> bool:
    """Whether a process exists and is no zombie."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def test_run_over_topics_equals_run_in_process(
    tmp_path: Path, make_plan: Plans, namespace: str
) -> None:
    """Samples, log times and indicators are the same to the last bit, live, offline, replayed."""
    sim_plan = make_plan("sim", SHORT)
    ros_plan = make_plan("ros", SHORT)
    sim = carry_out(SimBench(), sim_plan)
    with RosBench(tmp_path / "logs", namespace=namespace) as bench:
        first = carry_out(bench, ros_plan)
        ros_messages = messages(ros_plan.bag_path)
        assert carry_out(bench, ros_plan) == first, "a second run on the same nodes"
        assert messages(ros_plan.bag_path) == ros_messages
    sim_messages = messages(sim_plan.bag_path)
    assert sorted(sim_messages) == sorted(ros_messages)
    for topic, expected in sim_messages.items():
        assert ros_messages[topic] == expected, topic
    assert _texts(first) == _texts(sim)
    final = first[-1]
    assert final.is_final
    assert all(one.is_available for one in final.indicators), final.indicators
    assert all(stream.lost == 0 for stream in final.streams)
    assert _texts([evaluate_bag(ros_plan.bag_path)]) == _texts([final])
    events = replay(ros_plan.bag_path, tmp_path / "replay", namespace)
    replayed = [e.performance for e in events if isinstance(e, PerformanceReported)]
    assert _texts(replayed) == _texts(first)


def _texts(performances: list[Performance]) -> list[str]:
    """Return performances as text that is equal only if every bit is (NaN included)."""
    return [repr(one) for one in performances]


def _size(plan: RunPlan) -> int:
    """Return the size of a run's bag."""
    file = plan.bag_path / "bag.mcap"
    return file.stat().st_size if file.exists() else 0


@pytest.mark.parametrize("victim", [role.name for role in graph.VIRTUAL_STAND])
def test_killed_node_ends_run(
    victim: str, tmp_path: Path, make_plan: Plans, namespace: str
) -> None:
    """Whichever node dies, the run ends with its name, and the bag can be read."""
    plan = make_plan("run", LONG)
    with RosBench(tmp_path / "logs", namespace=namespace) as bench:
        events = bench.run(plan)
        next(e for e in events if isinstance(e, DriveAdvanced) and _size(plan) > RECORDED)
        pids = [process.pid for process in bench.processes.values()]
        killed_at = time.monotonic()
        os.kill(bench.processes[victim].pid, signal.SIGKILL)
        with pytest.raises(NodeDiedError) as caught:
            list(events)
        assert time.monotonic() - killed_at < KILL_DEADLINE
        assert caught.value.node == victim
        assert "SIGKILL" in str(caught.value)
        assert not any(is_alive(pid) for pid in pids)
    with RunBag(plan.bag_path) as bag:
        assert bag.end_state.startswith(("aborted", "recovered"))
        samples, _, first_index = bag.samples("rod/velocity")
        monitor, _, _ = bag.samples("drive/voltage_monitor")
    assert first_index == 0
    if victim not in ("plant", "recorder"):
        assert abs(monitor[-100:].mean()) < 0.1, "the voltage went to zero"
    assert len(samples) >= 10_000

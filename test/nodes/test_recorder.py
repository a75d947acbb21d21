"""The recorder over topics: whole bags, early messages, runs without end, disks that are full."""

from __future__ import annotations

import errno
import json
import random
from pathlib import Path
from typing import Any

import pytest
from imotor_msgs.msg import RecordingState

from imotor_ros.bag import storage
from imotor_ros.bag.reader import RunBag
from imotor_ros.bag.types import installed_types
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.contracts.messages import performance_from_message
from imotor_ros.contracts.topics import (
    ALL_TOPICS,
    CHANNELS,
    DIAGNOSTICS,
    DRIVE_PROGRAM,
    PERFORMANCE,
    RECORDING,
    RUN_INFO,
    Topic,
)
from imotor_ros.nodes.recorder import RecorderNode

Messages = list[tuple[Topic, bytes]]
STREAMS = tuple(topic for topic in ALL_TOPICS if topic is not DIAGNOSTICS)
LATCHED = (RUN_INFO, DRIVE_PROGRAM, CHANNELS)
NAMES = {
    RecordingState.STATE_RECORDING: "recording",
    RecordingState.STATE_CLOSED: "closed",
    RecordingState.STATE_FAILED: "failed",
}


class Bench:
    """A recorder, and the writers of all it records."""

    def __init__(self, graph: Any, plan: RunPlan, path: Path | None, **parameters: Any) -> None:
        self.graph = graph
        graph.write(*STREAMS)
        self._heard = graph.hear(RECORDING)
        settings = {
            "path": str(path or ""),
            "run_info": plan.run_info_json,
            "provenance": json.dumps({"host": "here"}),
            "report_interval": plan.parameters.report_interval,
        }
        self.node = graph.add(RecorderNode, **{**settings, **parameters})
        graph.start(self.node)

    @property
    def states(self) -> list[str]:
        """What the recorder has said it does."""
        return [NAMES[message.state] for message in self._heard]

    @property
    def last(self) -> Any:
        """The last thing it said."""
        return self._heard[-1]

    def send(self, messages: Messages) -> None:
        """Publish messages, so that none has to wait for room."""
        for topic, data in messages:
            self.graph.send(topic, data)
            self.graph.executor.spin_once(timeout_sec=0.0)

    def await_state(self, state: str) -> None:
        """Wait until the recorder says what it does."""
        self.graph.spin_until(
            lambda: state in self.states, lambda: f"{state!r}; it said {self.states}"
        )


def content(bag_path: Path) -> list[tuple[str, int, bytes]]:
    """Return what a bag holds, without diagnostics, which have the time of a clock."""
    with RunBag(bag_path) as bag:
        found = [(m.topic, m.time, bytes(m.data)) for m in bag.messages()]
    return [one for one in found if one[0] != DIAGNOSTICS.name]


@pytest.mark.parametrize("seed", [None, 1])
def test_bag_is_that_of_the_bench_without_ros(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path, seed: int | None
) -> None:
    """In whatever order topics come, also samples before the program: the same messages."""
    bench = Bench(graph, recorded, tmp_path / "bag")
    messages = recorded_messages
    if seed is not None:
        order = [topic for topic, _ in messages]
        random.Random(seed).shuffle(order)
        queues = {t: iter([data for one, data in messages if one is t]) for t in STREAMS}
        messages = [(topic, next(queues[topic])) for topic in order]
    bench.send(messages)
    bench.await_state("closed")
    assert bench.states == ["recording", "closed"]
    assert bench.last.run_id == recorded.program.run_id
    assert bench.last.path == str(tmp_path / "bag")
    assert (bench.last.lost, bench.last.error) == (0, "")
    assert content(tmp_path / "bag") == content(recorded.bag_path)
    with RunBag(tmp_path / "bag") as bag:
        assert bag.end_state == "completed"
        assert bag.run_info == recorded.run_info
        assert bag.facts.provenance == {"host": "here"}


def test_run_without_evaluator_is_closed_as_aborted_at_deactivation(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    bench = Bench(graph, recorded, tmp_path / "bag")
    bench.send([m for m in recorded_messages if m[0] is not PERFORMANCE])
    graph.spin(0.2)
    assert bench.states == ["recording"]
    bench.node.trigger_deactivate()
    bench.await_state("closed")
    with RunBag(tmp_path / "bag") as bag:
        assert bag.end_state == "aborted: the recorder was deactivated"
        samples, _, first = bag.samples("rod/velocity")
    assert (first, len(samples)) == (0, recorded.program.length)


def test_process_that_ends_closes_the_bag(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    bench = Bench(graph, recorded, tmp_path / "bag")
    half = recorded_messages[: len(recorded_messages) // 2]
    bench.send(half)
    received = sum(topic is not DIAGNOSTICS for topic, _ in half)
    graph.spin_until(lambda: bench.node.received_count() >= received, "the first half")
    bench.node.finish()
    with RunBag(tmp_path / "bag") as bag:
        assert bag.end_state == "aborted: the recorder was stopped"
        assert len(bag.samples("rod/velocity")[0]) >= 10_000


def test_missing_samples_are_counted(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    bench = Bench(graph, recorded, tmp_path / "bag")
    blocks = [m for m in recorded_messages if m[0].name == "drive/current"]
    bench.send([m for m in recorded_messages if m is not blocks[2]])
    bench.await_state("closed")
    assert bench.last.lost == 5000
    with RunBag(tmp_path / "bag") as bag:
        assert bag.stream_counts["drive/current"]["lost"] == 5000


# ---- when a run begins -------------------------------------------------------------------------


def test_recorder_that_is_not_active_opens_nothing(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    """The program of an earlier run is latched, and comes to whoever is configured later."""
    graph.write(*STREAMS)
    bench = Bench(graph, recorded, tmp_path / "bag")
    bench.node.trigger_deactivate()
    bench.send([m for m in recorded_messages if m[0] in LATCHED])
    graph.spin(0.2)
    assert bench.states == []
    assert not (tmp_path / "bag").exists()


def test_run_info_may_come_before_activation_and_samples_of_before_do_not_count(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    bench = Bench(graph, recorded, tmp_path / "bag")
    bench.node.trigger_deactivate()
    stale = [m for m in recorded_messages if m[0].name == "rod/velocity"][3:5]
    early = [m for m in recorded_messages if m[0] is RUN_INFO]
    bench.send(early + stale)
    graph.spin_until(lambda: bench.node.received_count() >= 3, "early messages")
    graph.start_again(bench.node)
    bench.send([m for m in recorded_messages if m[0] is not RUN_INFO])
    bench.await_state("closed")
    assert content(tmp_path / "bag") == content(recorded.bag_path)


def test_same_run_can_be_recorded_again(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    from rclpy.parameter import Parameter

    bench = Bench(graph, recorded, tmp_path / "one")
    bench.send(recorded_messages)
    bench.await_state("closed")
    bench.node.trigger_deactivate()
    bench.node.set_parameters([Parameter("path", value=str(tmp_path / "two"))])
    graph.start_again(bench.node)
    bench.send(recorded_messages)
    graph.spin_until(lambda: bench.states.count("closed") == 2, "the second bag to be closed")
    assert content(tmp_path / "two") == content(tmp_path / "one")


def test_program_of_another_run_closes_the_bag_and_opens_one(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """By hand, without a path: each run has a bag of its own, named after it."""
    monkeypatch.chdir(tmp_path)
    bench = Bench(graph, recorded, None, run_info="{}")
    types = installed_types()
    program = next(data for topic, data in recorded_messages if topic is DRIVE_PROGRAM)
    other = types.deserialize(program, DRIVE_PROGRAM.type_name)
    other.run_id = "other"
    graph.send(DRIVE_PROGRAM, types.serialize(other))
    bench.await_state("recording")
    bench.send([m for m in recorded_messages if m[0] is not RUN_INFO])
    graph.spin_until(lambda: bench.states.count("closed") == 2, "both bags to be closed")
    with RunBag(tmp_path / "other") as bag:
        assert bag.end_state == f"aborted: run {recorded.program.run_id} began"
    with RunBag(tmp_path / recorded.program.run_id) as bag:
        assert bag.end_state == "completed"


def test_recording_by_hand_needs_no_run_info(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    """Nothing is held back for it: a recorder that is killed would lose it."""
    bench = Bench(graph, recorded, tmp_path / "bag", run_info="{}")
    bench.send([m for m in recorded_messages if m[0] not in (RUN_INFO, PERFORMANCE)])
    graph.spin_until(
        lambda: bench.node._role is not None and bench.node._role.messages > 20,
        "messages to be written",
    )


# ---- what cannot be written ----------------------------------------------------------------------


def test_folder_that_exists_is_a_failure_with_its_reason(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    (tmp_path / "bag").mkdir()
    bench = Bench(graph, recorded, tmp_path / "bag")
    bench.send([m for m in recorded_messages if m[0] is DRIVE_PROGRAM])
    bench.await_state("failed")
    assert bench.last.error.startswith(f"{tmp_path / 'bag'}: exists already")
    graph.await_fault(bench.node, "exists already")


def test_folder_that_cannot_be_made_is_a_failure_with_its_reason(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    bench = Bench(graph, recorded, tmp_path / "file" / "deep" / "bag")
    bench.send([m for m in recorded_messages if m[0] is DRIVE_PROGRAM])
    bench.await_state("failed")
    assert "cannot be written: Not a directory" in bench.last.error
    graph.await_fault(bench.node, "cannot be written: Not a directory")


def test_full_disk_is_a_failure_and_what_was_written_can_be_read(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    room = 1_200_000
    write = storage._WholeWrites.write

    def limited(self: Any, data: Any) -> int:
        if self.tell() + len(memoryview(data).cast("B")) > room:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(self, data)

    monkeypatch.setattr(storage._WholeWrites, "write", limited)
    bench = Bench(graph, recorded, tmp_path / "bag")
    bench.send(recorded_messages)
    bench.await_state("failed")
    assert bench.states == ["recording", "failed"], "said once"
    assert bench.last.error.endswith("cannot be written: No space left on device")
    graph.await_fault(bench.node, "No space left on device")
    with RunBag(tmp_path / "bag") as bag:
        found = len(bag.samples("rod/velocity")[0])
    assert 5000 <= found < recorded.program.length


def test_performance_in_the_bag_is_the_one_that_came(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, tmp_path: Path
) -> None:
    bench = Bench(graph, recorded, tmp_path / "bag")
    bench.send(recorded_messages)
    bench.await_state("closed")
    last = [data for topic, data in recorded_messages if topic is PERFORMANCE][-1]
    sent = performance_from_message(installed_types().deserialize(last, PERFORMANCE.type_name))
    with RunBag(tmp_path / "bag") as bag:
        assert repr(bag.performance) == repr(sent)

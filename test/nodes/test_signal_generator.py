"""The signal generator over topics: flow control, stops, and whatever can go wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from imotor_msgs.action import PlayProgram
from imotor_msgs.msg import RecordingState
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

from imotor_ros.contracts.messages import (
    block_from_message,
    program_from_message,
    program_to_message,
    progress_to_message,
    recording_to_message,
)
from imotor_ros.contracts.topics import DRIVE_PROGRAM, DRIVE_PROGRESS, DRIVE_VOLTAGE, RECORDING
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.nodes.signal_generator import SignalGeneratorNode

BLOCK, WINDOW = 100, 4
SETTINGS = {"block_length": BLOCK, "window": WINDOW}

Status = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_CANCELED: "canceled",
    GoalStatus.STATUS_ABORTED: "aborted",
}


def a_program(run_id: str = "run", hold: float = 2.5e-3) -> DriveProgram:
    """Return a run of some thousand samples."""
    return steady_drive(
        run_id=run_id, epoch=10**18, sample_rate=1e6, fundamental_frequency=10e3, offset=50.0,
        amplitudes=(30.0,), phases=(0.0,), hold_time=hold, bias_time=2e-4,
    )  # fmt: skip


class Bench:
    """A generator, a plant that acknowledges when told, and somebody who wants programs played."""

    def __init__(self, graph: Any, **settings: Any) -> None:
        self.graph = graph
        self.node = graph.add(SignalGeneratorNode, **{**SETTINGS, **settings})
        graph.write(DRIVE_PROGRESS, RECORDING)
        self._voltage = graph.hear(DRIVE_VOLTAGE)
        self._programs = graph.hear(DRIVE_PROGRAM)
        self._client = ActionClient(graph.probe, PlayProgram, "drive/play")
        self.feedback: list[Any] = []
        graph.start(self.node)
        graph.spin_until(self._client.server_is_ready, "the action drive/play")

    @property
    def blocks(self) -> list[Any]:
        """The blocks of voltage that came."""
        return [block_from_message(message) for message in self._voltage]

    @property
    def programs(self) -> list[DriveProgram]:
        """The programs that were announced."""
        return [program_from_message(message) for message in self._programs]

    @property
    def sent(self) -> int:
        """Number of samples that came."""
        return sum(len(message.samples) for message in self._voltage)

    def play(self, program: DriveProgram) -> Any:
        """Send a goal; return its handle."""
        goal = PlayProgram.Goal(program=program_to_message(self.graph.types, program))
        handle = self._client.send_goal_async(goal, self.feedback.append)
        self.graph.spin_until(handle.done, "the goal to be taken")
        assert handle.result().accepted
        return handle.result()

    def result(self, handle: Any) -> tuple[str, str, int]:
        """Return status, outcome and consumed samples of a goal."""
        answer = handle.get_result_async()
        self.graph.spin_until(answer.done, "the result of the program")
        found = answer.result()
        return Status[found.status], found.result.outcome, found.result.consumed

    def await_sent(self, samples: int) -> None:
        """Wait until so many samples have come."""
        self.graph.spin_until(
            lambda: self.sent >= samples, lambda: f"{samples} samples; {self.sent} came"
        )

    def acknowledge(self, consumed: int, run_id: str = "run", fault: str = "") -> None:
        """Say how many samples are consumed."""
        message = progress_to_message(self.graph.types, run_id, 0, consumed, 0, fault)
        self.graph.send(DRIVE_PROGRESS, message)

    def consume(self, until: int) -> None:
        """Consume what comes up to a sample, a block at a time."""
        consumed = 0
        while consumed < until:
            self.await_sent(min(consumed + BLOCK, until))
            consumed = self.sent
            self.acknowledge(consumed)

    def record(self, state: int, error: str = "", run_id: str = "run") -> None:
        """Say what the recorder does."""
        message = recording_to_message(self.graph.types, run_id, 0, state, "/bag", error=error)
        self.graph.send(RECORDING, message)


# ---- flow control ----------------------------------------------------------------------------


def test_program_is_played_whole_and_never_beyond_the_window(graph: Any) -> None:
    bench, program = Bench(graph), a_program()
    handle = bench.play(program)
    consumed = 0
    while consumed < program.length:
        allowed = min(consumed + WINDOW * BLOCK, program.length)
        if allowed < program.length:
            allowed -= allowed % BLOCK
        bench.await_sent(allowed)
        graph.spin(0.01)
        assert bench.sent == allowed, "no more than the window"
        consumed = min(consumed + 3 * BLOCK // 2, program.length)  # also not at a block's end
        bench.acknowledge(consumed)
    assert bench.result(handle) == ("succeeded", "completed", program.length)
    samples = np.concatenate([block.samples for block in bench.blocks])
    assert samples.tobytes() == program.render(0, program.length).tobytes()
    blocks = bench.blocks
    assert [block.sequence for block in blocks] == list(range(len(blocks)))
    assert [block.first_index for block in blocks] == list(range(0, program.length, BLOCK))
    assert {block.run_id for block in blocks} == {"run"}
    assert blocks[7].time == program.epoch + 7 * BLOCK * 1000
    assert bench.programs == [program]
    assert bench.feedback[-1].feedback.consumed == program.length


def test_programs_follow_each_other(graph: Any) -> None:
    bench = Bench(graph)
    for run_id in ("one", "two"):
        program = a_program(run_id, hold=1e-4)
        handle = bench.play(program)
        done = 0
        while done < program.length:
            done = min(done + WINDOW * BLOCK, program.length)
            graph.spin_until(
                lambda run=run_id, end=done: any(
                    b.run_id == run and b.end_index >= end for b in bench.blocks
                ),
                f"sample {done} of {run_id}",
            )
            bench.acknowledge(done, run_id)
        assert bench.result(handle) == ("succeeded", "completed", program.length)


# ---- stopping --------------------------------------------------------------------------------


def finish_stopped(bench: Bench, handle: Any, program: DriveProgram) -> tuple[str, str, int]:
    """Consume a stopped program to its end; check that its voltage went to zero."""
    graph = bench.graph
    graph.spin_until(lambda: len(bench.programs) == 2, "the shortened program")
    shorter = bench.programs[-1]
    assert shorter.run_id == program.run_id
    assert shorter.length < program.length
    bench.consume(shorter.length)
    result = bench.result(handle)
    samples = np.concatenate([block.samples for block in bench.blocks])
    assert samples.tobytes() == shorter.render(0, shorter.length).tobytes()
    # the last step of the release is one of its 200 samples away from zero
    assert abs(samples[-1]) <= 50.0 / 200 + 1e-9
    return result


def test_cancelling_brings_the_voltage_to_zero(graph: Any) -> None:
    bench, program = Bench(graph), a_program()
    handle = bench.play(program)
    bench.consume(1000)
    handle.cancel_goal_async()
    status, outcome, consumed = finish_stopped(bench, handle, program)
    assert (status, outcome) == ("canceled", "cancelled")
    assert consumed == bench.programs[-1].length


def test_stop_service_brings_the_voltage_to_zero(graph: Any) -> None:
    bench, program = Bench(graph), a_program()
    client = graph.probe.create_client(Trigger, "drive/stop")
    graph.spin_until(client.service_is_ready, "the service drive/stop")
    idle = client.call_async(Trigger.Request())
    graph.spin_until(idle.done, "the answer of drive/stop")
    assert (idle.result().success, idle.result().message) == (True, "the voltage is at zero")
    handle = bench.play(program)
    bench.await_sent(BLOCK)
    answer = client.call_async(Trigger.Request())
    graph.spin_until(answer.done, "the answer of drive/stop")
    assert (answer.result().success, answer.result().message) == (True, "the voltage goes to zero")
    status, outcome, _ = finish_stopped(bench, handle, program)
    assert (status, outcome) == ("aborted", "cancelled")


def test_second_stop_changes_nothing(graph: Any) -> None:
    bench, program = Bench(graph), a_program()
    handle = bench.play(program)
    bench.await_sent(WINDOW * BLOCK)
    client = graph.probe.create_client(Trigger, "drive/stop")
    graph.spin_until(client.service_is_ready, "the service drive/stop")
    for _ in range(2):
        answer = client.call_async(Trigger.Request())
        graph.spin_until(answer.done, "the answer of drive/stop")
    handle.cancel_goal_async()
    assert finish_stopped(bench, handle, program)[:2] == ("canceled", "cancelled")
    assert len(bench.programs) == 2


def test_deactivation_ends_the_program(graph: Any) -> None:
    bench = Bench(graph)
    handle = bench.play(a_program())
    bench.await_sent(BLOCK)
    bench.node.trigger_deactivate()
    status, outcome, _ = bench.result(handle)
    assert (status, outcome) == ("aborted", "the signal generator was deactivated")


# ---- refusals --------------------------------------------------------------------------------


def test_second_program_is_refused_and_the_first_goes_on(graph: Any) -> None:
    bench, program = Bench(graph), a_program()
    first = bench.play(program)
    bench.await_sent(BLOCK)
    second = bench.play(a_program("other"))
    assert bench.result(second) == ("aborted", "run run is being played", 0)
    bench.consume(program.length)
    assert bench.result(first)[1] == "completed"
    assert {block.run_id for block in bench.blocks} == {"run"}


def test_program_is_refused_while_not_active(graph: Any) -> None:
    bench = Bench(graph)
    bench.node.trigger_deactivate()
    handle = bench.play(a_program())
    assert bench.result(handle) == ("aborted", "the signal generator is not active", 0)
    assert bench.sent == 0


def test_program_that_makes_no_sense_is_refused(graph: Any) -> None:
    bench = Bench(graph)
    goal = PlayProgram.Goal(program=program_to_message(graph.types, a_program()))
    goal.program.segments = []
    handle = bench._client.send_goal_async(goal)
    graph.spin_until(handle.done, "the goal to be taken")
    assert bench.result(handle.result()) == ("aborted", "drive program run: has no segments", 0)


# ---- faults ----------------------------------------------------------------------------------


def test_plant_that_consumes_nothing_ends_the_program(graph: Any) -> None:
    bench = Bench(graph, progress_timeout=0.2)
    handle = bench.play(a_program())
    status, outcome, consumed = bench.result(handle)
    assert (status, consumed) == ("aborted", 0)
    assert outcome.startswith("the plant has consumed nothing for 0.")
    assert outcome.endswith(f"(sent {WINDOW * BLOCK} samples, consumed 0)")
    graph.await_fault(bench.node, "the plant has consumed nothing")


def test_generator_with_a_fault_plays_again_after_activation(graph: Any) -> None:
    bench = Bench(graph, progress_timeout=0.2)
    bench.result(bench.play(a_program()))
    status, outcome, _ = bench.result(bench.play(a_program("two")))
    assert status == "aborted"
    assert outcome.startswith("the signal generator has a fault: the plant has consumed nothing")
    bench.node.trigger_deactivate()
    graph.start_again(bench.node)
    before = bench.sent
    handle = bench.play(a_program())
    bench.await_sent(before + WINDOW * BLOCK)
    bench.acknowledge(0, fault="plant: enough")
    assert bench.result(handle)[1] == "plant: enough"


def test_fault_of_the_plant_ends_the_program_with_its_reason(graph: Any) -> None:
    bench = Bench(graph)
    handle = bench.play(a_program())
    bench.await_sent(2 * BLOCK)
    bench.acknowledge(BLOCK)
    bench.acknowledge(BLOCK, fault="plant: drive/voltage: expected sample 100, got sample 200")
    status, outcome, consumed = bench.result(handle)
    assert (status, consumed) == ("aborted", BLOCK)
    assert outcome == "plant: drive/voltage: expected sample 100, got sample 200"


@pytest.mark.parametrize("wrong", [[WINDOW * BLOCK + 1], [BLOCK, BLOCK - 1]])
def test_wrong_acknowledgement_ends_the_program(graph: Any, wrong: list[int]) -> None:
    """More than was sent, or less than before."""
    bench = Bench(graph, window=WINDOW if len(wrong) == 1 else 1)
    handle = bench.play(a_program())
    bench.await_sent(BLOCK)
    for consumed in wrong:
        bench.acknowledge(consumed)
    status, outcome, _ = bench.result(handle)
    assert status == "aborted"
    assert "drive/progress: acknowledges the wrong number of samples" in outcome
    assert f"got {wrong[-1]}" in outcome
    graph.await_fault(bench.node, "acknowledges the wrong number of samples")


def test_progress_of_another_run_is_ignored(graph: Any) -> None:
    bench, program = Bench(graph), a_program()
    handle = bench.play(program)
    bench.await_sent(WINDOW * BLOCK)
    bench.acknowledge(10**6, run_id="old", fault="old")
    bench.consume(program.length)
    assert bench.result(handle)[1] == "completed"


# ---- waiting for the recorder ----------------------------------------------------------------


def test_voltage_waits_until_the_bag_is_open(graph: Any) -> None:
    bench, program = Bench(graph, awaits_recording=True), a_program()
    handle = bench.play(program)
    graph.spin_until(lambda: bench.programs == [program], "the program to be announced")
    bench.record(RecordingState.STATE_RECORDING, run_id="another")
    graph.spin(0.2)
    assert bench.sent == 0
    bench.record(RecordingState.STATE_RECORDING)
    bench.consume(program.length)
    assert bench.result(handle) == ("succeeded", "completed", program.length)


def test_motor_is_not_driven_for_a_run_that_cannot_be_recorded(graph: Any) -> None:
    bench = Bench(graph, awaits_recording=True)
    handle = bench.play(a_program())
    bench.record(RecordingState.STATE_FAILED, "/bag: cannot be written: No space left on device")
    status, outcome, _ = bench.result(handle)
    assert status == "aborted"
    assert outcome == "recorder: /bag: cannot be written: No space left on device"
    assert bench.sent == 0


def test_recorder_that_does_not_answer_ends_the_program(graph: Any) -> None:
    bench = Bench(graph, awaits_recording=True, progress_timeout=0.2)
    handle = bench.play(a_program())
    status, outcome, _ = bench.result(handle)
    assert status == "aborted"
    assert outcome.startswith("the recorder has opened no bag for 0.")


def test_program_cancelled_before_the_bag_is_open_is_played_short(graph: Any) -> None:
    """So that evaluator and recorder come to their end."""
    bench, program = Bench(graph, awaits_recording=True), a_program()
    handle = bench.play(program)
    handle.cancel_goal_async()
    graph.spin_until(lambda: len(bench.programs) == 2, "the shortened program")
    bench.record(RecordingState.STATE_RECORDING)
    assert finish_stopped(bench, handle, program)[:2] == ("canceled", "cancelled")


def test_program_of_another_length_is_another_program(graph: Any) -> None:
    """The epoch and the segments of a goal are announced as they are given."""
    bench = Bench(graph)
    program = replace(a_program(), epoch=123_456_789_000_000_001)
    bench.play(program)
    graph.spin_until(lambda: bench.programs == [program], "the program to be announced")
    bench.await_sent(BLOCK)
    assert bench.blocks[0].time == 123_456_789_000_000_001

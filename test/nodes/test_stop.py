"""Stops that cannot be ignored, the watchdog of the plant, and the stand's state, over topics."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from imotor_msgs.action import PlayProgram
from imotor_msgs.msg import RecordingState, StandState
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

from imotor_ros.campaign.roles.generator import STOP_TIME, GeneratorRole
from imotor_ros.contracts.messages import (
    block_from_message,
    program_from_message,
    program_to_message,
    progress_to_message,
    recording_to_message,
    stand_state_to_message,
)
from imotor_ros.contracts.topics import (
    CURRENT,
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    RECORDING,
    STATE,
    TRUTH_TOPICS,
    VOLTAGE_MONITOR,
)
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.drive import DriveProgram, Ending, steady_drive
from imotor_ros.nodes.plant import PlantNode
from imotor_ros.nodes.signal_generator import SignalGeneratorNode
from imotor_ros.nodes.stand_state import FaultBoard

BLOCK = 500
MADE = (*TRUTH_TOPICS, VOLTAGE_MONITOR, CURRENT)


def a_program(run_id: str = "run") -> DriveProgram:
    """Return a run of some ten thousand samples."""
    return steady_drive(
        run_id=run_id, epoch=10**18, sample_rate=1e6, fundamental_frequency=4625.0, offset=50.0,
        amplitudes=(36.0, 12.0), phases=(0.0, -2.7), hold_time=2e-2, bias_time=5e-4,
    )  # fmt: skip


# ---- the signal generator ----------------------------------------------------------------------


class Generator:
    """A generator whose driver is the test."""

    def __init__(self, graph: Any, **settings: Any) -> None:
        self.graph = graph
        self.node = graph.add(SignalGeneratorNode, block_length=BLOCK, window=4, **settings)
        graph.write(DRIVE_PROGRESS, RECORDING)
        self.voltage = graph.hear(DRIVE_VOLTAGE)
        self.programs = graph.hear(DRIVE_PROGRAM)
        self.states = graph.hear(STATE)
        self._player = ActionClient(graph.probe, PlayProgram, "drive/play")
        self._stopper = graph.probe.create_client(Trigger, "drive/stop")
        graph.start(self.node)
        graph.spin_until(self._player.server_is_ready, "the action drive/play")
        graph.spin_until(self._stopper.service_is_ready, "the service drive/stop")

    def send_goal(self, program: DriveProgram) -> Any:
        """Send a goal; return the future of its handle."""
        goal = PlayProgram.Goal(program=program_to_message(self.graph.types, program))
        return self._player.send_goal_async(goal)

    def play(self, program: DriveProgram) -> Any:
        """Send a goal and wait for its first blocks; return the future of its result."""
        handle = self.send_goal(program)
        self.graph.spin_until(handle.done, "the goal to be taken")
        return handle.result().get_result_async()

    def await_sent(self, samples: int) -> None:
        """Wait until so many samples have come."""
        self.graph.spin_until(lambda: self.sent >= samples, f"{samples} samples")

    @property
    def sent(self) -> int:
        """Number of samples that came."""
        return sum(len(one.samples) for one in self.voltage)

    def stop(self) -> tuple[bool, str]:
        """Call drive/stop, and return the answer."""
        answer = self._stopper.call_async(Trigger.Request())
        self.graph.spin_until(answer.done, "the answer of drive/stop")
        return answer.result().success, answer.result().message

    def acknowledge(self, consumed: int, flags: int = 0, fault: str = "") -> None:
        """Be the driver."""
        message = progress_to_message(self.graph.types, "run", 0, consumed, flags, fault)
        self.graph.send(DRIVE_PROGRESS, message)

    def outcome(self, result: Any) -> str:
        """Wait for a result, and return its outcome."""
        self.graph.spin_until(result.done, "the result of the program")
        return str(result.result().result.outcome)

    def await_state(self, state: int, **fields: str) -> StandState:
        """Wait for a state with some fields, and return it."""

        def is_it() -> bool:
            last = self.states[-1] if self.states else None
            return last is not None and last.state == state and all(
                getattr(last, name) == value for name, value in fields.items()
            )  # fmt: skip

        self.graph.spin_until(is_it, lambda: f"state {state} {fields}; it is {self.states[-1:]}")
        return self.states[-1]


def test_stop_while_a_goal_is_taken_ends_it_before_a_sample_is_sent(graph: Any) -> None:
    """The goal is accepted, its execution has not begun: the stop is meant for it."""
    bench = Generator(graph)
    inner = bench.node._on_accepted

    def stop_then_go_on(goal: Any) -> None:
        bench.node._stops_at_acceptance[bytes(goal.goal_id.uuid)] = bench.node._stops
        bench.node._on_stop(Trigger.Request(), Trigger.Response())
        goal.execute()

    for action in bench.node._actions:
        action._handle_accepted_callback = stop_then_go_on
    assert bench.outcome(bench.play(a_program())) == "cancelled"
    assert bench.sent == 0
    for action in bench.node._actions:
        action._handle_accepted_callback = inner
    bench.play(a_program())
    bench.await_sent(BLOCK)


def test_run_id_that_was_played_is_refused_until_the_next_activation(graph: Any) -> None:
    bench = Generator(graph)
    result = bench.play(a_program())
    bench.await_sent(BLOCK)
    bench.acknowledge(0, fault="plant: broken")
    assert bench.outcome(result) == "plant: broken"
    outcome = bench.outcome(bench.play(a_program()))
    assert outcome.startswith("run_id: was played already, got 'run', expected another one")
    bench.node.trigger_deactivate()
    graph.start_again(bench.node)
    bench.voltage.clear()
    bench.play(a_program())
    bench.await_sent(BLOCK)


def test_generator_with_a_fault_tells_the_driver_and_says_until_it_has_confirmed(
    graph: Any,
) -> None:
    bench = Generator(graph)
    result = bench.play(a_program())
    bench.await_sent(4 * BLOCK)
    bench.acknowledge(10**9)  # nonsense: a fault of the generator
    assert "acknowledges the wrong number" in bench.outcome(result)
    graph.spin_until(
        lambda: program_from_message(bench.programs[-1]).ending is Ending.ABANDONED,
        "the program to be abandoned",
    )
    sent = bench.sent
    told = "the driver was told to bring the voltage of run run to zero, but has not confirmed it"
    assert bench.stop() == (False, told)
    bench.acknowledge(BLOCK, SampleFlag.RAMPED_DOWN, "plant: abandoned")
    graph.spin_until(lambda: not bench.node._left_on, "the confirmation to be heard")
    assert bench.stop() == (True, "the voltage is at zero")
    assert bench.sent == sent
    bench.await_state(StandState.STATE_FAULT, node="signal_generator", run_id="")


def test_deactivation_abandons_the_program(graph: Any) -> None:
    bench = Generator(graph)
    result = bench.play(a_program())
    bench.await_sent(BLOCK)
    bench.node.trigger_deactivate()
    assert bench.outcome(result) == "the signal generator was deactivated"
    graph.spin_until(
        lambda: program_from_message(bench.programs[-1]).ending is Ending.ABANDONED,
        "the program to be abandoned",
    )


def test_driver_that_does_not_go_on_with_a_stop_is_told_to_do_it_itself(graph: Any) -> None:
    bench = Generator(graph)
    result = bench.play(a_program())
    bench.await_sent(4 * BLOCK)
    assert bench.stop() == (True, "the voltage goes to zero")
    assert bench.outcome(result).startswith("stopped, but the driver has consumed nothing for 2.")
    assert program_from_message(bench.programs[-1]).ending is Ending.ABANDONED
    assert bench.stop()[0] is False


def test_stop_is_heard_while_a_reader_takes_nothing(
    graph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A block that does not get through is kept, not lost, and does not block the node."""
    bench = Generator(graph)
    monkeypatch.setattr(bench.node, "try_to_publish_block", lambda _block: False)
    result = bench.play(a_program())
    graph.spin_until(lambda: bench.node._unsent is not None, "a block to wait")
    assert bench.stop() == (True, "the voltage goes to zero")
    monkeypatch.undo()
    while not result.done():
        graph.spin(0.01)
        bench.acknowledge(bench.sent)
    assert bench.outcome(result) == "cancelled"
    shorter = program_from_message(bench.programs[-1])
    voltage = np.concatenate([block_from_message(one).samples for one in bench.voltage])
    assert voltage.tobytes() == shorter.render(0, shorter.length).tobytes()


def test_state_follows_the_run(graph: Any) -> None:
    bench = Generator(graph, awaits_recording=True)
    bench.await_state(StandState.STATE_IDLE, run_id="")
    result = bench.play(a_program())
    bench.await_state(StandState.STATE_PREPARING, run_id="run")
    graph.send(RECORDING, recording_to_message(graph.types, "run", 0, _RECORDING, "/bag"))
    assert bench.await_state(StandState.STATE_RUNNING, run_id="run").sent > 0
    bench.acknowledge(BLOCK)
    bench.stop()
    state = bench.await_state(StandState.STATE_STOPPING, run_id="run")
    assert (state.node, state.reason) == ("", "")
    while not result.done():
        graph.spin(0.01)
        bench.acknowledge(bench.sent)
    bench.await_state(StandState.STATE_IDLE, run_id="")


_RECORDING = RecordingState.STATE_RECORDING


def test_state_shows_the_fault_of_any_node_until_it_is_cleared(graph: Any) -> None:
    bench = Generator(graph)
    other = graph.add(PlantNode)
    other.set_fault("the amplifier smokes")
    state = bench.await_state(StandState.STATE_FAULT)
    assert (state.node, state.reason, state.run_id) == ("plant", "the amplifier smokes", "")
    for topic in MADE:
        graph.hear(topic)
    graph.start(other)
    bench.await_state(StandState.STATE_IDLE)
    other.say_goodbye()
    graph.spin(0.1)
    assert bench.states[-1].state == StandState.STATE_IDLE


def test_state_is_latched_and_pulses_in_every_state_of_the_lifecycle(graph: Any) -> None:
    graph.add(SignalGeneratorNode)
    states = graph.hear(STATE)
    graph.spin_until(lambda: len(states) > 3, "pulses of an unconfigured node")
    assert {one.state for one in states} == {StandState.STATE_IDLE}


def test_silent_node_is_a_fault_but_one_that_has_ended_is_not() -> None:
    board = FaultBoard("/stand")
    for node in ("plant", "recorder"):
        board.add(f"stand/{node}: run", DiagnosticStatus.OK, "active")
    board.add("other/plant: run", DiagnosticStatus.ERROR, "not of this stand")
    board.add("stand/recorder: run", DiagnosticStatus.STALE, "ended")
    for _ in range(50):
        board.advance()
        assert board.first() == ("", "")
    board.advance()
    assert board.first() == ("plant", "has not been heard of for 5 s")
    board.add("stand/plant: run", DiagnosticStatus.OK, "active")
    assert board.first() == ("", "")


# ---- the plant -------------------------------------------------------------------------------


class Plant:
    """A plant whose generator is the test, some blocks into a program."""

    def __init__(self, graph: Any, blocks: int = 6, **settings: Any) -> None:
        self.graph = graph
        graph.write(DRIVE_PROGRAM, DRIVE_VOLTAGE, STATE)
        self.progress = graph.hear(DRIVE_PROGRESS)
        self.made = {topic.name: graph.hear(topic) for topic in MADE}
        self.node = graph.add(PlantNode, **settings)
        graph.start(self.node)
        self.program = a_program()
        graph.announce(self.program)
        self.role = GeneratorRole(self.program, BLOCK, 10**6)
        self.rest = list(iter(self.role.next_block, None))
        self.send(blocks)

    def send(self, count: int) -> None:
        """Send blocks and wait until they are consumed."""
        sent, self.rest = self.rest[:count], self.rest[count:]
        for block in sent:
            self.graph.send_block(block)
        end = sent[-1].end_index
        self.graph.spin_until(
            lambda: bool(self.progress) and self.progress[-1].consumed >= end, f"sample {end}"
        )

    def check_down(self, fault: str = "") -> None:
        """Wait until the plant has ramped down by itself, and check what it tells of that."""
        graph = self.graph
        monitor = self.made[VOLTAGE_MONITOR.name]
        for stream in self.made.values():
            graph.spin_until(
                lambda s=stream: bool(s) and bool(s[-1].flags & SampleFlag.RAMPED_DOWN), "the ramp"
            )
        samples = block_from_message(monitor[-1]).samples
        assert monitor[-1].first_index == self.node.consumed
        assert len(samples) <= STOP_TIME * 1e6
        assert abs(samples[0]) > 1.0, "the voltage was on"
        assert abs(samples[-100:].mean()) < 0.1, "zero, but for the monitor's offset"
        assert not self.node.is_voltage_on or self.node._is_down
        if fault:
            graph.spin_until(lambda: bool(self.progress[-1].fault), "the fault")
            assert self.progress[-1].fault == f"plant: {fault}"
            assert self.progress[-1].flags == SampleFlag.RAMPED_DOWN
            assert self.progress[-1].consumed == self.node.consumed
            graph.await_fault(self.node, fault)
        count = len(monitor)
        for block in self.rest[:3]:
            graph.send_block(block)
        graph.spin(0.1)
        assert len(monitor) == count, "nothing more of that run is taken"

    def announce(self, ending: Ending) -> None:
        """Announce the program again."""
        stop = self.role.stop if ending is Ending.STOPPED else self.role.abandon
        self.graph.announce(stop())


def test_silence_of_the_generator_brings_the_voltage_to_zero(graph: Any) -> None:
    Plant(graph, voltage_timeout=0.2).check_down("no voltage has come for 0.20 s")


def test_sign_of_life_keeps_the_voltage_on_but_only_that_of_its_run(graph: Any) -> None:
    """The generator may have to wait, e.g. for a slow recorder."""
    bench = Plant(graph, voltage_timeout=0.2)
    timer = graph.probe.create_timer(0.05, lambda: graph.send(STATE, _alive(graph, "run")))
    graph.spin(0.6)
    assert not bench.node.fault
    timer.cancel()
    graph.probe.create_timer(0.05, lambda: graph.send(STATE, _alive(graph, "")))
    bench.check_down("no voltage has come for 0.20 s")


def _alive(graph: Any, run_id: str) -> Any:
    return stand_state_to_message(graph.types, 0, StandState.STATE_RUNNING, run_id)


def test_silence_after_the_end_or_before_the_start_is_none(graph: Any) -> None:
    bench = Plant(graph, blocks=10**6, voltage_timeout=0.1)
    assert not bench.rest
    graph.announce(a_program("next"))
    graph.spin(0.4)
    assert not bench.node.fault
    assert not any(one.flags & SampleFlag.RAMPED_DOWN for one in bench.made["drive/current"])


def test_abandoned_run_is_brought_to_zero_at_once(graph: Any) -> None:
    bench = Plant(graph)
    bench.announce(Ending.ABANDONED)
    bench.check_down("abandoned by the signal generator")


def test_run_abandoned_before_its_first_block_puts_nothing_out(graph: Any) -> None:
    bench = Plant(graph, blocks=1)
    program = a_program("next")
    graph.announce(program)
    role = GeneratorRole(program, BLOCK, 10**6)
    block = role.next_block()
    graph.announce(role.abandon())
    graph.spin_until(lambda: bench.node._is_down, "the end of the run to be heard")
    graph.send_block(block)
    graph.spin(0.1)
    assert all(one.run_id == "run" for one in bench.made["drive/current"])
    assert not bench.node.fault


@pytest.mark.parametrize(
    "act",
    [lambda node: node.trigger_deactivate(), lambda node: node.leave_output()],
    ids=["deactivated", "told to end"],
)
def test_plant_that_leaves_brings_the_voltage_to_zero(
    graph: Any, act: Callable[[Any], None]
) -> None:
    bench = Plant(graph)
    act(bench.node)
    bench.check_down()


def test_another_run_begins_at_rest(graph: Any) -> None:
    bench = Plant(graph)
    monitor = bench.made[VOLTAGE_MONITOR.name]
    graph.announce(a_program("next"))
    graph.spin_until(lambda: bool(monitor[-1].flags & SampleFlag.RAMPED_DOWN), "the ramp")
    assert monitor[-1].run_id == "run"
    for block in list(iter(GeneratorRole(a_program("next"), BLOCK, 10**6).next_block, None))[:2]:
        graph.send_block(block)
    graph.spin_until(lambda: monitor[-1].first_index == BLOCK, "the first blocks of the next run")
    assert not bench.node.fault


# ---- all of it -------------------------------------------------------------------------------


def test_measured_stops_keep_to_their_time(
    tmp_path: Path, namespace: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bench at its smallest: every state once, and one generator that is killed."""
    path = Path(__file__).parents[2] / "bench" / "stop.py"
    spec = importlib.util.spec_from_file_location("bench_stop", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "bench_stop", module)
    spec.loader.exec_module(module)
    cases = {case.name: case for case in module.measure(tmp_path, namespace, 1, 1)}
    assert set(cases) >= {"hold", "three at once", "with the goal", "correction", "held"}
    for case in cases.values():
        assert all(time <= STOP_TIME for time in case.times), case
        assert all(left <= module.QUIET for left in case.left), case
    assert cases["hold"].times
    killed = cases["killed generator"]
    assert killed.times
    assert any("no voltage has come for 1.00 s" in text for text in killed.remarks), killed

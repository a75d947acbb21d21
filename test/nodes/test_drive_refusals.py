"""What the signal generator refuses over topics: no announcement, not one sample, the reason."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from imotor_msgs.action import CorrectExcitation, PlayProgram
from rclpy.action import ActionClient

from imotor_ros.campaign.plan import RunPlan
from imotor_ros.campaign.sim_bench import play_trial
from imotor_ros.contracts.excitation_messages import (
    excitation_from_message,
    refusal_from_message,
    request_fields,
)
from imotor_ros.contracts.messages import (
    block_from_message,
    program_to_message,
    progress_to_message,
)
from imotor_ros.contracts.topics import (
    CURRENT,
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    RECORDING,
    TRUE_ROD_VELOCITY,
    TRUTH_TOPICS,
    VOLTAGE_MONITOR,
)
from imotor_ros.core.correction import CorrectionParameters, ExcitationRequest
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.trial import carry_out
from imotor_ros.nodes.plant import PlantNode
from imotor_ros.nodes.signal_generator import SignalGeneratorNode
from imotor_ros.nodes.vibrometer import VibrometerNode

QUICK = CorrectionParameters(suppressed_harmonics=0, settling_time=3e-3, measuring_time=4e-3)


def a_program(run_id: str = "run", offset: float = 50.0, size: float = 30.0) -> DriveProgram:
    """Return a run with 10 kHz: 30 V have a slope of 1.9 V/us, and 0.3 V/us more in a ramp."""
    return steady_drive(
        run_id=run_id, epoch=10**18, sample_rate=1e6, fundamental_frequency=10e3, offset=offset,
        amplitudes=(size,), phases=(0.0,), hold_time=1e-3, bias_time=2e-4,
    )  # fmt: skip


def a_request(**changes: Any) -> ExcitationRequest:
    """Return what asks for two harmonics, 15 um, 18.5 kHz."""
    fields = {
        "run_id": "search", "epoch": 10**18, "sample_rate": 1e6, "offset": 50.0,
        "bias_time": 1e-3, "parameters": QUICK,
        "motion": parabolic_sawtooth(2, maximum_frequency=18500.0), **changes,
    }  # fmt: skip
    return ExcitationRequest(**fields)


class Stand:
    """A generator that is asked, and if wanted motor and vibrometer that answer its trials."""

    def __init__(self, graph: Any, *, with_motor: bool = False, **limits: float) -> None:
        self.graph = graph
        settings = {f"limits.{name}": value for name, value in limits.items()}
        nodes = [graph.add(SignalGeneratorNode, block_length=5000, **settings)]
        graph.write(RECORDING)
        if with_motor:
            names = {"true_velocity": TRUE_ROD_VELOCITY.name, "velocity": "rod/velocity"}
            nodes += [graph.add(PlantNode), graph.add(VibrometerNode, names)]
            for topic in (*TRUTH_TOPICS, VOLTAGE_MONITOR, CURRENT):
                graph.hear(topic, raw=True)
        else:
            graph.write(DRIVE_PROGRESS)
        self._voltage = graph.hear(DRIVE_VOLTAGE)
        self.programs = graph.hear(DRIVE_PROGRAM)
        self._play = ActionClient(graph.probe, PlayProgram, "drive/play")
        self._correct = ActionClient(graph.probe, CorrectExcitation, "drive/correct")
        self.stages: list[str] = []
        for node in nodes:
            node.trigger_configure()
        graph.start_again(*nodes)
        graph.spin_until(self._play.server_is_ready, "the action drive/play")
        graph.spin_until(self._correct.server_is_ready, "the action drive/correct")

    @property
    def voltage(self) -> np.ndarray:
        """All samples that left the generator."""
        blocks = [block_from_message(message).samples for message in self._voltage]
        return np.concatenate(blocks or [np.empty(0)])

    def play(self, program: DriveProgram) -> Any:
        """Ask for a program to be played; return status and result, or what will give them."""
        goal = PlayProgram.Goal(program=program_to_message(self.graph.types, program))
        return self._ask(self._play, goal)

    def correct(self, request: ExcitationRequest, **raw: Any) -> Any:
        """Ask for a voltage; `raw` replaces fields of the goal."""
        goal = CorrectExcitation.Goal(**{**request_fields(self.graph.types, request), **raw})
        return self._ask(self._correct, goal)

    def _ask(self, client: ActionClient, goal: Any) -> Any:
        handle = client.send_goal_async(goal, lambda told: self.stages.append(_stage(told)))
        self.graph.spin_until(handle.done, "the goal to be taken")
        assert handle.result().accepted
        answer = handle.result().get_result_async()
        self.graph.spin_until(answer.done, "the result")
        return answer.result()

    def nothing_left(self) -> bool:
        """Whether neither a program nor a sample left the generator, and none is to come."""
        self.graph.spin(0.1)
        return not self.programs and not len(self.voltage)


def _stage(told: Any) -> str:
    return str(getattr(told.feedback, "stage", ""))


MakeStand = Callable[..., Stand]


@pytest.fixture
def make_stand(graph: Any) -> MakeStand:
    return lambda **options: Stand(graph, **options)


@pytest.mark.parametrize(
    ("limits", "program", "reason"),
    [
        ({}, a_program(size=75.0), "ramp_up: needs a voltage of 125 V, expected at most 120 V"),
        ({}, a_program(offset=0.0), "needs a voltage of -30 V, expected at least -20 V"),
        ({}, a_program(offset=130.0), "bias: needs a voltage of 130 V, expected at most 120 V"),
        ({"highest_voltage": 70.0}, a_program(), "needs a voltage of 80 V, expected at most 70 V"),
        ({"slew_rate": 1e6}, a_program(), "needs a slew rate of 2.185e+06 V/s, expected at most"),
        ({"current_limit": 2.0}, a_program(), "needs a current of 3.523 A, expected at most 2 A"),
    ],
)  # fmt: skip
def test_program_beyond_a_limit_is_refused_before_anything_leaves(
    make_stand: MakeStand, limits: dict[str, float], program: DriveProgram, reason: str
) -> None:
    stand = make_stand(**limits)
    answer = stand.play(program)
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert reason in answer.result.outcome
    assert answer.result.consumed == 0
    assert stand.nothing_left()


def test_generator_plays_on_after_a_refusal(make_stand: MakeStand, graph: Any) -> None:
    stand = make_stand()
    stand.play(a_program(size=75.0))
    program = a_program("good")

    def acknowledge() -> bool:
        graph.send(
            DRIVE_PROGRESS, progress_to_message(graph.types, "good", 0, stand.voltage.size, 0)
        )
        return bool(stand.voltage.size >= program.length)

    goal = PlayProgram.Goal(program=program_to_message(graph.types, program))
    handle = stand._play.send_goal_async(goal)
    graph.spin_until(handle.done, "the goal to be taken")
    graph.spin_until(acknowledge, "the whole program")
    assert np.array_equal(stand.voltage, program.render(0, program.length))


@pytest.mark.parametrize(
    ("change", "limits", "quantity", "needed", "allowed"),
    [
        ({"offset": 125.0}, {}, "amplitude about the offset", 0.0, 0.0),
        (
            {"parameters": QUICK.replace(response_amplitude=80.0)}, {},
            "amplitude about the offset", 80.0, 70.0,
        ),
    ],
)  # fmt: skip
def test_search_that_cannot_begin_is_refused_before_anything_leaves(
    make_stand: MakeStand, change: dict[str, Any], limits: dict[str, float], quantity: str,
    needed: float, allowed: float,
) -> None:  # fmt: skip
    stand = make_stand(**limits)
    answer = stand.correct(a_request(**change))
    assert answer.status == GoalStatus.STATUS_ABORTED
    error = refusal_from_message(answer.result.refusals[0])
    assert (error.quantity, error.needed, error.allowed) == (quantity, needed, allowed)
    assert answer.result.outcome == str(error)
    assert stand.nothing_left()


@pytest.mark.parametrize(
    "field",
    [
        {"sample_rate": float("nan")}, {"sample_rate": 0.0}, {"offset": float("nan")},
        {"bias_time": float("inf")}, {"bias_time": -1.0}, {"ramp_periods": float("nan")},
        {"fundamental_frequency": 0.0}, {"measuring_time": float("nan")}, {"bias_time": 1e9},
    ],
    ids=lambda field: str(field),
)  # fmt: skip
def test_search_that_makes_no_sense_is_refused_and_the_node_lives(
    make_stand: MakeStand, field: dict[str, Any]
) -> None:
    stand = make_stand()
    answer = stand.correct(a_request(), **field)
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert next(iter(field)) in answer.result.outcome
    assert stand.nothing_left()
    assert "needs a voltage" in stand.play(a_program(size=75.0)).result.outcome


@pytest.mark.parametrize(
    ("limits", "quantity", "stroke"),
    [
        ({"highest_voltage": 95.0}, "voltage", 18e-6),
        ({"lowest_voltage": 0.0}, "voltage", 21e-6),
        ({"slew_rate": 2e6}, "slew rate", 15e-6),
        ({"current_limit": 3.0}, "current", 15e-6),
    ],
)
def test_motion_beyond_a_limit_is_refused_and_no_sample_passes_it(
    make_stand: MakeStand, limits: dict[str, float], quantity: str, stroke: float
) -> None:
    """The response can be measured within the limits; the motion needs more."""
    stand = make_stand(with_motor=True, **limits)
    motion = parabolic_sawtooth(2, stroke, maximum_frequency=18500.0)
    answer = stand.correct(a_request(motion=motion))
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert stand.stages == ["response: probe", "response: sweep"]
    error = refusal_from_message(answer.result.refusals[0])
    assert error.quantity == quantity
    assert error.allowed == next(iter(limits.values()))
    assert answer.result.outcome == str(error)
    voltage = stand.voltage
    assert len(voltage) > 10_000
    assert voltage.min() >= limits.get("lowest_voltage", -20.0)
    assert voltage.max() <= limits.get("highest_voltage", 120.0)
    assert np.abs(np.diff(voltage)).max() * 1e6 <= limits.get("slew_rate", 20e6)


def test_voltage_that_is_found_over_topics_is_that_of_the_bench_in_process(
    make_stand: MakeStand, make_plan: Callable[..., RunPlan]
) -> None:
    """What the refusals above differ from; equal to the last bit."""
    stand, request = make_stand(with_motor=True), a_request()
    answer = stand.correct(request)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.outcome == "completed"
    found = excitation_from_message(request, answer.result)
    assert max(map(abs, found.amplitude_errors)) < 0.01
    assert stand.stages[-1] == f"cycle {found.cycles}"
    plan = make_plan("sim", 0.03, seed=1)
    procedure = request.procedure(plan.limits)
    assert found == carry_out(procedure, lambda trial: play_trial(trial, plan))


def test_cancelled_search_brings_the_voltage_to_zero(make_stand: MakeStand, graph: Any) -> None:
    """In the middle of a trial; the generator is ready for the next search then."""
    stand, request = make_stand(with_motor=True), a_request()
    goal = CorrectExcitation.Goal(**request_fields(graph.types, request))
    sent = stand._correct.send_goal_async(goal, lambda told: stand.stages.append(_stage(told)))
    graph.spin_until(lambda: "response: sweep" in stand.stages, "the second trial")
    handle = sent.result()
    cancelled = handle.cancel_goal_async()
    answer = handle.get_result_async()
    graph.spin_until(lambda: cancelled.done() and answer.done(), "the end of the search")
    assert answer.result().status == GoalStatus.STATUS_CANCELED
    assert answer.result().result.outcome == "cancelled"
    # the last sample is one step of the release before 0 V
    assert abs(stand.voltage[-1]) <= 50.0 / 1000 + 1e-9
    assert stand.voltage.min() >= -20.0
    assert stand.voltage.max() <= 120.0
    assert stand.correct(a_request(run_id="another")).status == GoalStatus.STATUS_SUCCEEDED

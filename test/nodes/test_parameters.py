"""Parameters of nodes: bad ones are refused in one line, good ones reach the core."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from imotor_ros.contracts.topics import TRUE_LOAD_FORCE
from imotor_ros.core.friction import FRICTION_LAWS, CoulombFriction
from imotor_ros.core.parameters import all_leaves
from imotor_ros.nodes.evaluator import EvaluatorNode
from imotor_ros.nodes.force_sensor import ForceSensorNode
from imotor_ros.nodes.plant import PlantNode, PlantParameters
from imotor_ros.nodes.player import PlayerNode
from imotor_ros.nodes.recorder import RecorderNode
from imotor_ros.nodes.signal_generator import SignalGeneratorNode
from imotor_ros.nodes.stand_node import run_node
from imotor_ros.nodes.vibrometer import VibrometerNode

NODES = (
    SignalGeneratorNode, PlantNode, VibrometerNode, ForceSensorNode, EvaluatorNode,
    RecorderNode, PlayerNode,
)  # fmt: skip


@pytest.fixture
def signals() -> Iterator[None]:
    """Give the signals back that `run_node` takes."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


# ---- at the start ----------------------------------------------------------------------------


@pytest.mark.usefixtures("signals")
@pytest.mark.parametrize(
    ("kind", "override", "text"),
    [
        (PlantNode, "motor.slider.colour:=1.0", "plant: motor.slider.colour: is not a parameter"),
        (PlantNode, "match_timeuot:=1.0", "plant: match_timeuot: is not a parameter"),
        (
            PlantNode,
            "motor.slider.mass:=-1.0",
            "SliderParameters.mass: is out of bounds, got -1.0, expected > 0 kg",
        ),
        (PlantNode, "motor.slider.mass:=heavy", "is not a number, got 'heavy'"),
        (PlantNode, "motor.friction.law:=ice", "friction.law: is not a choice, got 'ice'"),
        (PlantNode, "seed:=1.5", "seed: is not a whole number, got 1.5"),
        (RecorderNode, "run_info:='[1'", "recorder: run_info: is not JSON: "),
        (
            SignalGeneratorNode,
            "expected_readers:=drive/voltage",
            "expected_readers: does not parse, got 'drive/voltage'",
        ),
        (
            EvaluatorNode,
            "channels:='rod/velocity rod/colour'",
            "channels: is not a measured channel",
        ),
    ],
)
def test_bad_parameter_ends_the_node_with_code_2_and_one_line(
    kind: Any, override: str, text: str, capfd: pytest.CaptureFixture[str], domain: int
) -> None:
    code = run_node(kind, ["node", "--ros-args", "-p", override])
    lines = capfd.readouterr().err.splitlines()
    assert code == 2, lines
    assert len(lines) == 1, lines
    assert lines[0].startswith("error: ")
    assert text in lines[0]


@pytest.mark.usefixtures("signals")
def test_bad_parameter_file_ends_the_node_with_code_2(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], domain: int
) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text("/**:\n  ros__parameters:\n    motor:\n      slider: {mas: 1.0e-3}\n")
    assert run_node(PlantNode, ["node", "--ros-args", "--params-file", str(path)]) == 2
    assert "plant: motor.slider.mas: is not a parameter" in capfd.readouterr().err


def test_overrides_reach_the_parameters(graph: Any) -> None:
    node = graph.add(PlantNode, **{"motor.slider.mass": 7e-3, "seed": 5})
    assert node.parameters.motor.slider.mass == 7e-3
    assert node.parameters.seed == 5


@pytest.mark.parametrize("kind", NODES)
def test_every_parameter_is_declared_and_described(graph: Any, kind: Any) -> None:
    node = graph.add(kind)
    names = {name for name, _, _ in all_leaves(type(node.parameters))}
    for name in names:
        descriptor = node.describe_parameter(name)
        assert descriptor.description, name
    assert names <= {*node._parameters}


# ---- changes ----------------------------------------------------------------------------------


def test_change_is_checked_by_the_class(graph: Any) -> None:
    node = graph.add(PlantNode)
    low = node.set_parameters([Parameter("motor.slider.mass", value=0.0)])[0]
    assert not low.successful
    assert "plant: " in low.reason
    assert "mass: is out of bounds, got 0.0, expected > 0 kg" in low.reason
    text = node.set_parameters([Parameter("motor.slider.mass", value="heavy")])[0]
    assert not text.successful
    assert node.parameters.motor == PlantParameters().motor, "nothing has changed"
    assert node.get_parameter("motor.slider.mass").value == PlantParameters().motor.slider.mass


def test_parameters_that_only_fit_together_are_set_together(graph: Any) -> None:
    node = graph.add(PlantNode)
    stops = [
        Parameter("motor.load.lower_stop", value=20e-3),
        Parameter("motor.load.upper_stop", value=30e-3),
    ]
    alone = node.set_parameters(stops[:1])[0]
    assert not alone.successful
    assert "is not below the upper stop" in alone.reason
    assert node.set_parameters_atomically(stops).successful
    assert node.parameters.motor.load.lower_stop == 20e-3


def test_whole_number_serves_as_a_float(graph: Any) -> None:
    """As in `ros2 param set /stand/plant match_timeout 3`."""
    node = graph.add(PlantNode)
    assert node.set_parameters([Parameter("match_timeout", value=3)])[0].successful
    assert node.parameters.match_timeout == 3.0
    assert type(node.parameters.match_timeout) is float


def test_law_chosen_alone_takes_its_own_defaults(graph: Any) -> None:
    node = graph.add(PlantNode)
    for law, kind in FRICTION_LAWS.items():
        assert node.set_parameters([Parameter("motor.friction.law", value=law)])[0].successful
        assert node.parameters.motor.friction == kind(), law


def test_value_of_a_law_survives_a_change_of_law(graph: Any) -> None:
    node = graph.add(PlantNode, **{"motor.friction.sliding_force": 0.5})
    assert node.parameters.motor.friction.sliding_force == 0.5
    assert node.set_parameters([Parameter("motor.friction.law", value="coulomb")])[0].successful
    assert node.parameters.motor.friction == CoulombFriction(sliding_force=0.5)


def test_list_of_numbers_can_be_set(graph: Any) -> None:
    node = graph.add(PlantNode)
    lists = {name: v for name, v, _ in node.parameters.leaves() if isinstance(v, tuple)}
    for name, value in lists.items():
        halves = [0.5 * number for number in value]
        result = node.set_parameters([Parameter(name, value=halves)])[0]
        assert result.successful, result.reason
        assert {n: v for n, v, _ in node.parameters.leaves()}[name] == tuple(halves)


def test_change_is_refused_while_active(graph: Any) -> None:
    graph.write(TRUE_LOAD_FORCE)
    node = graph.add(ForceSensorNode, expected_readers="load/force=0")
    graph.start(node)
    refused = node.set_parameters([Parameter("force_sensor.force_range", value=2.0)])[0]
    assert not refused.successful
    assert refused.reason == (
        "force_sensor.force_range: cannot change while the node is active; deactivate it"
    )
    node.trigger_deactivate()
    assert node.set_parameters([Parameter("force_sensor.force_range", value=2.0)])[0].successful
    assert node.parameters.force_sensor.force_range == 2.0


def test_unknown_name_is_refused_over_the_service_and_the_node_lives(graph: Any) -> None:
    node = graph.add(PlantNode)
    client = graph.probe.create_client(SetParametersAtomically, "plant/set_parameters_atomically")
    graph.spin_until(client.service_is_ready, "the parameter service")
    request = SetParametersAtomically.Request()
    request.parameters = [Parameter("motor.colour", value=1.0).to_parameter_msg()]
    answer = client.call_async(request)
    graph.spin_until(answer.done, "the answer")
    assert not answer.result().result.successful
    assert "undeclared" in answer.result().result.reason, "in rclpy's words"
    assert node.parameters == PlantParameters()

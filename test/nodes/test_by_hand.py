"""The session of docs/nodes.md: every command is carried out with the names and fields it gives."""

from __future__ import annotations

import re
import shlex
from array import array
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.parameter import Parameter

from imotor_ros.contracts.topics import topic_named
from imotor_ros.nodes.message_types import message_class

DOCUMENT = Path(__file__).parents[2] / "docs" / "nodes.md"
NODE_CLASSES = {
    "signal_generator": "SignalGeneratorNode",
    "plant": "PlantNode",
    "vibrometer": "VibrometerNode",
    "force_sensor": "ForceSensorNode",
    "evaluator": "EvaluatorNode",
    "recorder": "RecorderNode",
}


def documented_session() -> tuple[list[list[str]], str]:
    """Return the ros2 commands of the session in words, loops unrolled, and the goal."""
    text = DOCUMENT.read_text(encoding="utf-8").partition("## By hand")[2]
    lines = [line[4:] for line in text.splitlines() if line.startswith("    ")]
    script = "\n".join(lines).replace("\\\n", " ")
    script, goal = (
        re.sub(r"cat > goal.yaml.*?\nEND\n", "", script, flags=re.DOTALL),
        re.search(r"cat > goal.yaml <<'END'\n(.*?)\nEND\n", script, flags=re.DOTALL),
    )
    assert goal is not None
    return list(_unrolled(script.splitlines())), goal[1]


def _unrolled(lines: list[str]) -> Iterator[list[str]]:
    names: list[str] = [""]
    for line in lines:
        if loop := re.match(r"for node in (.*); do", line):
            names = loop[1].split()
        elif line == "done":
            names = [""]
        elif line.strip().startswith("ros2 "):
            for name in names:
                yield shlex.split(line.replace("$node", name))[1:]


class Session:
    """Carries out commands as the ros2 command line does, on nodes in this process."""

    def __init__(self, graph: Any, goal: str, bag: Path) -> None:
        self.graph = graph
        self.goal = goal
        self.bag = bag
        self.answers: dict[str, Any] = {}
        self.result: Any = None

    def name(self, documented: str) -> str:
        """Return a name in the namespace of the test."""
        return documented.replace("/stand", self.graph.namespace, 1)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Call a service."""
        client = self.graph.probe.create_client(kind, name)
        self.graph.spin_until(client.service_is_ready, f"the service {name}")
        answer = client.call_async(request)
        self.graph.spin_until(answer.done, f"the answer of {name}", 30.0)
        return answer.result()

    def run(self, package: str, executable: str, *arguments: str) -> None:
        """Start a node."""
        assert package == "imotor_ros"
        if executable == "run_campaign":
            return
        pairs = list(zip(arguments[1::2], arguments[2::2], strict=True))
        remap = {p[0]: p[2] for o, one in pairs if o == "-r" for p in [one.partition(":=")]}
        given = {p[0]: p[2] for o, one in pairs if o == "-p" for p in [one.partition(":=")]}
        parameters = {name: yaml.safe_load(text) for name, text in given.items()}
        if "path" in parameters:
            parameters["path"] = str(self.bag)
        module = import_module(f"imotor_ros.nodes.{executable}")
        self.graph.add(getattr(module, NODE_CLASSES[executable]), remap, **parameters)

    def param(self, verb: str, node: str, name: str = "", value: str = "") -> None:
        """Set, get, list or describe parameters."""
        node = self.name(node)
        if verb == "set":
            parameter = Parameter(name, value=yaml.safe_load(value)).to_parameter_msg()
            request = SetParameters.Request(parameters=[parameter])
            (outcome,) = self.call(SetParameters, f"{node}/set_parameters", request).results
            assert outcome.successful, outcome.reason
        elif verb == "get":
            request = GetParameters.Request(names=[name])
            (found,) = self.call(GetParameters, f"{node}/get_parameters", request).values
            self.answers[name] = found.string_value
        elif verb == "describe":
            request = DescribeParameters.Request(names=[name])
            answer = self.call(DescribeParameters, f"{node}/describe_parameters", request)
            assert answer.descriptors[0].description
        else:
            answer = self.call(ListParameters, f"{node}/list_parameters", ListParameters.Request())
            assert answer.result.names

    def lifecycle(self, verb: str, node: str, transition: str = "") -> None:
        """Take a node through a transition, or ask for its state."""
        node = self.name(node)
        if verb == "get":
            answer = self.call(GetState, f"{node}/get_state", GetState.Request())
            self.answers[node] = answer.current_state.label
            return
        key = "INACTIVE_SHUTDOWN" if transition == "shutdown" else transition.upper()
        request = ChangeState.Request(
            transition=Transition(id=getattr(Transition, f"TRANSITION_{key}"))
        )
        assert self.call(ChangeState, f"{node}/change_state", request).success, (node, transition)

    def topic(self, verb: str, *arguments: str) -> None:
        """Wait for a message for which the filter holds, or see that a topic is there."""
        documented = arguments[-1]
        topic = topic_named(documented.removeprefix("/stand/"))
        found = dict(self.graph.probe.get_topic_names_and_types())
        kind = topic.type_name
        assert found.get(self.name(documented)) == [kind], f"{documented} is {found}"
        if verb != "echo":
            return
        keep = arguments[arguments.index("--filter") + 1] if "--filter" in arguments else "True"
        heard = self.graph.hear(topic)

        def matches() -> bool:
            return any(eval(keep, {"m": message}) for message in heard)

        self.graph.spin_until(matches, f"{documented} with {keep}", 30.0)

    def service(self, verb: str, name: str, kind: str, request: str) -> None:
        """Call a service."""
        assert verb == "call"
        self.graph.spin_until(lambda: bool(self.graph.hear(topic_named("drive/progress"))), "a run")
        made = fill(message_class(kind).Request(), yaml.safe_load(request))
        self.answers[name] = self.call(message_class(kind), self.name(name), made)

    def action(self, verb: str, *arguments: str) -> None:
        """Send a goal, or see that somebody takes them."""
        if verb == "info":
            return
        name, kind_name, text = arguments[-3:]
        assert text == "$(cat goal.yaml)"
        kind = message_class(kind_name)
        self.graph.hear(topic_named("drive/progress"))
        client = ActionClient(self.graph.probe, kind, self.name(name))
        self.graph.spin_until(client.server_is_ready, f"the action {name}")
        handle = client.send_goal_async(fill(kind.Goal(), yaml.safe_load(self.goal)))
        self.graph.spin_until(handle.done, "the goal to be taken")
        self.result = handle.result().get_result_async()
        self._client = client

    def carry_out(self, words: list[str]) -> None:
        """Carry out one command."""
        getattr(self, words[0])(*words[1:])


def fill(message: Any, values: dict[str, Any]) -> Any:
    """Return a message with the fields of a mapping, as the ros2 command line fills it."""
    kinds = message.get_fields_and_field_types()
    for name, value in values.items():
        old = getattr(message, name)
        if isinstance(value, dict):
            fill(old, value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            inner = message_class(kinds[name].removeprefix("sequence<").rstrip(">").replace(
                "/", "/msg/"
            ))  # fmt: skip
            setattr(message, name, [fill(inner(), one) for one in value])
        else:
            setattr(
                message, name, array("d", value) if isinstance(value, list) else type(old)(value)
            )
    return message


def test_documented_session_operates_the_stand(graph: Any, tmp_path: Path) -> None:
    commands, goal = documented_session()
    assert {words[0] for words in commands} == {
        "run", "topic", "param", "lifecycle", "action", "service",
    }  # fmt: skip
    session = Session(graph, goal, tmp_path / "bag")
    for words in commands:
        session.carry_out(words)
        if words[0] == "service":
            graph.spin_until(session.result.done, "the stopped run to end", 30.0)
    assert session.answers["motor.friction.law"] == "coulomb"
    assert session.answers[session.name("/stand/plant")] == "active"
    stopped = session.answers["/stand/drive/stop"]
    assert (stopped.success, stopped.message) == (True, "the voltage goes to zero")
    assert session.result.result().result.outcome == "cancelled"
    assert (tmp_path / "bag" / "metadata.yaml").exists()

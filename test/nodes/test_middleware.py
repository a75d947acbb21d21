"""What the stand asks of the middleware: quick repair of lost packets, patience with readers."""

from __future__ import annotations

import os
from typing import Any
from xml.etree import ElementTree

import pytest
from rclpy._rclpy_pybind11 import RCLError
from rclpy.context import Context

from imotor_ros.errors import BadInputError, DeadlineError
from imotor_ros.nodes import middleware
from imotor_ros.nodes.force_sensor import ForceSensorNode
from imotor_ros.nodes.middleware import join_graph
from imotor_ros.nodes.stand_node import run_node

VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def chosen_profiles() -> dict[str, str]:
    """Join a graph; return the profile files that are chosen then."""
    context = Context()
    join_graph(context, [])
    context.try_shutdown()
    return {name: os.environ[name] for name in VARIABLES if name in os.environ}


def test_profile_shortens_the_time_to_repair(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    assert chosen_profiles() == {VARIABLES[0]: str(middleware._PROFILES)}
    spaces = {"": "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"}
    writer = ElementTree.parse(middleware._PROFILES).find("data_writer", spaces)
    assert writer is not None
    assert writer.get("is_default_profile") == "true"
    assert writer.findtext("times/heartbeatPeriod/sec", "", spaces) == "0"
    assert int(writer.findtext("times/heartbeatPeriod/nanosec", "", spaces)) == 50_000_000


@pytest.mark.parametrize("name", VARIABLES)
def test_profile_of_the_user_takes_precedence(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for one in VARIABLES:
        monkeypatch.delenv(one, raising=False)
    monkeypatch.setenv(name, "/home/user/mine.xml")
    assert chosen_profiles() == {name: "/home/user/mine.xml"}


class BusyReader:
    """A publisher whose reader has no room for the first few messages."""

    topic_name = "/stand/load/force"

    def __init__(self, refusals: float) -> None:
        self.refusals = refusals
        self.sent: list[Any] = []

    def publish(self, message: Any) -> None:
        self.refusals -= 1
        if self.refusals >= 0:
            raise RCLError("cannot publish data")
        self.sent.append(message)


def test_writer_waits_for_a_slow_reader_and_sends_once(graph: Any) -> None:
    node = graph.add(ForceSensorNode)
    reader = BusyReader(3)
    node.publish(reader, "message")
    assert reader.sent == ["message"]


def test_reader_that_takes_nothing_is_named(graph: Any) -> None:
    node = graph.add(ForceSensorNode, publish_timeout=0.05)
    text = "waited 0.05 s for a reader of /stand/load/force to take samples, in vain"
    with pytest.raises(DeadlineError, match=text):
        node.publish(BusyReader(float("inf")), "message")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["-p", "foo"], r"--ros-args: Couldn't parse parameter override rule: '-p foo'\."),
        (["-r", "bad"], r"--ros-args: Couldn't parse remap rule: '-r bad'\."),
        (["--params-file", "missing.yaml"], r"--ros-args: Couldn't parse params file: .*missing"),
        (["--blah"], r"--ros-args: are not known to ROS, got .*--blah"),
    ],
)
def test_malformed_arguments_are_refused_in_one_line(
    arguments: list[str], reason: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    given = ["node", "--ros-args", *arguments]
    with pytest.raises(BadInputError, match=reason) as caught:
        join_graph(Context(), given)
    assert "rcl/" not in str(caught.value), "no places in the source of others"
    monkeypatch.setattr("signal.signal", lambda number, handler: None)
    assert run_node(ForceSensorNode, given) == 2
    assert capsys.readouterr().err == f"error: {caught.value}\n"

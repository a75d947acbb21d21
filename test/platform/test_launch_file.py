"""
The launch file, as far as it can be tested without the package `launch`.

Stand-ins take what it gives to the launch system; which nodes it starts, and how, is its own.
"""

from __future__ import annotations

import runpy
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.contracts import graph

pytest.importorskip("lifecycle_msgs", reason="needs ROS 2")

LAUNCH_FILE = Path(__file__).parents[2] / "launch" / "stand.launch.py"

STAND_INS = {
    "launch": ["LaunchContext", "LaunchDescription"],
    "launch.actions": [
        "DeclareLaunchArgument", "EmitEvent", "OpaqueFunction", "RegisterEventHandler", "Shutdown",
    ],
    "launch.event_handlers": ["OnProcessStart", "OnShutdown"],
    "launch.events": ["matches_action"],
    "launch.substitutions": ["LaunchConfiguration"],
    "launch_ros": [],
    "launch_ros.actions": ["LifecycleNode"],
    "launch_ros.event_handlers": ["OnStateTransition"],
    "launch_ros.events": [],
    "launch_ros.events.lifecycle": ["ChangeState"],
}  # fmt: skip


class Taken:
    """Whatever the launch file makes."""

    def __init__(self, *values: Any, **named: Any) -> None:
        self.values, self.named = values, named

    def perform(self, context: dict[str, str]) -> str:
        """Return the value of an argument."""
        return context[self.values[0]]


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    for name, members in STAND_INS.items():
        module = types.ModuleType(name)
        for member in members:
            setattr(module, member, type(member, (Taken,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    return runpy.run_path(str(LAUNCH_FILE))


def started(launch_file: dict[str, Any], **given: str) -> tuple[list[Taken], list[Taken]]:
    """Return nodes and handlers that come of the given arguments."""
    arguments = {name: default for name, default, _ in launch_file["ARGUMENTS"]} | given
    actions = launch_file["start_stand"](arguments)
    nodes = [action for action in actions if type(action).__name__ == "LifecycleNode"]
    return nodes, [action for action in actions if action not in nodes]


def test_all_nodes_of_the_virtual_stand_start_configured_and_activated(
    launch_file: dict[str, Any],
) -> None:
    nodes, handlers = started(launch_file, bag="/data/run", namespace="/rig")
    assert [node.named["name"] for node in nodes] == [role.name for role in graph.VIRTUAL_STAND]
    assert len(handlers) == 2 * len(nodes)
    for node, role in zip(nodes, graph.VIRTUAL_STAND, strict=True):
        assert node.named["package"] == "imotor_ros"
        assert node.named["executable"] == role.executable
        assert dict(node.named["remappings"]) == dict(role.remappings)
        assert node.named["namespace"] == "/rig"
        own = node.named["parameters"][-1]
        readers = graph.expected_readers(role, graph.VIRTUAL_STAND)
        assert own.get("expected_readers", "") == readers
    assert nodes[-1].named["parameters"][-1]["path"] == "/data/run"


def test_driver_takes_the_place_of_plant_and_instruments(launch_file: dict[str, Any]) -> None:
    nodes, handlers = started(
        launch_file, driver="our_rig/card", params_file="rig.yaml", activate="false"
    )
    assert [node.named["name"] for node in nodes] == [
        "signal_generator", "driver", "evaluator", "recorder",
    ]  # fmt: skip
    assert (nodes[1].named["package"], nodes[1].named["executable"]) == ("our_rig", "card")
    assert nodes[1].named["parameters"][0] == "rig.yaml"
    assert nodes[3].named["parameters"][-1]["has_truth"] is False
    assert handlers == []


def test_launch_ends_with_the_first_node_that_does_and_only_once(
    launch_file: dict[str, Any],
) -> None:
    ends = [launch_file["end_stand"](None, name) for name in ("plant", "recorder")]
    assert [len(actions) for actions in ends] == [1, 0]
    assert ends[0][0].named["reason"] == "plant has ended"


def test_end_of_the_launch_is_asked_for_no_second_time(launch_file: dict[str, Any]) -> None:
    launch_file["note_ending"](None)
    assert launch_file["end_stand"](None, "plant") == []


def test_activate_takes_true_or_false_only(launch_file: dict[str, Any]) -> None:
    assert started(launch_file, activate="False")[1] == []
    assert started(launch_file, activate="True")[1]
    with pytest.raises(ValueError, match="expected true or false, got 'perhaps'"):
        started(launch_file, activate="perhaps")

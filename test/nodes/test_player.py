"""The player: the messages of a bag on their topics, unchanged, and no word of its evaluation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rclpy.lifecycle import TransitionCallbackReturn

from imotor_ros.bag.types import installed_types
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.contracts.topics import PERFORMANCE, TRUTH_TOPICS, Intent, Topic
from imotor_ros.nodes.player import PLAYED_TOPICS, PlayerNode

Messages = list[tuple[Topic, bytes]]
NO_READERS = " ".join(f"{t.name}=0" for t in PLAYED_TOPICS if t.intent is Intent.STREAM)


def test_messages_come_out_as_they_were_recorded(
    graph: Any, recorded: RunPlan, recorded_messages: Messages
) -> None:
    heard = {topic: graph.hear(topic, raw=True) for topic in PLAYED_TOPICS}
    silent = {topic: graph.hear(topic, raw=True) for topic in (PERFORMANCE, *TRUTH_TOPICS)}
    node = graph.add(PlayerNode, path=str(recorded.bag_path))
    graph.start(node)
    count = sum(topic in heard for topic, _ in recorded_messages)
    graph.spin_until(lambda: sum(map(len, heard.values())) == count, f"{count} messages")
    types = installed_types()
    for topic, found in heard.items():
        expected = [data for one, data in recorded_messages if one is topic]
        assert [types.canonical(data, topic.type_name) for data in found] == expected, topic
    assert not any(silent.values())
    assert node.status_values()["played"] == count


def test_player_begins_anew_with_every_activation(graph: Any, recorded: RunPlan) -> None:
    node = graph.add(PlayerNode, path=str(recorded.bag_path), expected_readers=NO_READERS)
    graph.start(node)
    graph.spin_until(lambda: node.status_values()["played"] > 5, "some messages")
    node.trigger_deactivate()
    played = node.status_values()["played"]
    graph.spin(0.1)
    assert node.status_values()["played"] == played, "it has stopped"
    graph.start_again(node)
    assert node.status_values()["played"] == 0
    graph.spin_until(lambda: node._timer is None, "the end of the bag")
    node.trigger_deactivate()
    assert node.trigger_cleanup() is TransitionCallbackReturn.SUCCESS
    assert node.trigger_configure() is TransitionCallbackReturn.SUCCESS


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("", "cannot configure: path: is not set, expected the folder of a bag"),
        ("nothing", "nothing"),
        ("text", "text"),
    ],
)
def test_what_is_no_bag_fails_the_configuration_with_the_reason(
    graph: Any, tmp_path: Path, name: str, text: str
) -> None:
    (tmp_path / "text").write_text("no bag")
    node = graph.add(PlayerNode, path=str(tmp_path / name) if name else "")
    assert node.trigger_configure() is TransitionCallbackReturn.FAILURE
    graph.await_fault(node, text)

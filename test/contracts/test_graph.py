"""Who publishes and who reads: every stream has one writer, and as many readers as are told."""

from __future__ import annotations

from collections import Counter

import pytest

from imotor_ros.contracts import graph, topics
from imotor_ros.contracts.graph import expected_readers
from imotor_ros.contracts.topics import Intent, topic_named
from imotor_ros.core.channel import MEASURED_CHANNELS


def test_every_stream_of_the_virtual_stand_has_one_writer_and_a_reader() -> None:
    written = Counter(t.name for role in graph.VIRTUAL_STAND for t in role.publishes)
    read = {t.name for role in graph.VIRTUAL_STAND for t in role.reads}
    streams = {t.name for t in topics.ALL_TOPICS if t.intent is Intent.STREAM}
    assert set(written) == streams
    assert set(written.values()) == {1}
    assert read == streams


def test_only_virtual_instruments_and_recorder_read_the_truth() -> None:
    truth = {topic.name for topic in topics.TRUTH_TOPICS}
    readers = {r.executable for r in graph.VIRTUAL_STAND if truth & {t.name for t in r.reads}}
    assert readers == {"vibrometer", "force_sensor", "recorder"}


def test_node_names_are_unique_and_remappings_lead_to_the_topics_of_the_role() -> None:
    names = [role.name for role in graph.VIRTUAL_STAND]
    assert len(set(names)) == len(names)
    for role in graph.VIRTUAL_STAND:
        own = {topic.name for topic in (*role.publishes, *role.reads)}
        assert set(role.remappings.values()) <= own


def test_expected_readers_count_the_roles_that_are_started() -> None:
    """Worked case: the voltage monitor goes to evaluator and recorder, the truth to one more."""
    whole = dict(
        item.split("=") for item in expected_readers(graph.PLANT, graph.VIRTUAL_STAND).split()
    )
    assert whole == {
        "truth/rod_velocity": "2",
        "truth/slider_velocity": "2",
        "truth/load_force": "2",
        "drive/voltage_monitor": "2",
        "drive/current": "2",
        "drive/progress": "2",
    }
    few = (graph.PLAYER, graph.EVALUATOR)
    assert "rod/velocity=1" in expected_readers(graph.PLAYER, few).split()
    assert "drive/voltage=0" in expected_readers(graph.PLAYER, few).split()
    assert expected_readers(graph.EVALUATOR, graph.VIRTUAL_STAND) == ""


def test_a_driver_writes_all_that_plant_and_instruments_write_but_the_truth() -> None:
    stand = graph.stand_with("card")
    driver = next(role for role in stand if role.name == graph.DRIVER_NAME)
    truth = set(topics.TRUTH_TOPICS)
    replaced = [role for role in graph.VIRTUAL_STAND if role not in stand]
    assert set(driver.publishes) == {t for role in replaced for t in role.publishes} - truth
    assert set(driver.reads) == {t for role in replaced for t in role.reads} - truth
    assert "rod/velocity=3" in expected_readers(driver, stand).split()
    needed = [role.name for role in graph.in_correction(stand)]
    assert needed == ["signal_generator", "driver"]
    needed = [role.name for role in graph.in_correction(graph.VIRTUAL_STAND)]
    assert needed == ["signal_generator", "plant", "rod_vibrometer"]


def test_expected_readers_are_as_a_node_takes_them() -> None:
    stand_node = pytest.importorskip("imotor_ros.nodes.stand_node", reason="needs ROS 2")
    for role in graph.VIRTUAL_STAND:
        text = expected_readers(role, graph.VIRTUAL_STAND)
        counts = stand_node.NodeParameters(expected_readers=text).reader_counts
        assert set(counts) == {topic.name for topic in role.publishes}


def test_topics_are_found_by_name() -> None:
    for topic in (*topics.ALL_TOPICS, topics.RECORDING):
        assert topic_named(topic.name) is topic
    with pytest.raises(KeyError):
        topic_named("rod/position")


def test_measured_topics_are_the_channels_of_the_core_with_their_units() -> None:
    assert {topic.name for topic in topics.MEASURED_TOPICS} == set(MEASURED_CHANNELS)
    assert all(t.unit for t in topics.ALL_TOPICS if topics.is_sampled(t))
    assert not any(t.unit for t in topics.ALL_TOPICS if not topics.is_sampled(t))

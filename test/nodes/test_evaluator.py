"""The evaluator over topics: a number where the streams are whole, a reason where they are not."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest

from imotor_ros.bag.reader import RunBag
from imotor_ros.bag.types import installed_types
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.contracts.messages import block_from_message, performance_from_message
from imotor_ros.contracts.topics import (
    CHANNELS,
    DRIVE_PROGRAM,
    MEASURED_TOPICS,
    PERFORMANCE,
    SLIDER_VELOCITY,
    Topic,
)
from imotor_ros.core.indicators import Indicator, Performance
from imotor_ros.nodes.evaluator import EvaluatorNode

Messages = list[tuple[Topic, bytes]]
NEEDED = (DRIVE_PROGRAM, CHANNELS, *MEASURED_TOPICS)


class Bench:
    """An evaluator with the parameters of a recorded run, and the writers of its streams."""

    def __init__(self, graph: Any, plan: RunPlan, **parameters: Any) -> None:
        self.graph = graph
        graph.write(*NEEDED)
        self._heard = graph.hear(PERFORMANCE)
        point = plan.parameters
        settings = {f"evaluator.{name}": value for name, value, _ in point.evaluator.leaves()}
        settings["report_interval"] = point.report_interval
        self.node = graph.add(EvaluatorNode, **{**settings, **parameters})
        graph.start(self.node)

    @property
    def performances(self) -> list[Performance]:
        """What the evaluator has said."""
        return [performance_from_message(message) for message in self._heard]

    def await_final(self) -> Performance:
        """Wait for the final word."""
        self.graph.spin_until(
            lambda: self._heard and self._heard[-1].is_final, "the final indicators"
        )
        return self.performances[-1]


def needed(messages: Messages) -> Messages:
    """Return the messages that an evaluator reads."""
    return [(topic, data) for topic, data in messages if topic in NEEDED]


def indicators(performance: Performance) -> dict[str, Indicator]:
    """Return the indicators by name."""
    return {one.name: one for one in performance.indicators}


def block_of(data: bytes, topic: Topic) -> Any:
    """Return the block in the bytes of a message."""
    block = block_from_message(installed_types().deserialize(data, topic.type_name))
    return replace(block, samples=block.samples.copy())


@pytest.mark.parametrize("seed", [None, 1, 2])
def test_indicators_are_those_of_the_run_whatever_the_order_of_streams(
    graph: Any, recorded: RunPlan, recorded_messages: Messages, seed: int | None
) -> None:
    """Every provisional report too; descriptions and program may come last of all."""
    bench = Bench(graph, recorded)
    messages = needed(recorded_messages)
    if seed is not None:
        order = [topic for topic, _ in messages]
        random.Random(seed).shuffle(order)
        queues = {t: iter([data for one, data in messages if one is t]) for t in NEEDED}
        messages = [(topic, next(queues[topic])) for topic in order]
    for topic, data in messages:
        graph.send(topic, data)
        graph.executor.spin_once(timeout_sec=0.0)
    bench.await_final()
    types = installed_types()
    expected = [
        performance_from_message(types.deserialize(data, topic.type_name))
        for topic, data in recorded_messages
        if topic is PERFORMANCE
    ]
    assert [repr(one) for one in bench.performances] == [repr(one) for one in expected]


def test_missing_block_is_a_reason_and_never_a_silent_number(
    graph: Any, recorded: RunPlan, recorded_messages: Messages
) -> None:
    bench = Bench(graph, recorded)
    messages = needed(recorded_messages)
    gap = [m for m in messages if m[0] is SLIDER_VELOCITY][3]
    for message in messages:
        if message is not gap:
            graph.send(*message)
    final = bench.await_final()
    found = indicators(final)
    for name in ("mean_velocity", "ripple", "start_up_time", "durability", "efficiency"):
        assert not found[name].is_available, name
        assert "samples of slider/velocity are missing" in found[name].reason
    counts = {one.name: (one.received, one.lost) for one in final.streams}
    length = recorded.program.length
    assert counts["slider/velocity"] == (length - 5000, 5000)
    assert counts["rod/velocity"] == (length, 0)


def test_missing_last_block_leaves_the_indicators_provisional(
    graph: Any, recorded: RunPlan, recorded_messages: Messages
) -> None:
    bench = Bench(graph, recorded)
    messages = needed(recorded_messages)
    last = [m for m in messages if m[0] is SLIDER_VELOCITY][-1]
    for message in messages:
        if message is not last:
            graph.send(*message)
    graph.spin_until(lambda: len(bench.performances) >= 3, "provisional indicators")
    graph.spin(0.2)
    assert not any(one.is_final for one in bench.performances)


def test_block_of_another_sample_rate_is_a_reason(
    graph: Any, recorded: RunPlan, recorded_messages: Messages
) -> None:
    bench = Bench(graph, recorded)
    for topic, data in needed(recorded_messages):
        if topic is SLIDER_VELOCITY:
            graph.send_block(replace(block_of(data, topic), sample_rate=5e5))
        else:
            graph.send(topic, data)
    found = indicators(bench.await_final())["mean_velocity"]
    assert not found.is_available
    assert found.reason == (
        "slider/velocity is sampled at 500000 Hz, but the drive program says 1000000 Hz"
    )


def test_wrong_description_is_a_fault(
    graph: Any, recorded: RunPlan, recorded_messages: Messages
) -> None:
    bench = Bench(graph, recorded)
    types = installed_types()
    for topic, data in needed(recorded_messages):
        if topic is CHANNELS:
            message = types.deserialize(data, topic.type_name)
            message.unit = "mm/s" if message.name == "slider/velocity" else message.unit
            data = types.serialize(message)
        graph.send(topic, data)
    graph.await_fault(bench.node, "slider/velocity: has the wrong unit, got 'mm/s'")
    assert not any(one.is_final for one in bench.performances)


def test_second_run_knows_nothing_of_the_first(
    graph: Any, recorded: RunPlan, recorded_messages: Messages
) -> None:
    bench = Bench(graph, recorded)
    for message in needed(recorded_messages)[:-7]:
        graph.send(*message)
    graph.spin_until(lambda: bench.performances, "provisional indicators")
    bench.node.trigger_deactivate()
    graph.spin(0.1)
    graph.start_again(bench.node)
    bench._heard.clear()
    for message in needed(recorded_messages):
        graph.send(*message)
    final = bench.await_final()
    with RunBag(recorded.bag_path) as bag:
        assert repr(final) == repr(bag.performance)


def test_fewer_channels_can_be_evaluated(
    graph: Any, recorded: RunPlan, recorded_messages: Messages
) -> None:
    """A stand without force sensor and monitors."""
    few = ("rod/velocity", "slider/velocity")
    bench = Bench(graph, recorded, channels=" ".join(few))
    for topic, data in needed(recorded_messages):
        if topic.name in few or topic in (DRIVE_PROGRAM, CHANNELS):
            graph.send(topic, data)
    found = indicators(bench.await_final())
    assert found["mean_velocity"].is_available
    assert not found["efficiency"].is_available
    assert found["efficiency"].reason

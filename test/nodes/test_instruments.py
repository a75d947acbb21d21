"""Virtual instruments over topics: what they are remapped to, measure and say of themselves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.contracts.messages import block_from_message, channel_from_message
from imotor_ros.contracts.topics import (
    CHANNELS,
    DRIVE_PROGRAM,
    LOAD_FORCE,
    SLIDER_VELOCITY,
    TRUE_LOAD_FORCE,
    TRUE_SLIDER_VELOCITY,
    Topic,
)
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.force_sensor import ForceSensor, ForceSensorParameters
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters
from imotor_ros.nodes.force_sensor import ForceSensorNode
from imotor_ros.nodes.vibrometer import VibrometerNode

PROGRAM: DriveProgram = steady_drive(
    run_id="run", epoch=10**18, sample_rate=1e6, fundamental_frequency=4625.0, offset=50.0,
    amplitudes=(36.0,), phases=(0.0,), hold_time=1e-3, bias_time=5e-4,
)  # fmt: skip
BLOCK = 400


def truth(topic: Topic, scale: float) -> list[SampleBlock]:
    """Return the truth of a run in blocks: a sine of some magnitude."""
    time = np.arange(PROGRAM.length) / PROGRAM.sample_rate
    samples = scale * np.sin(2 * np.pi * 4625.0 * time)
    return [
        SampleBlock(
            topic.name, "run", sample_time(PROGRAM.epoch, first, 1e6), number, first, 1e6,
            topic.unit, 0, samples[first : first + BLOCK],
        )
        for number, first in enumerate(range(0, PROGRAM.length, BLOCK))
    ]  # fmt: skip


class Bench:
    """An instrument with its peers: a slider vibrometer or a force sensor."""

    def __init__(self, graph: Any, kind: str, **parameters: Any) -> None:
        self.graph = graph
        if kind == "vibrometer":
            self.input, self.output, made = TRUE_SLIDER_VELOCITY, SLIDER_VELOCITY, VibrometerNode
            remap = {"true_velocity": self.input.name, "velocity": self.output.name}
        else:
            self.input, self.output, made = TRUE_LOAD_FORCE, LOAD_FORCE, ForceSensorNode
            remap = {}
        graph.write(DRIVE_PROGRAM, self.input)
        self.measured = graph.hear(self.output)
        self.channels = graph.hear(CHANNELS)
        self.node = graph.add(made, remap, seed=7, **parameters)
        graph.start(self.node)

    def await_blocks(self, count: int) -> list[SampleBlock]:
        """Wait for so many measured blocks."""
        self.graph.spin_until(
            lambda: len(self.measured) >= count,
            lambda: f"{count} blocks of {self.output.name}; {len(self.measured)} came",
        )
        return [block_from_message(message) for message in self.measured]


def measure(kind: str) -> tuple[Any, np.ndarray]:
    """Return the channel and the samples that the core's instrument gives."""
    if kind == "vibrometer":
        one: Any = Vibrometer(VibrometerParameters(), 1e6, 7, "slider/velocity")
        blocks = truth(TRUE_SLIDER_VELOCITY, 0.3)
    else:
        one = ForceSensor(ForceSensorParameters(), 1e6, 7, "load/force")
        blocks = truth(TRUE_LOAD_FORCE, 0.3)
    return one.channel, np.concatenate([one.process(block.samples)[0] for block in blocks])


@pytest.mark.parametrize("kind", ["vibrometer", "force_sensor"])
def test_instrument_measures_what_the_core_measures(graph: Any, kind: str) -> None:
    bench = Bench(graph, kind)
    blocks = truth(bench.input, 0.3)
    graph.send_block(blocks[0])  # before the program: it waits
    graph.announce(PROGRAM)
    for block in blocks[1:]:
        graph.send_block(block)
    found = bench.await_blocks(len(blocks))
    channel, samples = measure(kind)
    assert np.concatenate([one.samples for one in found]).tobytes() == samples.tobytes()
    assert [one.first_index for one in found] == [one.first_index for one in blocks]
    assert [one.time for one in found] == [one.time for one in blocks]
    assert {(one.stream, one.unit, one.run_id) for one in found} == {
        (bench.output.name, bench.output.unit, "run")
    }
    assert [channel_from_message(message) for message in bench.channels] == [channel]
    assert channel.name == bench.output.name


def test_over_range_is_flagged(graph: Any) -> None:
    bench = Bench(graph, "vibrometer", **{"vibrometer.velocity_range": 0.005})
    graph.announce(PROGRAM)
    blocks = truth(bench.input, 0.3)
    graph.send_block(replace(blocks[0], samples=np.zeros(BLOCK)))
    for block in blocks[1:]:
        graph.send_block(block)
    found = bench.await_blocks(len(blocks))
    assert found[0].flags == 0
    assert found[-1].flags & 1
    assert max(np.max(np.abs(one.samples)) for one in found) <= 0.05 * 1.01


@pytest.mark.parametrize("kind", ["vibrometer", "force_sensor"])
def test_gap_in_the_truth_is_a_fault_and_nothing_more_is_measured(graph: Any, kind: str) -> None:
    bench = Bench(graph, kind)
    graph.announce(PROGRAM)
    blocks = truth(bench.input, 0.3)
    graph.send_block(blocks[0])
    bench.await_blocks(1)
    for block in blocks[2:]:
        graph.send_block(block)
    graph.await_fault(bench.node, f"{bench.output.name}: expected sample 400, got sample 800")
    graph.spin(0.1)
    assert len(bench.measured) == 1


def test_not_a_number_is_a_fault(graph: Any) -> None:
    bench = Bench(graph, "force_sensor")
    graph.announce(PROGRAM)
    graph.send_block(replace(truth(bench.input, 0.3)[0], samples=np.full(BLOCK, np.inf)))
    graph.await_fault(bench.node, "is not finite, got inf")

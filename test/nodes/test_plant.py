"""The plant over topics: the samples of its role, and a fault for each stream that is not right."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from imotor_ros.campaign.roles.generator import GeneratorRole
from imotor_ros.campaign.roles.plant import PlantRole
from imotor_ros.contracts.blocks import SampleBlock
from imotor_ros.contracts.messages import block_from_message, channel_from_message
from imotor_ros.contracts.topics import (
    CHANNELS,
    CURRENT,
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    TRUTH_TOPICS,
    VOLTAGE_MONITOR,
)
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.motor import MotorParameters
from imotor_ros.nodes.plant import PlantNode

MADE = (*TRUTH_TOPICS, VOLTAGE_MONITOR, CURRENT)
BLOCK = 500


def a_program(run_id: str = "run") -> DriveProgram:
    """Return a run of some thousand samples."""
    return steady_drive(
        run_id=run_id, epoch=10**18, sample_rate=1e6, fundamental_frequency=4625.0, offset=50.0,
        amplitudes=(36.0, 12.0), phases=(0.0, -2.7), hold_time=1e-3, bias_time=5e-4,
    )  # fmt: skip


def blocks_of(program: DriveProgram) -> list[SampleBlock]:
    """Return the voltage of a run in blocks."""
    role = GeneratorRole(program, BLOCK, 10**6)
    return list(iter(role.next_block, None))


class Bench:
    """A plant, and its peers."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        graph.write(DRIVE_PROGRAM, DRIVE_VOLTAGE)
        self.progress = graph.hear(DRIVE_PROGRESS)
        self.made = {topic.name: graph.hear(topic) for topic in MADE}
        self.channels = graph.hear(CHANNELS)
        self.node = graph.add(PlantNode, seed=3)
        graph.start(self.node)

    def await_consumed(self, samples: int) -> None:
        """Wait until so many samples are consumed and all streams are there."""

        def come() -> int:
            ends = [sum(len(m.samples) for m in stream) for stream in self.made.values()]
            return min([*ends, self.progress[-1].consumed if self.progress else 0])

        self.graph.spin_until(
            lambda: come() >= samples, lambda: f"{samples} samples; {come()} came"
        )

    def await_fault(self, text: str) -> Any:
        """Wait for a fault on drive/progress and in the diagnostics; return the message."""
        self.graph.spin_until(
            lambda: any(text in message.fault for message in self.progress),
            lambda: f"the fault {text!r}; faults were {[m.fault for m in self.progress]}",
        )
        self.graph.await_fault(self.node, text)
        return self.progress[-1]

    @property
    def ramped(self) -> bool:
        """Whether all streams have ended with a ramp that the plant made by itself."""
        ends = [stream[-1].flags if stream else 0 for stream in self.made.values()]
        return all(flags & SampleFlag.RAMPED_DOWN for flags in ends)

    def samples(self, name: str) -> np.ndarray:
        """Return the samples that came on a stream."""
        return np.concatenate([block_from_message(m).samples for m in self.made[name]])


def expected(program: DriveProgram) -> dict[str, np.ndarray]:
    """Return what the role makes of a run, by stream."""
    role = PlantRole(MotorParameters(), 3, program)
    made: dict[str, list[np.ndarray]] = {}
    for block in blocks_of(program):
        for one in role.process(block).blocks:
            made.setdefault(one.stream, []).append(one.samples)
    return {name: np.concatenate(pieces) for name, pieces in made.items()}


def test_plant_gives_the_samples_of_its_role_and_acknowledges_them(graph: Any) -> None:
    bench, program = Bench(graph), a_program()
    graph.announce(program)
    blocks = blocks_of(program)
    for block in blocks:
        graph.send_block(block)
    bench.await_consumed(program.length)
    for name, samples in expected(program).items():
        assert bench.samples(name).tobytes() == samples.tobytes(), name
    assert [m.consumed for m in bench.progress] == [block.end_index for block in blocks]
    assert all(m.fault == "" and m.run_id == "run" for m in bench.progress)
    first = block_from_message(bench.made["drive/current"][0])
    assert (first.unit, first.time, first.sequence) == ("A", program.epoch, 0)


def test_monitors_are_described_also_to_late_joiners(graph: Any) -> None:
    bench, program = Bench(graph), a_program()
    graph.announce(program)
    graph.spin_until(lambda: len(bench.channels) == 2, "two channels")
    late: list[Any] = []
    from imotor_ros.nodes.message_types import message_class
    from imotor_ros.nodes.qos import qos_profile

    kind = message_class(CHANNELS.type_name)
    graph.probe.create_subscription(kind, CHANNELS.name, late.append, qos_profile(CHANNELS))
    graph.spin_until(lambda: len(late) == 2, "the channels for a late joiner")
    described = {channel_from_message(message).name for message in late}
    assert described == {"drive/voltage_monitor", "drive/current"}
    assert {message.run_id for message in late} == {"run"}


def test_blocks_wait_for_their_program(graph: Any) -> None:
    """The two come on different topics, in any order."""
    bench, program = Bench(graph), a_program()
    blocks = blocks_of(program)
    for block in blocks[:3]:
        graph.send_block(block)
    graph.spin(0.2)
    assert not bench.progress
    graph.announce(program)
    for block in blocks[3:]:
        graph.send_block(block)
    bench.await_consumed(program.length)
    current = expected(program)["drive/current"]
    assert bench.samples("drive/current").tobytes() == current.tobytes()


def test_blocks_of_a_run_that_is_not_announced_wait_for_ever(graph: Any) -> None:
    bench, program = Bench(graph), a_program()
    graph.announce(program)
    graph.send_block(replace(blocks_of(program)[0], run_id="other"))
    for block in blocks_of(program):
        graph.send_block(block)
    bench.await_consumed(program.length)
    assert not graph.faults(bench.node)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (lambda block: replace(block, first_index=2 * BLOCK, sequence=2),
         "drive/voltage: expected sample 500, got sample 1000"),
        (lambda block: replace(block, first_index=0, sequence=0),
         "drive/voltage: expected sample 500, got sample 0"),
        (lambda block: replace(block, samples=np.full(BLOCK, np.nan)), "is not finite, got nan"),
        (lambda block: replace(block, sample_rate=5e5),
         "drive/voltage: has another sample rate, got 500000.0"),
    ],
    ids=["gap", "repeated", "nan", "sample rate"],
)  # fmt: skip
def test_stream_that_is_not_right_is_a_fault_and_consumed_no_further(
    graph: Any, changes: Any, text: str
) -> None:
    bench, program = Bench(graph), a_program()
    blocks = blocks_of(program)
    graph.announce(program)
    graph.send_block(blocks[0])
    bench.await_consumed(BLOCK)
    graph.send_block(changes(blocks[1]))
    last = bench.await_fault(text)
    assert last.fault.startswith("plant: ")
    assert (last.run_id, last.consumed) == ("run", BLOCK)
    assert last.flags == SampleFlag.RAMPED_DOWN
    graph.spin_until(lambda: bench.ramped, "the ramp to zero on all streams")
    made = {name: len(stream) for name, stream in bench.made.items()}
    for block in blocks[2:]:
        graph.send_block(block)
    graph.spin(0.2)
    assert bench.progress[-1] is last
    assert made == {name: len(stream) for name, stream in bench.made.items()}


def test_bad_program_is_a_fault(graph: Any) -> None:
    from imotor_ros.contracts.messages import program_to_message

    bench = Bench(graph)
    message = program_to_message(graph.types, a_program())
    message.segments[0].start_offset = float("nan")
    graph.send(DRIVE_PROGRAM, message)
    graph.await_fault(bench.node, "bias: is not finite")


def test_second_run_begins_at_rest(graph: Any) -> None:
    """After deactivation and activation, also if the first run ended in a fault."""
    bench, program = Bench(graph), a_program()
    graph.announce(program)
    blocks = blocks_of(program)
    for block in (*blocks[:2], blocks[3]):
        graph.send_block(block)
    bench.await_fault("expected sample 1000, got sample 1500")
    graph.spin_until(lambda: bench.ramped, "the ramp to zero on all streams")
    bench.node.trigger_deactivate()
    for heard in (bench.progress, *bench.made.values()):
        heard.clear()
    graph.start_again(bench.node)
    graph.announce(program)
    for block in blocks:
        graph.send_block(block)
    bench.await_consumed(program.length)
    for name, samples in expected(program).items():
        assert bench.samples(name).tobytes() == samples.tobytes(), name

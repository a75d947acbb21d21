"""A small run of the stand, as messages, for the tests of bags."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imotor_ros.bag.types import BagTypes, installed_types
from imotor_ros.bag.writer import RunWriter
from imotor_ros.contracts import messages, topics
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram, DriveSegment
from imotor_ros.core.indicators import Indicator, Performance, StreamCount

EPOCH = 946_684_800 * 10**9
RATE = 1e6
SAMPLED = tuple(topic for topic in topics.ALL_TOPICS if topics.is_sampled(topic))


@dataclass(frozen=True)
class Message:
    """One message as the recorder gets it: topic, bytes, own time and end of its samples (ns)."""

    topic: str
    data: bytes
    time: int
    end: int


@dataclass(frozen=True)
class StandRun:
    """A made-up run: `blocks` blocks of `size` samples on every stream."""

    run_id: str = "run-1"
    blocks: int = 5
    size: int = 100
    seed: int = 1
    types: BagTypes = installed_types()

    @property
    def info(self) -> dict[str, Any]:
        return {"run_id": self.run_id, "seed": self.seed, "parameters": {"stroke": 15e-6}}

    @property
    def length(self) -> int:
        return self.blocks * self.size

    @property
    def program(self) -> DriveProgram:
        segment = DriveSegment("hold", self.length, 1e3, 1e3, 0.0, 0.0, (5.0,), (5.0,), (0.1,))
        return DriveProgram(self.run_id, EPOCH, RATE, 1e3, (segment,), (1e-6,), (0.0,))

    @property
    def channels(self) -> list[ChannelDescription]:
        return [
            ChannelDescription(topic.name, "quantity", topic.unit, 1.0)
            for topic in topics.MEASURED_TOPICS
        ]

    def samples(self, stream: str) -> np.ndarray:
        """All samples of a stream: noise on a grid of 2**-13, as a digitiser makes it."""
        seed = [self.seed, *stream.encode()]
        noise = np.random.default_rng(seed).standard_normal(self.length)
        return np.round(noise * 2**10) / 2**13

    def block(self, stream: str, number: int) -> SampleBlock:
        first = number * self.size
        time = sample_time(EPOCH, first, RATE)
        samples = self.samples(stream)[first : first + self.size]
        unit = topics.topic_named(stream).unit
        return SampleBlock(stream, self.run_id, time, number, first, RATE, unit, 0, samples)

    def block_message(self, block: SampleBlock) -> Message:
        end = sample_time(EPOCH, block.end_index, block.sample_rate)
        data = self.types.serialize(messages.block_to_message(self.types, block))
        return Message(block.stream, data, block.time, end)

    def message(self, topic: topics.Topic, content: Any) -> Message:
        time = messages.message_time(content)
        return Message(topic.name, self.types.serialize(content), time, time)

    def performance(self, end: int, is_final: bool) -> Message:
        result = Performance(
            run_id=self.run_id,
            is_final=is_final,
            indicators=(Indicator("mean_velocity", "m/s", 0.1, 0.01),),
            streams=(StreamCount("rod/velocity", end, 0),),
            end_index=end,
        )
        time = sample_time(EPOCH, end, RATE)
        content = messages.performance_to_message(self.types, result, time)
        return self.message(topics.PERFORMANCE, content)

    def latched(self) -> Iterator[Message]:
        from imotor_ros.bag.facts import to_json

        info = messages.run_info_to_message(
            self.types, self.run_id, EPOCH, to_json(self.info, "info")
        )
        yield self.message(topics.RUN_INFO, info)
        program = messages.program_to_message(self.types, self.program)
        yield self.message(topics.DRIVE_PROGRAM, program)
        for channel in self.channels:
            content = messages.channel_to_message(self.types, channel, self.run_id, EPOCH)
            yield self.message(topics.CHANNELS, content)

    def stream(self, name: str) -> Iterator[Message]:
        for number in range(self.blocks):
            yield self.block_message(self.block(name, number))

    def progress(self) -> Iterator[Message]:
        for number in range(1, self.blocks + 1):
            consumed = number * self.size
            time = sample_time(EPOCH, consumed, RATE)
            content = messages.progress_to_message(self.types, self.run_id, time, consumed)
            yield self.message(topics.DRIVE_PROGRESS, content)

    def diagnostics(self, time: int) -> Message:
        content = messages.run_info_to_message(self.types, "", time, "").header
        array = self.types.message("diagnostic_msgs/msg/DiagnosticArray", header=content, status=[])
        return self.message(topics.DIAGNOSTICS, array)

    def by_topic(self) -> dict[str, list[Message]]:
        """All messages of the run, each topic in its own order."""
        result: dict[str, list[Message]] = {}
        for message in self.latched():
            result.setdefault(message.topic, []).append(message)
        for topic in SAMPLED:
            result[topic.name] = list(self.stream(topic.name))
        result[topics.DRIVE_PROGRESS.name] = list(self.progress())
        result[topics.PERFORMANCE.name] = [
            self.performance(self.length // 2, False),
            self.performance(self.length, True),
        ]
        return result

    def in_order(self) -> list[Message]:
        """All messages by time; with rising log times they make a bag."""
        every = [message for stream in self.by_topic().values() for message in stream]
        return sorted(every, key=lambda message: message.time)

    def write(self, path: Path, **options: Any) -> Path:
        """Write the bag of the run; return its folder."""
        writer = RunWriter(path, run_id=self.run_id, run_info=self.info, **options)
        with writer:
            for number, message in enumerate(self.in_order()):
                writer.write(message.topic, message.data, EPOCH + number)
            writer.close("completed", {"verdict": "good"})
        return path


@pytest.fixture(scope="session")
def stand_run() -> type[StandRun]:
    """The class `StandRun`."""
    return StandRun

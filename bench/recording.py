"""
Cost of recording, reading and recovering: nine streams at 1 MS/s, blocks of 10 000 samples.

Run as `python bench/recording.py [SECONDS_OF_STREAM]`. For compressed and plain chunks it prints
wall and CPU time over the time that the samples stand for, bytes per second of CPU, and the size
of the file over that of the messages. What is recovered is the bag less its last tenth.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imotor_ros.bag.ordering import MessageOrder
from imotor_ros.bag.reader import RunBag
from imotor_ros.bag.recover import recover
from imotor_ros.bag.types import installed_types
from imotor_ros.bag.writer import RunWriter
from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.contracts.messages import block_to_message

RATE, SIZE = 1e6, 10_000
STREAMS = [topic for topic in topics.ALL_TOPICS if topics.is_sampled(topic)]
CYCLE = 20


def signal(stream: str) -> NDArray[np.float64]:
    """Return CYCLE blocks: a drive signal, with noise of 14 bit where an instrument measured it."""
    rng = np.random.default_rng(list(stream.encode()))
    phase = rng.uniform(0.0, 1.0) + 2 * np.pi * 4631.7 * np.arange(CYCLE * SIZE) / RATE
    clean: NDArray[np.float64] = 0.3 * np.sin(phase) + 0.12 * np.sin(2 * phase + 0.8)
    if stream.startswith(("truth/", "drive/voltage")) and stream != "drive/voltage_monitor":
        return clean
    step = 20.0 / 2**14 * 0.125
    noise = 0.5e-6 * np.sqrt(RATE / 2) * rng.standard_normal(len(clean))
    measured_signal: NDArray[np.float64] = np.round((clean + noise) / step) * step
    return measured_signal


def messages(seconds: float) -> list[tuple[str, bytes, int, int]]:
    """Return the messages as a recorder gets them."""
    types = installed_types()
    signals = {topic.name: signal(topic.name).reshape(CYCLE, SIZE) for topic in STREAMS}
    result = []
    for number in range(round(seconds * RATE / SIZE)):
        first = number * SIZE
        moments = [sample_time(0, index, RATE) for index in (first, first + SIZE)]
        for topic in STREAMS:
            samples = signals[topic.name][number % CYCLE]
            block = SampleBlock(
                topic.name, "run", moments[0], number, first, RATE, topic.unit, 0, samples
            )
            data = types.serialize(block_to_message(types, block))
            result.append((topic.name, data, moments[0], moments[1]))
    return result


def record(path: Path, given: list[tuple[str, bytes, int, int]], is_compressed: bool) -> None:
    """Order and write the messages."""
    order = MessageOrder([topic.name for topic in STREAMS])
    with RunWriter(path, run_id="run", run_info={}, is_compressed=is_compressed) as writer:
        for topic, data, moment, end in given:
            order.add(topic, data, moment, end)
            for message in order.ready():
                writer.write(message.topic, message.data, message.time)
        for message in order.flush():
            writer.write(message.topic, message.data, message.time)


def measured(action: Callable[[], object]) -> tuple[float, float]:
    """Return wall and CPU time (s) of an action."""
    wall, cpu = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - wall, time.process_time() - cpu


def read(path: Path) -> int:
    with RunBag(path) as bag:
        return sum(len(block.samples) for block in bag.blocks())


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0
    given = messages(seconds)
    size = sum(len(data) for _, data, _, _ in given)
    print(f"{len(STREAMS)} streams, {seconds:g} s, {size / 1e6:.0f} MB of messages")
    print(f"{'':16}{'wall/real':>10}{'CPU/real':>10}{'MB/s CPU':>10}{'file/given':>12}")
    folder = Path(tempfile.mkdtemp())
    try:
        for name, is_compressed in (("zstd", True), ("plain", False)):
            path = folder / name
            file = path / f"{name}.mcap"
            row(f"record {name}", partial(record, path, given, is_compressed), size, seconds)
            print(f"{file.stat().st_size / size:12.3f}")
            row(f"read {name}", partial(read, path), size, seconds)
            with file.open("r+b") as stream:
                stream.truncate(file.stat().st_size * 9 // 10)
            row(f"\nrecover {name}", partial(recover, path), 0.9 * size, 0.9 * seconds)
            print()
    finally:
        shutil.rmtree(folder)


def row(name: str, action: Callable[[], object], size: float, seconds: float) -> None:
    wall, cpu = measured(action)
    times = f"{wall / seconds:10.3f}{cpu / seconds:10.3f}{size / 1e6 / cpu:10.0f}"
    print(f"{name:16}{times}", end="")


if __name__ == "__main__":
    main()

"""
Recorded waveforms as plain scalars, for viewers that cannot plot blocks of samples.

PlotJuggler and Foxglove plot one number a message, or a column of a table. Where there are more
samples than points wanted, each stretch of samples gives two points, its smallest and its largest,
in their order: so no peak is lost, and a waveform looks as it is.
"""

from __future__ import annotations

import csv
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from imotor_ros.bag.reader import RunBag
from imotor_ros.contracts.blocks import sample_time
from imotor_ros.contracts.topics import ALL_TOPICS, DEFAULT_NAMESPACE, is_sampled
from imotor_ros.errors import BadInputError

Samples = NDArray[np.float64]

SCALAR_TYPE = "std_msgs/msg/Float64"

FEWEST_POINTS = 2

_CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"


@dataclass(frozen=True)
class Excerpt:
    """
    What is taken of a bag.

    Attributes
    ----------
    begin, end : float
        Times since the start of the run (s); the end may lie beyond that of the run.
    points : int
        Points of each channel, at most; 2 or more.

    """

    begin: float = 0.0
    end: float = float("inf")
    points: int = 20_000

    def __post_init__(self) -> None:
        """Check that there can be something in it."""
        if not 0.0 <= self.begin < self.end:
            raise BadInputError(
                "is no stretch of time", where="begin and end", value=(self.begin, self.end),
                bound="0 <= begin < end",
            )  # fmt: skip
        if self.points < FEWEST_POINTS:
            raise BadInputError(
                "are too few", where="points", value=self.points, bound=f">= {FEWEST_POINTS}"
            )


@dataclass(frozen=True)
class Trace:
    """
    Points of one channel.

    Attributes
    ----------
    name : str
        The channel.
    unit : str
        Its unit.
    index : ndarray of int, shape (n,)
        Samples of the run.
    values : ndarray, shape (n,)
        Their values (unit).

    """

    name: str
    unit: str
    index: NDArray[np.int64]
    values: Samples


def thin_out(samples: Samples, points: int) -> NDArray[np.int64]:
    """
    Return which samples show a waveform in so many points.

    All, if there are not more; otherwise the smallest and the largest of equal stretches.

    Examples
    --------
    >>> thin_out(np.array([0.0, 3.0, 1.0, 2.0, -1.0, 0.0]), 4).tolist()
    [0, 1, 3, 4]

    """
    count = samples.size
    if count <= points:
        return np.arange(count)
    width = -(-count // (points // 2))
    whole = count // width * width
    body = samples[:whole].reshape(-1, width)
    start = np.arange(0, whole, width)
    chosen = [start + np.argmin(body, axis=1), start + np.argmax(body, axis=1)]
    if whole < count:
        rest = samples[whole:]
        chosen.append(whole + np.array([np.argmin(rest), np.argmax(rest)]))
    return np.unique(np.concatenate(chosen))


def read_traces(bag: RunBag, excerpt: Excerpt) -> tuple[Trace, ...]:
    """
    Return the sampled streams of a bag, thinned out.

    Raises
    ------
    BadInputError
        If nothing was recorded in the stretch of time.

    """
    rate = bag.program.sample_rate
    first, last = excerpt.begin * rate, min(excerpt.end * rate, float(bag.program.length))
    traces = []
    for topic in ALL_TOPICS:
        if not is_sampled(topic) or topic.name not in bag.topics:
            continue
        samples, _, start = bag.samples(topic.name, allow_gaps=True)
        low = max(0, int(np.ceil(first)) - start)
        high = max(low, min(samples.size, int(np.ceil(last)) - start))
        chosen = low + thin_out(samples[low:high], excerpt.points)
        if chosen.size:
            traces.append(Trace(topic.name, topic.unit, start + chosen, samples[chosen]))
    if not traces:
        raise BadInputError(
            "holds no samples in this time", where=str(bag.path),
            value=(excerpt.begin, excerpt.end), bound=f"0 to {bag.program.length / rate:g} s",
        )  # fmt: skip
    return tuple(traces)


def export_mcap(bag_path: Path, target: Path, excerpt: Excerpt) -> tuple[Trace, ...]:
    """
    Write a bag with one topic of scalars, ``/stand/scope/...``, for every channel.

    The log time of each message is that of its sample.

    Raises
    ------
    BadInputError
        If the target exists, or nothing was recorded in that time.
    UnreadableFileError
        If the bag cannot be read.

    """
    if target.exists():
        raise BadInputError("exists already", where=str(target), bound="a new folder")
    with RunBag(bag_path) as bag:
        traces, program = read_traces(bag, excerpt), bag.program
    store = get_typestore(Stores.ROS2_JAZZY)
    places = np.concatenate([np.full(one.index.size, i) for i, one in enumerate(traces)])
    index = np.concatenate([one.index for one in traces])
    values = np.concatenate([one.values for one in traces])
    order = np.lexsort((places, index))
    with Writer(target, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = [
            writer.add_connection(scope_topic(one.name), SCALAR_TYPE, typestore=store)
            for one in traces
        ]
        for i in order:
            time = sample_time(program.epoch, int(index[i]), program.sample_rate)
            data = _CDR_LITTLE_ENDIAN + struct.pack("<d", values[i])
            writer.write(topics[places[i]], time, data)
    return traces


def scope_topic(channel: str) -> str:
    """Return the topic that a channel has in an exported bag."""
    return f"{DEFAULT_NAMESPACE}/scope/{channel}"


def export_csv(bag_path: Path, target: Path, excerpt: Excerpt) -> tuple[Trace, ...]:
    """
    Write a table: time (s since the start of the run), and a column for every channel.

    A channel that has no point at a time has an empty field there.

    Raises
    ------
    BadInputError
        If the target exists, or nothing was recorded in that time.
    UnreadableFileError
        If the bag cannot be read.

    """
    if target.exists():
        raise BadInputError("exists already", where=str(target), bound="a new file")
    with RunBag(bag_path) as bag:
        traces, rate = read_traces(bag, excerpt), bag.program.sample_rate
    rows = np.unique(np.concatenate([one.index for one in traces]))
    columns = []
    for one in traces:
        column = np.full(rows.size, "", dtype=object)
        column[np.searchsorted(rows, one.index)] = [repr(float(value)) for value in one.values]
        columns.append(column)
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time (s)", *(f"{one.name} ({one.unit})" for one in traces)])
        writer.writerows(zip((repr(float(i) / rate) for i in rows), *columns, strict=True))
    return traces

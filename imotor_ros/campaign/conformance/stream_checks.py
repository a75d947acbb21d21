"""Checks on what a driver says of its samples: order, time, rate, units, descriptions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from imotor_ros.campaign.conformance.record import Published, RunRecord
from imotor_ros.campaign.conformance.requirements import Findings
from imotor_ros.contracts.blocks import sample_time
from imotor_ros.contracts.topics import topic_named
from imotor_ros.core.channel import ChannelDescription, SampleFlag

QUANTITIES: Mapping[str, tuple[str, str]] = {
    "rod/velocity": ("velocity", "m/s"),
    "slider/velocity": ("velocity", "m/s"),
    "load/force": ("force", "N"),
    "drive/voltage_monitor": ("voltage", "V"),
    "drive/current": ("current", "A"),
}
"""Quantity and unit of every measured channel."""


_FAR = 3.0
"""No instrument shows so many times its range; what does has another unit."""


def check_streams(
    record: RunRecord, streams: Sequence[str], findings: Findings, *, to_the_end: bool = True
) -> None:
    """
    Check order, time, rate, labels and numbers of all blocks of a run.

    Parameters
    ----------
    record : RunRecord
        The run.
    streams : sequence of str
        The measured streams that the driver has.
    findings : Findings
        Receives what is found.
    to_the_end : bool
        Whether every stream has to come to the end of the program.

    """
    length = record.program.length if to_the_end else None
    total = sum(len(record.blocks.get(stream, ())) for stream in streams)
    numbers = f"{total} blocks of {len(streams)} streams of run {record.program.run_id}"
    findings.judge("D1", _orders(record, streams, length), f"{numbers}: indices without gap")
    findings.judge("D2", _each(record, streams, _stamp_defect), f"{numbers}: exact to 1 ns")
    findings.judge(
        "D3", _each(record, streams, _rate_defect), f"{numbers}: {record.program.sample_rate:g} Hz"
    )
    findings.judge("D4", _each(record, streams, _label_defect), numbers)
    findings.judge("D5", _number_defects(record, streams), f"{numbers}: finite and in range")


def _orders(record: RunRecord, streams: Iterable[str], length: int | None) -> Iterator[str]:
    for stream in streams:
        yield from order_defects(stream, record.blocks.get(stream, []), length)


def order_defects(stream: str, blocks: Sequence[Published], length: int | None) -> Iterator[str]:
    """
    Yield the first break in the order of a stream's blocks.

    Parameters
    ----------
    stream : str
        Name of the stream.
    blocks : sequence of Published
        Its blocks as they came.
    length : int or None
        Number of samples in all; None if any number will do.

    """
    index = sequence = 0
    for one in blocks:
        block = one.block
        if not len(block.samples):
            yield f"{stream}: block {block.sequence} is empty"
            return
        if block.first_index != index:
            missing = block.first_index - index
            what = f"{missing} sample(s) missing" if missing > 0 else f"{-missing} sample(s) again"
            yield (
                f"{stream}: {what}: block {block.sequence} begins with sample "
                f"{block.first_index}, expected {index}"
            )
            return
        if block.sequence != sequence:
            yield f"{stream}: block number {block.sequence} came, expected {sequence}"
            return
        index, sequence = block.end_index, sequence + 1
    if length is not None and index != length:
        what = "too few" if index < length else "too many"
        yield f"{stream}: {what} samples: {index} of {length} came"


def _each(record: RunRecord, streams: Iterable[str], check: object) -> Iterator[str]:
    """Yield the first defect of each stream."""
    assert callable(check)
    for stream in streams:
        for one in record.blocks.get(stream, ()):
            if defect := check(record, stream, one):
                yield f"{stream}: block {one.block.sequence}: {defect}"
                break


def _stamp_defect(record: RunRecord, _stream: str, one: Published) -> str:
    program, block = record.program, one.block
    right = sample_time(program.epoch, block.first_index, program.sample_rate)
    if block.time == right:
        return ""
    wrong = block.time - right
    by = f"stamp {block.time} ns, expected {right} ns"
    if abs(block.time - one.moment) < 60_000_000_000 < abs(wrong):
        return f"{by}: it is the time of the clock, not of the sample"
    return f"{by} (off by {wrong} ns)"


def _rate_defect(record: RunRecord, _stream: str, one: Published) -> str:
    right = record.program.sample_rate
    rate = one.block.sample_rate
    return "" if rate == right else f"wrong rate: sample_rate is {rate:g} Hz, expected {right:g} Hz"


def _label_defect(_record: RunRecord, stream: str, one: Published) -> str:
    # the run id is right: by it the block was sorted into this record
    if one.block.unit != topic_named(stream).unit:
        return f"wrong unit: {one.block.unit!r}, expected {topic_named(stream).unit!r}"
    if one.block.stream != stream:
        return f"frame_id is {one.block.stream!r}, expected {stream!r}"
    return ""


def _number_defects(record: RunRecord, streams: Iterable[str]) -> Iterator[str]:
    for stream in streams:
        described = record.descriptions.get(stream)
        bound = math.inf if described is None else _largest(described.channel)
        for one in record.blocks.get(stream, ()):
            if defect := _number_defect(one, bound):
                yield f"{stream}: {defect}"
                break


def _largest(channel: ChannelDescription) -> float:
    """Return what a channel cannot show more of: its range, with error and offset of its scale."""
    scale = 1.0 + 4.0 * channel.gain_uncertainty
    return channel.range * scale + 4.0 * channel.offset_uncertainty + 2.0 * channel.resolution


def _number_defect(one: Published, bound: float) -> str:
    samples = one.block.samples
    is_finite = np.isfinite(samples)
    if not is_finite.all():
        place = int(np.argmin(is_finite))
        return f"sample {one.block.first_index + place} is {samples[place]}, not a finite number"
    largest = float(np.abs(samples).max(initial=0.0))
    is_flagged = bool(one.block.flags & SampleFlag.OVER_RANGE)
    if largest > bound and not is_flagged:
        hint = ": is the unit wrong?" if largest > _FAR * bound else ""
        return (
            f"block {one.block.sequence} shows {largest:.4g} without FLAG_OVER_RANGE, "
            f"range {bound:.4g}{hint}"
        )
    return ""


# ---- descriptions ----------------------------------------------------------------------------


def check_channels(record: RunRecord, streams: Sequence[str], findings: Findings) -> None:
    """
    Check what the driver says of its channels in a run.

    Parameters
    ----------
    record : RunRecord
        The run.
    streams : sequence of str
        The measured streams that the driver has.
    findings : Findings
        Receives what is found.

    """
    defects = [*_absences(record, streams)]
    findings.judge("C1", defects, f"{len(streams)} channels described for {record.program.run_id}")
    known = {name: one.channel for name, one in record.descriptions.items() if name in QUANTITIES}
    defects = [f"{name}: {text}" for name, c in known.items() for text in _unit_defects(name, c)]
    units = ", ".join(f"{name} {QUANTITIES[name][1]}" for name in known)
    findings.judge("C2", defects, units)
    rate = record.program.sample_rate
    defects = [f"{name}: {text}" for name, c in known.items() for text in _impossible(c, rate)]
    findings.judge("C3", defects, "ranges, delays, bandwidths and uncertainties are possible")


def _absences(record: RunRecord, streams: Iterable[str]) -> Iterator[str]:
    for stream in streams:
        if stream not in record.descriptions:
            yield f"{stream} is published, but not described on channels"
    for name, one in record.descriptions.items():
        if name not in streams and name not in record.blocks:
            yield f"{name} is described on channels, but not published"
        if one.epoch != record.program.epoch:
            yield f"{name}: stamp of its description is {one.epoch} ns, not that of sample 0"


def _unit_defects(name: str, channel: ChannelDescription) -> Iterator[str]:
    quantity, unit = QUANTITIES[name]
    if channel.unit != unit:
        yield f"wrong unit: {channel.unit!r}, expected {unit!r}"
    if channel.quantity != quantity:
        yield f"quantity is {channel.quantity!r}, expected {quantity!r}"


def _impossible(channel: ChannelDescription, rate: float) -> Iterator[str]:
    bounds = {
        "range": (0.0, math.inf, True),
        "resolution": (0.0, channel.range, False),
        "gain_uncertainty": (0.0, 1.0, False),
        "offset_uncertainty": (0.0, channel.range, False),
        "noise_density": (0.0, channel.range, False),
        "bandwidth": (0.0, math.inf, True),
        "high_pass_frequency": (0.0, 0.5 * rate, False),
        "delay": (0.0, 1.0, False),
    }
    for key, (low, high, excludes_low) in bounds.items():
        value = getattr(channel, key)
        if not low <= value <= high or (excludes_low and value == low) or math.isinf(value):
            sign = ">" if excludes_low else ">="
            yield f"{key} is {value:g}, expected {sign} {low:g} and <= {high:g}"
    if not channel.instrument:
        yield "the instrument is not named"

"""Checks on how a driver brings the voltage to zero, and on what it says of a fault."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from imotor_ros.campaign.conformance.record import RunRecord
from imotor_ros.campaign.conformance.stream_checks import order_defects
from imotor_ros.contracts.topics import VOLTAGE_MONITOR
from imotor_ros.core.channel import SampleFlag

RAMP_TIME = 50e-3
"""Longest time (s) from the last sample of the program to zero."""

_SETTLING = 1e-3
"""Time (s) that amplifier and monitor may take to settle."""


def voltage_tolerance(record: RunRecord, voltage: float = 0.0) -> float:
    """Return by how much (V) the monitor may differ from a voltage (V) put out."""
    described = record.descriptions.get(VOLTAGE_MONITOR.name)
    if described is None:
        return 1.0
    channel = described.channel
    error = 4.0 * (channel.gain_uncertainty * abs(voltage) + channel.offset_uncertainty)
    return error + channel.resolution + 0.02 * abs(voltage) + 0.1


def last_voltage(record: RunRecord) -> float:
    """Return the voltage (V) that the monitor showed last; NaN if it showed none."""
    blocks = record.blocks.get(VOLTAGE_MONITOR.name, ())
    tail = [one.block.samples for one in blocks[-2:]]
    if not tail:
        return float("nan")
    return float(np.concatenate(tail)[-20:].mean())


def is_at_zero(record: RunRecord) -> bool:
    """Whether the monitor showed zero at last."""
    return bool(abs(last_voltage(record)) <= voltage_tolerance(record))


def ramp_defects(record: RunRecord, streams: Sequence[str]) -> Iterator[str]:
    """
    Yield what is wrong with a ramp that the driver made by itself.

    Parameters
    ----------
    record : RunRecord
        A run that ended before its program, with the voltage on.
    streams : sequence of str
        The measured streams that the driver has.

    """
    monitor = VOLTAGE_MONITOR.name
    shown = last_voltage(record)
    if not is_at_zero(record):
        yield f"the voltage stays on: the monitor's last samples show {shown:.4g} V"
        return
    rate = record.program.sample_rate
    ramp = record.samples(monitor)[record.consumed :]
    if len(ramp) > (RAMP_TIME + _SETTLING) * rate:
        yield (
            f"the ramp takes {len(ramp) / rate * 1e3:.1f} ms of stream time, "
            f"allowed {RAMP_TIME * 1e3:g} ms"
        )
    yield from _jumps(record)
    if not any(one.block.flags & SampleFlag.RAMPED_DOWN for one in record.blocks.get(monitor, ())):
        yield "no block of the monitor has FLAG_RAMPED_DOWN, although the voltage left the program"
    yield from continuation_defects(record, streams)


def _jumps(record: RunRecord) -> Iterator[str]:
    samples = record.samples(VOLTAGE_MONITOR.name)
    asked = record.asked()
    steps = np.abs(np.diff(samples))
    fastest = float(np.abs(np.diff(asked[np.isfinite(asked)])).max(initial=0.0))
    bound = 3.0 * fastest + 2.0
    after = max(0, record.consumed - 1)
    if len(steps) > after and float(steps[after:].max()) > bound:
        place = after + int(np.argmax(steps[after:]))
        yield (
            f"the voltage jumps by {steps[place]:.3g} V at sample {place + 1}, "
            f"allowed {bound:.2g} V"
        )


def continuation_defects(record: RunRecord, streams: Sequence[str]) -> Iterator[str]:
    """Yield what is missing in the streams of a run that ended early: all end at one sample."""
    ends = {stream: record.end_index(stream) for stream in streams}
    for stream in streams:
        yield from order_defects(stream, record.blocks.get(stream, []), None)
    if len(set(ends.values())) > 1:
        texts = ", ".join(f"{stream} {end}" for stream, end in ends.items())
        yield f"the streams end at different samples: {texts}"


def fault_defects(record: RunRecord, text: str = "") -> Iterator[str]:
    """
    Yield what is wrong with the report of a fault on drive/progress.

    Parameters
    ----------
    record : RunRecord
        The run.
    text : str
        What the reason has to contain.

    """
    faults = [one for one in record.progress if one.fault]
    if not faults:
        yield "no fault is told on drive/progress"
        return
    if text and text not in faults[0].fault:
        yield f"the fault {faults[0].fault!r} does not say {text!r}"
    if _was_on(record) and not faults[0].flags & SampleFlag.RAMPED_DOWN:
        yield "the fault is told without FLAG_RAMPED_DOWN, although the voltage was on"
    before = max((one.consumed for one in record.progress if not one.fault), default=0)
    if any(one.consumed > before for one in faults):
        yield f"acknowledges samples with its fault ({faults[0].consumed} after {before})"
    place = record.progress.index(faults[0])
    if any(not one.fault for one in record.progress[place + 1 :]):
        yield "goes on acknowledging after its fault"


def _was_on(record: RunRecord) -> bool:
    """Whether the monitor showed voltage with the last samples acknowledged."""
    shown = record.samples(VOLTAGE_MONITOR.name)[: record.consumed]
    return bool(shown.size) and abs(float(shown[-1])) > 5.0 * voltage_tolerance(record)


def clipping_defects(record: RunRecord, low: float, high: float) -> Iterator[str]:
    """
    Yield what is wrong where voltage out of range was asked for.

    Parameters
    ----------
    record : RunRecord
        The run.
    low, high : float
        The range (V).

    """
    samples = record.samples(VOLTAGE_MONITOR.name)
    if samples.size:
        least, most = float(samples.min()), float(samples.max())
        if most > high + voltage_tolerance(record, high):
            yield f"the monitor shows {most:.4g} V, beyond the range of {low:g} to {high:g} V"
        if least < low - voltage_tolerance(record, low):
            yield f"the monitor shows {least:.4g} V, beyond the range of {low:g} to {high:g} V"
    is_told = bool(record.flags & (SampleFlag.VOLTAGE_CLIPPED | SampleFlag.RAMPED_DOWN))
    if not (is_told or record.fault):
        asked = record.asked()
        yield (
            f"{float(asked.max()):.4g} V were asked for beyond {high:g} V: neither a fault on "
            "drive/progress nor FLAG_VOLTAGE_CLIPPED tells so"
        )

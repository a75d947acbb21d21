"""Checks on drive/progress: what a driver acknowledges, and when."""

from __future__ import annotations

from collections.abc import Iterator

from imotor_ros.campaign.conformance.record import RunRecord
from imotor_ros.campaign.conformance.requirements import Findings
from imotor_ros.contracts.blocks import sample_time
from imotor_ros.contracts.topics import VOLTAGE_MONITOR

OUTPUT_LEAD = 1e-3
"""Time (s) by which an acknowledgement may precede the monitor's block: publish first."""


def check_flow(record: RunRecord, findings: Findings) -> None:
    """
    Check the acknowledgements of a run that was sent to its end.

    Parameters
    ----------
    record : RunRecord
        The run.
    findings : Findings
        Receives what is found.

    """
    count = len(record.progress)
    missing = record.sent - record.consumed
    if not count:
        text = f"never acknowledges: nothing on drive/progress, {record.sent} samples sent"
        findings.fails("F1", text)
    elif missing > 0:
        findings.fails(
            "F1", f"stops acknowledging: {record.consumed} of {record.sent} samples that were sent"
        )
    else:
        findings.passes("F1", f"{record.consumed} samples by {count} acknowledgements")
    findings.judge("F2", _orders(record), f"{count} acknowledgements in order")
    findings.judge("D2", _stamp_defects(record), f"{count} acknowledgements: exact to 1 ns")


def _orders(record: RunRecord) -> Iterator[str]:
    last = 0
    for one in record.progress:
        if one.consumed < last:
            yield f"takes back: {one.consumed} samples after {last}"
            return
        last = one.consumed
    for one in record.progress:
        if one.consumed > one.sent:
            yield (f"acknowledges too early: {one.consumed} samples when only {one.sent} were sent")
            return


def _stamp_defects(record: RunRecord) -> Iterator[str]:
    program = record.program
    for one in record.progress:
        right = sample_time(program.epoch, one.consumed, program.sample_rate)
        if one.stamp != right:
            yield (
                f"drive/progress: stamp {one.stamp} ns for {one.consumed} samples, "
                f"expected {right} ns"
            )
            return


def collects_first(record: RunRecord) -> bool:
    """
    Whether the driver took the whole program before it published any of what it measured.

    It may keep the last sample back until all is done.
    """
    monitor = record.blocks.get(VOLTAGE_MONITOR.name)
    if not monitor:
        return False
    before = [one.consumed for one in record.progress if one.moment < monitor[0].moment]
    return max(before, default=0) >= record.program.length - 1


def check_acknowledged_when_put_out(record: RunRecord, findings: Findings) -> None:
    """
    Check that no acknowledgement precedes the monitor's block for the samples by more than allowed.

    The moments are those of the writers, so it does not matter on which way a message was late. A
    driver that collects the whole program first, because its instruments want it in their memory,
    acknowledges as it collects.

    Parameters
    ----------
    record : RunRecord
        A run that was played to its end.
    findings : Findings
        Receives what is found.

    """
    if collects_first(record):
        findings.skips("S1", "the driver collects the whole program before it plays it")
        return
    monitor = record.blocks.get(VOLTAGE_MONITOR.name, [])
    worst, place, leads = 0, 0, 0
    for one in record.progress:
        out = next((p.moment for p in monitor if p.block.end_index >= one.consumed), None)
        if out is None or one.fault:
            continue
        lead = out - one.moment
        leads += lead > OUTPUT_LEAD * 1e9
        if lead > worst:
            worst, place = lead, one.consumed
    text = f"at most {worst / 1e6:.1f} ms before the monitor's block"
    if leads > 0:
        findings.fails(
            "S1",
            f"acknowledges too early: {leads} of {len(record.progress)} acknowledgements come "
            f"before the monitor's block, that of sample {place} by {worst / 1e6:.1f} ms "
            f"(allowed {OUTPUT_LEAD * 1e3:g} ms)",
        )
    else:
        findings.passes("S1", text)

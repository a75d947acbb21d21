"""What a bag holds, in a few lines or as plain JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from imotor_ros.bag.reader import RunBag
from imotor_ros.contracts.blocks import NANOSECONDS
from imotor_ros.contracts.topics import DRIVE_PROGRAM
from imotor_ros.core.channel import SampleFlag


@dataclass(frozen=True)
class RunDescription:
    """
    A recorded run.

    Attributes
    ----------
    path : str
        The bag.
    run_id : str
        Name of the run.
    end_state : str
        How it ended; "unfinished" for a bag that was not closed.
    damage : str
        What is wrong with the file; empty if nothing.
    is_simulated : bool
        Whether log times follow the sample index.
    size : int
        Size of the file (bytes).
    start : str
        Log time of the first message (UTC, ISO 8601); empty if there is none.
    duration : float
        Time from the first to the last message (s).
    program : mapping or None
        Segments, length, rate (Hz) and fundamental frequency (Hz) of the last drive program.
    messages : mapping
        Messages by topic.
    streams : mapping
        By stream: samples received and lost, flags by name, blocks rejected, sample rate (Hz).
    channels : mapping
        By channel: its description.
    run_info, run_info_digest : mapping and str
        All that is needed to repeat the run, and its SHA-256.
    provenance : mapping
        Versions, host and start.
    result : mapping or None
        What came out.

    """

    path: str
    run_id: str
    end_state: str
    damage: str
    is_simulated: bool
    size: int
    start: str
    duration: float
    program: Mapping[str, Any] | None
    messages: Mapping[str, int]
    streams: Mapping[str, Mapping[str, Any]]
    channels: Mapping[str, Mapping[str, Any]]
    run_info: Mapping[str, Any]
    run_info_digest: str
    provenance: Mapping[str, Any]
    result: Mapping[str, Any] | None = field(default=None)

    def to_mapping(self) -> dict[str, Any]:
        """Return the description as plain JSON."""
        return asdict(self)

    def __str__(self) -> str:
        lines = [
            f"{self.path}: run {self.run_id}, {self.end_state}",
            f"  {self.duration:g} s from {self.start}, {self.size / 1e6:.1f} MB",
        ]
        if self.damage:
            lines.append(f"  damaged: {self.damage}")
        lines += [_stream_line(name, stream) for name, stream in self.streams.items()]
        others = {n: count for n, count in self.messages.items() if n not in self.streams}
        lines += [f"  {name}: {count} messages" for name, count in others.items()]
        versions = [f"{k} {v}" for k, v in self.provenance.get("versions", {}).items() if v]
        if versions:
            lines.append("  made with " + ", ".join(versions))
        return "\n".join(lines)


def describe(path: Path | str) -> RunDescription:
    """
    Describe a bag, also one that was not closed.

    Raises
    ------
    UnreadableFileError
        If there is no bag, or it is not that of a run.

    """
    with RunBag(path, allow_damaged=True) as bag:
        counts = bag.message_counts
        first, last = bag.times
        return RunDescription(
            path=str(path),
            run_id=bag.run_id,
            end_state=bag.end_state,
            damage=bag.damage,
            is_simulated=bag.facts.is_simulated,
            size=bag.file.stat().st_size,
            start=_iso(first) if any(counts.values()) else "",
            duration=(last - first) / NANOSECONDS,
            program=_program(bag) if counts.get(DRIVE_PROGRAM.name) else None,
            messages=counts,
            streams={name: _stream(dict(s)) for name, s in bag.stream_counts.items()},
            channels={name: asdict(channel) for name, channel in bag.channels.items()},
            run_info=bag.run_info,
            run_info_digest=bag.facts.run_info_digest,
            provenance=bag.facts.provenance,
            result=bag.result,
        )


def _program(bag: RunBag) -> dict[str, Any]:
    program = bag.program
    return {
        "segments": [{"label": s.label, "length": s.length} for s in program.segments],
        "length": program.length,
        "sample_rate": program.sample_rate,
        "fundamental_frequency": program.fundamental_frequency,
        "harmonics": len(program.motion_amplitudes),
    }


def _stream(counts: dict[str, Any]) -> dict[str, Any]:
    raised = SampleFlag(int(counts["flags"]))
    counts["flags"] = [flag.name for flag in SampleFlag if flag in raised]
    return counts


def _stream_line(name: str, stream: Mapping[str, Any]) -> str:
    line = f"  {name}: {stream['received']} samples at {stream['sample_rate']:g} Hz"
    line += f", {stream['lost']} lost"
    if stream["flags"]:
        line += ", " + " ".join(stream["flags"])
    return line


def _iso(time: int) -> str:
    moment = datetime.fromtimestamp(time // NANOSECONDS, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{time % NANOSECONDS:09d}Z"

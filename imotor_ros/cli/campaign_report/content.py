"""What a report shows: the results, and waveforms and provenance from the bags."""

from __future__ import annotations

import json
import os
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.results import RESULTS_NAME
from imotor_ros.campaign.workers import Finished, work_in_processes
from imotor_ros.core import channel
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.indicators import FREE_RUN
from imotor_ros.errors import ImotorError, UnreadableFileError

Array = NDArray[np.float64]

PERIODS_SHOWN = 4
_BINS = 300
_MOST_SAMPLES = 1000
_DIGITS = 5
_BAGS_PER_JOB = 4

OVER_RUN = (
    (channel.SLIDER_VELOCITY, "slider velocity", "m/s"),
    (channel.LOAD_FORCE, "load force", "N"),
    (channel.VOLTAGE, "voltage", "V"),
    (channel.CURRENT, "current", "A"),
)
"""What is shown over the whole run: channel, title, unit."""


@dataclass(frozen=True)
class Waveforms:
    """
    What a bag holds, thinned out for pictures.

    Attributes
    ----------
    periods : dict
        "time" (ms), "rod" and "slider" (m/s) over some periods, and "start" (ms) of the first.
    run : dict
        By channel: "time" (ms), and "low", "high", "mean" of each short stretch.
    end_state : str
        How the run ended.
    provenance : mapping
        Versions, revision, host, start.
    problem : str
        Why there is nothing; empty otherwise.

    """

    periods: Mapping[str, Any] = field(default_factory=dict)
    run: Mapping[str, Any] = field(default_factory=dict)
    end_state: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    problem: str = ""


@dataclass(frozen=True)
class ReportContent:
    """Content of results.json, and waveforms by name of the point."""

    results: Mapping[str, Any]
    waveforms: Mapping[str, Waveforms]


def collect(output: Path) -> ReportContent:
    """
    Read results and bags of a campaign; see `write_report`.

    Raises
    ------
    UnreadableFileError
        If there are no results.

    """
    path = output / RESULTS_NAME
    try:
        results = json.loads(path.read_text(encoding="utf-8"))
        bags = {point["name"]: output / point["bag"] for point in results["points"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UnreadableFileError(f"cannot be read: {error}", where=str(path)) from error
    return ReportContent(results, _read_all(bags))


@dataclass(frozen=True)
class _Reading:
    """A bag to be read in another process."""

    number: int
    name: str
    path: Path

    def carry_out(self) -> Generator[None, None, Waveforms]:
        yield from ()
        return read_waveforms(self.path)


def _read_all(bags: Mapping[str, Path]) -> dict[str, Waveforms]:
    """Read bags, in several processes where there are enough of them; return them in order."""
    readings = [_Reading(number, name, path) for number, (name, path) in enumerate(bags.items())]
    queue = iter(readings)
    jobs = min(len(os.sched_getaffinity(0)), len(readings) // _BAGS_PER_JOB)
    if jobs < 2:
        return {one.name: read_waveforms(one.path) for one in readings}
    found: dict[str, Waveforms] = {}
    for step in work_in_processes(lambda: next(queue, None), jobs):
        if isinstance(step, Finished):
            problem = Waveforms(problem=step.death)
            found[step.task.name] = problem if step.death else step.result
    return {name: found[name] for name in bags}


def read_waveforms(path: Path) -> Waveforms:
    """Return what is to be shown of a bag, or why it cannot be."""
    try:
        with RunBag(path, allow_damaged=True) as bag:
            program = bag.program
            labels = [segment.label for segment in program.segments]
            if "hold" not in labels:
                found = bag.facts.provenance or {}
                return Waveforms({}, {}, bag.end_state, found, _no_hold(labels))
            signals = _samples(bag, program.length)
            window = None if bag.damage else bag.performance.window(FREE_RUN)
            first = window.start if window else program.span("hold")[0]
            return Waveforms(
                _over_periods(signals, program, first),
                {
                    name: _over_run(signals[name], program)
                    for name, _, _ in OVER_RUN
                    if name in signals
                },
                bag.end_state,
                bag.facts.provenance or {},
            )
    except ImotorError as error:
        return Waveforms(problem=str(error))


def _no_hold(labels: Sequence[str]) -> str:
    """Return why nothing is shown of a run with these segments."""
    more = "; see identify-friction BAG" if "step 1" in labels else ""
    return f"the run has no steady drive{more}"


def _samples(bag: RunBag, length: int) -> dict[str, Array]:
    """Return the measured streams in one pass; what is missing is NaN."""
    names = [name for name in channel.MEASURED_CHANNELS if name in bag.topics]
    signals = {name: np.full(length, np.nan) for name in names}
    for block in bag.blocks(*names) if names else ():
        part = signals[block.stream][block.first_index : block.end_index]
        part[:] = block.samples[: part.size]
    return signals


def _over_periods(signals: Mapping[str, Array], program: DriveProgram, first: int) -> Any:
    rate = program.sample_rate
    count = round(PERIODS_SHOWN * rate / program.fundamental_frequency)
    step = max(1, -(-count // _MOST_SAMPLES))
    rows = slice(first, first + count, step)
    shown = {
        key: rounded(signals[name][rows])
        for key, name in (("rod", channel.ROD_VELOCITY), ("slider", channel.SLIDER_VELOCITY))
        if name in signals
    }
    time = np.arange(program.length)[rows] / rate * 1e3
    return {**shown, "time": rounded(time - first / rate * 1e3), "start": first / rate * 1e3}


def _over_run(samples: Array, program: DriveProgram) -> dict[str, list[float | None]]:
    """Return the range of short stretches, and the mean over a drive period about their middle."""
    rate = program.sample_rate
    width = max(1, round(rate / program.fundamental_frequency))
    # less than a period would beat with the drive
    size = min(max(width, samples.size // _BINS), samples.size)
    cut = samples[: samples.size // size * size].reshape(-1, size)
    sums = np.concatenate([[0.0], np.cumsum(samples)])
    middle = np.arange(len(cut)) * size + size // 2
    begin = np.clip(middle - width // 2, 0, None)
    end = np.clip(begin + width, None, samples.size)
    return {
        "time": rounded((np.arange(len(cut)) + 0.5) * size / rate * 1e3),
        "low": rounded(cut.min(axis=1)),
        "high": rounded(cut.max(axis=1)),
        "mean": rounded((sums[end] - sums[begin]) / (end - begin)),
    }


def rounded(values: ArrayLike) -> list[float | None]:
    """Return numbers with as many digits as a picture shows; None for NaN."""
    return [float(f"{v:.{_DIGITS}g}") if np.isfinite(v) else None for v in np.asarray(values)]

"""
The runner: carries out a campaign on a bench, as a generator of events.

Progress bar, table and files are listeners of these events; the runner itself writes only
``results.json``, after every point, so that an interrupted campaign can be resumed.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from imotor_ros.campaign.bench import Bench, PerformanceReported, RunEvent
from imotor_ros.campaign.campaign import Campaign, NamedPoint
from imotor_ros.campaign.conclusions import MeasuredPoint, draw_conclusions
from imotor_ros.campaign.excite import excite_run
from imotor_ros.campaign.plan import RunPlan, plan_run, run_id_of
from imotor_ros.campaign.predictions import predict_point
from imotor_ros.core.indicators import Performance
from imotor_ros.errors import (
    BadInputError,
    DriveLimitError,
    ImotorError,
    RecordingError,
    RunError,
    UnreadableFileError,
)

RESULTS_NAME = "results.json"

DONE = "done"
FAILED = "failed"


@dataclass(frozen=True)
class PointResult:
    """
    What came of one point.

    Attributes
    ----------
    name, run_id : str
        Name of the point and id of its run.
    status : str
        "done" or "failed".
    error : str
        Why it failed; empty otherwise.
    performance : Performance or None
        The final indicators; None where it failed.
    predictions : mapping
        What each model predicts, by model and indicator; a value is a number or None.
    bag : str
        Path of the bag, relative to the results.
    seconds : float
        How long it took.

    """

    name: str
    run_id: str
    status: str
    error: str
    performance: Performance | None
    predictions: Mapping[str, Mapping[str, Any]]
    bag: str
    seconds: float

    def to_mapping(self) -> dict[str, Any]:
        """Return the result as plain JSON; what differs from run to run is left out."""
        return {
            "name": self.name,
            "run_id": self.run_id,
            "status": self.status,
            "error": self.error,
            "bag": self.bag,
            "performance": None if self.performance is None else self.performance.to_mapping(),
            "predictions": {model: dict(values) for model, values in self.predictions.items()},
        }


@dataclass(frozen=True)
class CampaignStarted:
    """The campaign begins: how many points there are, and how many were done before."""

    campaign: Campaign
    output: Path
    done_before: int


@dataclass(frozen=True)
class PointStarted:
    """A point begins."""

    number: int
    plan: RunPlan


@dataclass(frozen=True)
class PointFinished:
    """A point has ended, well or not."""

    number: int
    plan: RunPlan
    result: PointResult


@dataclass(frozen=True)
class CampaignFinished:
    """All points have ended."""

    results: tuple[PointResult, ...]
    results_path: Path


CampaignEvent = CampaignStarted | PointStarted | RunEvent | PointFinished | CampaignFinished


def run_campaign(
    campaign: Campaign,
    bench: Bench,
    output: Path,
    *,
    resume: bool = False,
    provenance: Callable[[], Mapping[str, Any]] = dict,
) -> Generator[CampaignEvent, None, None]:
    """
    Carry out a campaign and yield what happens.

    A point that fails is reported, and the others go on.

    Parameters
    ----------
    campaign : Campaign
        What to measure.
    bench : Bench
        Where; it must have been entered.
    output : Path
        Folder for bags and results.
    resume : bool
        Whether to leave out points that `output` already has a result of.
    provenance : callable
        Returns the provenance of a run that starts now.

    Raises
    ------
    BadInputError
        If a point cannot be planned, or `output` cannot be made or holds results of another
        campaign.
    RecordingError
        If the results cannot be written.

    """
    plans = [_plan(point, output) for point in campaign.points]
    results = _results_so_far(campaign, output) if resume else {}
    yield CampaignStarted(campaign, output, len(results))
    _make_folder(output)
    for number, plan in enumerate(plans):
        if plan.program.run_id in results:
            continue
        fresh = replace(plan, provenance=provenance())
        yield PointStarted(number, fresh)
        result = yield from _run_point(fresh, bench, output)
        results[plan.program.run_id] = result
        _write_results(campaign, bench, results, output)
        yield PointFinished(number, fresh, result)
    in_order = tuple(results[plan.program.run_id] for plan in plans)
    yield CampaignFinished(in_order, output / RESULTS_NAME)


def _make_folder(output: Path) -> None:
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = f"cannot be made: {error.strerror or error}"
        raise BadInputError(what, where=str(output), bound="a folder for results") from error


def _plan(point: NamedPoint, output: Path) -> RunPlan:
    try:
        return plan_run(point, output / point.name)
    except BadInputError as error:
        raise BadInputError(
            error.what,
            where=f"point {point.name}: {error.where}",
            value=error.value,
            bound=error.bound,
        ) from error


def _run_point(
    plan: RunPlan, bench: Bench, output: Path
) -> Generator[CampaignEvent, None, PointResult]:
    begin = time.monotonic()
    performance: Performance | None = None
    error = ""
    try:
        plan = yield from excite_run(plan, bench)
        if not plan.driver.is_virtual:
            # samples of the real world have the time of the real world
            plan = replace(plan, program=replace(plan.program, epoch=time.time_ns()))
        for event in bench.run(plan):
            if isinstance(event, PerformanceReported) and event.performance.is_final:
                performance = event.performance
            yield event
        if performance is None:
            raise RunError("the run ended without final indicators")
    except DriveLimitError as caught:
        error = str(caught)
    except BadInputError:  # what concerns the bench concerns all points
        raise
    except ImotorError as caught:
        error = str(caught)
    return PointResult(
        name=plan.name,
        run_id=plan.program.run_id,
        status=FAILED if error else DONE,
        error=error,
        performance=performance if not error else None,
        predictions=predict_point(plan.parameters),
        bag=os.path.relpath(plan.bag_path, output),
        seconds=time.monotonic() - begin,
    )


def _write_results(
    campaign: Campaign, bench: Bench, results: Mapping[str, PointResult], output: Path
) -> None:
    order = [run_id_of(point) for point in campaign.points]
    content = {
        "campaign": campaign.to_mapping(),
        "bench": bench.name,
        "points": [results[key].to_mapping() for key in order if key in results],
        "conclusions": [
            one.to_mapping() for one in draw_conclusions(_measured_points(campaign, results))
        ],
    }
    text = json.dumps(content, indent=1, allow_nan=False)
    path, temporary = output / RESULTS_NAME, output / f".{RESULTS_NAME}.new"
    try:
        temporary.write_text(text + "\n", encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        cause = error.strerror or str(error)
        raise RecordingError(f"{path}: cannot be written: {cause}") from error


def _measured_points(campaign: Campaign, results: Mapping[str, PointResult]) -> list[MeasuredPoint]:
    found = []
    for point in campaign.points:
        result = results.get(run_id_of(point))
        if result is not None and result.performance is not None:
            found.append(
                MeasuredPoint(point.name, point.parameters, result.performance, result.predictions)
            )
    return found


def _results_so_far(campaign: Campaign, output: Path) -> dict[str, PointResult]:
    """Read the points that are done; failed ones are run again."""
    path = output / RESULTS_NAME
    if not path.exists():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        points = [_result_from_mapping(one) for one in content["points"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UnreadableFileError(f"does not parse: {error}", where=str(path)) from error
    known = {run_id_of(point) for point in campaign.points}
    foreign = [point.name for point in points if point.run_id not in known]
    if foreign:
        raise BadInputError(
            "holds points of another campaign, or of other parameters",
            where=str(path),
            value=foreign[0],
            bound="an output folder of this campaign",
        )
    return {
        point.run_id: point
        for point in points
        if point.status == DONE and (output / point.bag).exists()
    }


def _result_from_mapping(mapping: Mapping[str, Any]) -> PointResult:
    performance = mapping["performance"]
    return PointResult(
        name=mapping["name"],
        run_id=mapping["run_id"],
        status=mapping["status"],
        error=mapping["error"],
        performance=None if performance is None else Performance.from_mapping(performance),
        predictions=mapping["predictions"],
        bag=mapping["bag"],
        seconds=0.0,
    )

"""
The runner: carries out a campaign on a bench, as a generator of events.

Progress bar, table and files are listeners of these events; the runner itself writes only
``results.json``, after every run, so that an interrupted campaign can be resumed. What it holds
depends neither on interruptions nor on the number of processes.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from imotor_ros.campaign.bench import Bench, RunEvent
from imotor_ros.campaign.campaign import Campaign, NamedPoint
from imotor_ros.campaign.forecast import check_space
from imotor_ros.campaign.own_friction import identification_points
from imotor_ros.campaign.plan import RunPlan, plan_run
from imotor_ros.campaign.predictions import MODELS
from imotor_ros.campaign.results import (
    DONE,
    FAILED,
    RESULTS_NAME,
    FrictionResult,
    PointResult,
    Results,
    RunResult,
)
from imotor_ros.campaign.tasks import IdentificationTask, Outcome, PredictionTask, RunTask
from imotor_ros.campaign.workers import Advanced, Finished, Task, work_here, work_in_processes
from imotor_ros.errors import BadInputError

__all__ = [
    "DONE", "FAILED", "RESULTS_NAME", "CampaignEvent", "CampaignFinished", "CampaignStarted",
    "PointFinished", "PointResult", "PointStarted", "RunAdvanced", "run_campaign",
]  # fmt: skip


@dataclass(frozen=True)
class CampaignStarted:
    """The campaign begins: how many runs there are, and how many were done before."""

    campaign: Campaign
    output: Path
    done_before: int
    runs: int


@dataclass(frozen=True)
class PointStarted:
    """A run begins: its number, identification runs first."""

    number: int
    plan: RunPlan


@dataclass(frozen=True)
class RunAdvanced:
    """A run says what happens."""

    number: int
    plan: RunPlan
    event: RunEvent


@dataclass(frozen=True)
class PointFinished:
    """
    A run has ended, well or not.

    Predictions are missing where the friction of the models is still being identified.
    """

    number: int
    plan: RunPlan
    result: RunResult


@dataclass(frozen=True)
class CampaignFinished:
    """All runs have ended: the points in the campaign's order, and identification runs."""

    results: tuple[PointResult, ...]
    results_path: Path
    identifications: tuple[FrictionResult, ...] = ()


CampaignEvent = CampaignStarted | PointStarted | RunAdvanced | PointFinished | CampaignFinished


def run_campaign(
    campaign: Campaign,
    bench: Bench,
    output: Path,
    *,
    resume: bool = False,
    provenance: Callable[[], Mapping[str, Any]] = dict,
    jobs: int = 1,
) -> Generator[CampaignEvent, None, None]:
    """
    Carry out a campaign and yield what happens.

    A run that fails is reported, and the others go on.

    Parameters
    ----------
    campaign : Campaign
        What to measure.
    bench : Bench
        Where; it must have been entered.
    output : Path
        Folder for bags and results.
    resume : bool
        Whether to leave out runs that `output` already has a result of.
    provenance : callable
        Returns the provenance of a run that starts now.
    jobs : int
        How many runs at a time, each in a process of its own with a copy of the bench; only for
        a bench that needs no entering. The results are the same.

    Raises
    ------
    BadInputError
        If a point cannot be planned, or `output` cannot be made or holds results of another
        campaign.
    RecordingError
        If the results cannot be written, or the bags would not find room.

    """
    todo = _ToDo(campaign, bench, output, provenance)
    if resume:
        todo.results.read(output, todo.friction_ids)
    runs, done = todo.counts()
    yield CampaignStarted(campaign, output, done, runs)
    _make_folder(output)
    check_space(todo.open_samples(), output)
    jobs = min(jobs, runs - done)
    work = work_in_processes(todo.next_task, jobs) if jobs > 1 else work_here(todo.next_task)
    try:
        for step in work:
            yield from todo.starts()
            match step:
                case Advanced(task, event):
                    yield RunAdvanced(task.number, task.plan, event)
                case Finished(PredictionTask() as task, result, death):
                    todo.predicted(task, result, death)
                case Finished(task, result, death):
                    yield PointFinished(task.number, task.plan, todo.ended(task, result, death))
    finally:
        work.close()
    friction = tuple(todo.results.friction.values())
    yield CampaignFinished(todo.results.in_order(), output / RESULTS_NAME, friction)


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


@dataclass(frozen=True)
class _Identification:
    """An identification run: its number, its plan, and the points it is for."""

    number: int
    plan: RunPlan
    points: tuple[str, ...]


@dataclass
class _ToDo:
    """What of a campaign is done, and what comes next."""

    campaign: Campaign
    bench: Bench
    output: Path
    provenance: Callable[[], Mapping[str, Any]]
    _started: list[PointStarted] = field(default_factory=list)

    def __post_init__(self) -> None:
        runs = identification_points(self.campaign)
        self._friction = [
            _Identification(number, _plan(run, self.output), points)
            for number, (run, points) in enumerate(runs)
        ]
        points = (_plan(point, self.output) for point in self.campaign.points)
        self._plans = list(enumerate(points, len(runs)))
        self.results = Results(self.campaign, self.bench.name, MODELS)
        self._queue: deque[_Identification | tuple[int, RunPlan]] | None = None
        self._asked: set[str] = set()

    @property
    def friction_ids(self) -> list[str]:
        """Run ids of the identification runs."""
        return [one.plan.program.run_id for one in self._friction]

    def counts(self) -> tuple[int, int]:
        """Return the number of runs, and how many are done."""
        done = len(self.results.friction) + len(self.results.points)
        return len(self._friction) + len(self._plans), done

    def open_samples(self) -> int:
        """Return the number of samples in time of all runs that are not done."""
        runs = (
            run.plan if isinstance(run, _Identification) else run[1] for run in self._open_runs()
        )
        return sum(plan.program.length for plan in runs)

    def starts(self) -> Generator[CampaignEvent, None, None]:
        """Yield the runs that have been begun since."""
        while self._started:
            yield self._started.pop(0)

    def next_task(self) -> Task | None:
        """Return what is to be done next, None if there is nothing at present."""
        if self._queue is None:
            self._queue = self._open_runs()
        if self._queue:
            return self._begun(self._queue.popleft())
        for number, plan in self._plans:
            run_id = plan.program.run_id
            result = self.results.points.get(run_id)
            laws = self.results.laws_for(plan.name)
            if result is None or result.predictions or not laws or run_id in self._asked:
                continue
            if result.status == DONE:
                self._asked.add(run_id)
                return PredictionTask(number, plan, laws)
        return None

    def _open_runs(self) -> deque[_Identification | tuple[int, RunPlan]]:
        done = self.results
        friction = [o for o in self._friction if o.plan.program.run_id not in done.friction]
        return deque(
            [*friction, *((n, p) for n, p in self._plans if p.program.run_id not in done.points)]
        )

    def _begun(self, run: _Identification | tuple[int, RunPlan]) -> Task:
        number, plan = (run.number, run.plan) if isinstance(run, _Identification) else run
        fresh = replace(plan, provenance=self.provenance())
        self._started.append(PointStarted(number, fresh))
        if isinstance(run, _Identification):
            return IdentificationTask(number, fresh, self.bench)
        return RunTask(number, fresh, self.bench, self.results.laws_for(plan.name))

    def predicted(self, task: PredictionTask, outcome: Outcome | None, death: str) -> None:
        """Take in what the models predict."""
        if outcome is not None and not death:
            self.results.add_predictions(task.plan.program.run_id, outcome.predictions)
            self.results.write(self.output)

    def ended(
        self, task: RunTask | IdentificationTask, outcome: Outcome | None, death: str
    ) -> RunResult:
        """Take in what came of a run."""
        outcome = outcome or Outcome(error=death)
        plan = task.plan
        run_id, error = plan.program.run_id, outcome.error
        status, bag = FAILED if error else DONE, os.path.relpath(plan.bag_path, self.output)
        result: RunResult
        if isinstance(task, IdentificationTask):
            points = next(one.points for one in self._friction if one.number == task.number)
            result = self.results.friction[run_id] = FrictionResult(
                plan.name, run_id, status, error, bag, outcome.seconds, points, outcome.identified
            )
        else:
            result = self.results.points[run_id] = PointResult(
                plan.name, run_id, status, error, outcome.performance, outcome.predictions, bag,
                outcome.seconds,
            )  # fmt: skip
        self.results.write(self.output)
        return result

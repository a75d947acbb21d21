"""What the runner of a campaign has to do: runs on the bench, and what the models predict."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from imotor_ros.campaign.bench import Bench, PerformanceReported, PhaseEntered, RunEvent
from imotor_ros.campaign.excite import excite_run
from imotor_ros.campaign.own_friction import identify_models
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.campaign.predictions import predict_point
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.indicators import Performance
from imotor_ros.errors import BadInputError, DriveLimitError, ImotorError, RunError, StoppedError


@dataclass(frozen=True)
class Outcome:
    """
    What came of a task.

    Attributes
    ----------
    error : str
        Why it failed; empty otherwise.
    seconds : float
        How long it took.
    performance : Performance or None
        Final indicators of a run.
    predictions : mapping
        Of the models, where their laws were known.
    identified : mapping
        Friction laws, see `identify_models`.

    """

    error: str = ""
    seconds: float = 0.0
    performance: Performance | None = None
    predictions: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    identified: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RunTask:
    """
    A run on the bench, and then what the models predict for it.

    Attributes
    ----------
    number : int
        Its number in the campaign.
    plan : RunPlan
        The run.
    bench : Bench
        Where; it must have been entered, or need no entering.
    laws : mapping
        Friction laws of the models; none where they are not known yet.

    """

    number: int
    plan: RunPlan
    bench: Bench
    laws: Mapping[str, FrictionLaw]

    def carry_out(self) -> Generator[RunEvent, None, Outcome]:
        """Carry out the run; a failure is an outcome, unless it concerns all runs."""
        begin = time.monotonic()
        performance, error = yield from measure_run(self.plan, self.bench)
        predictions = predict_point(self.plan.parameters, self.laws) if self.laws else {}
        seconds = time.monotonic() - begin
        return Outcome(error, seconds, None if error else performance, predictions)


@dataclass(frozen=True)
class IdentificationTask:
    """A run that friction is identified from; attributes as of `RunTask`."""

    number: int
    plan: RunPlan
    bench: Bench

    def carry_out(self) -> Generator[RunEvent, None, Outcome]:
        """Carry out the run and evaluate it."""
        begin = time.monotonic()
        _, error = yield from measure_run(self.plan, self.bench)
        identified: Mapping[str, Any] = {}
        if not error:
            yield PhaseEntered("evaluation")
            try:
                identified = identify_models(self.plan.bag_path)
            except ImotorError as caught:
                error = str(caught)
        return Outcome(error, time.monotonic() - begin, identified=identified)


@dataclass(frozen=True)
class PredictionTask:
    """What the models predict for a run that was done before their laws were known."""

    number: int
    plan: RunPlan
    laws: Mapping[str, FrictionLaw]

    def carry_out(self) -> Generator[RunEvent, None, Outcome]:
        """Predict."""
        yield PhaseEntered("models")
        return Outcome(predictions=predict_point(self.plan.parameters, self.laws))


def measure_run(
    plan: RunPlan, bench: Bench
) -> Generator[RunEvent, None, tuple[Performance | None, str]]:
    """
    Carry out a run, yield what happens, and return its final indicators and why it failed.

    Raises
    ------
    BadInputError
        If the bench cannot carry out any run.
    StoppedError
        If an operator stopped the drive.

    """
    performance: Performance | None = None
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
        return None, str(caught)
    except (BadInputError, StoppedError):  # what concerns the bench concerns all points
        raise
    except ImotorError as caught:
        return None, str(caught)
    return performance, ""

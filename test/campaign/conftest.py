"""A bench that needs no time, and campaigns for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any, Self

import pytest

from imotor_ros.campaign import tasks
from imotor_ros.campaign.bench import (
    DriveAdvanced,
    ExcitationAdvanced,
    PerformanceReported,
    PhaseEntered,
    RunEvent,
)
from imotor_ros.campaign.campaign import Campaign, campaign_from_mapping
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.core.correction import Excitation, ExcitationRequest
from imotor_ros.core.indicators import Indicator, Performance, StreamCount


class InstantBench:
    """
    Makes the folder of a bag and reports a velocity that depends on the seed.

    Points whose name is in `failures` raise what stands there, those in `refusals` before.
    """

    name = "instant"

    def __init__(self, failures: dict[str, BaseException] | None = None) -> None:
        self.failures = failures or {}
        self.refusals: dict[str, BaseException] = {}
        self.carried_out: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def excite(
        self, plan: RunPlan, request: ExcitationRequest
    ) -> Generator[RunEvent, None, Excitation]:
        """Find that the voltage of the plan is right; `refusals` may hold another opinion."""
        yield ExcitationAdvanced("linear model", math.nan, math.nan)
        if plan.name in self.refusals:
            raise self.refusals[plan.name]
        hold = next(one for one in plan.program.segments if one.label == "hold")
        count = len(hold.phases)
        tone, nothing = (hold.end_amplitudes, hold.phases), (0.0,) * count
        motion = request.motion
        return Excitation(
            motion.fundamental_frequency, motion.amplitudes, motion.phases, *tone, *tone, *tone,
            nothing, nothing, nothing, (), 0, (0.0,), (0.0,),
        )  # fmt: skip

    def run(self, plan: RunPlan) -> Iterator[RunEvent]:
        self.carried_out.append(plan.name)
        plan.bag_path.mkdir(parents=True, exist_ok=True)
        yield PhaseEntered("run")
        yield DriveAdvanced(plan.program.length // 2, plan.program.length)
        yield PerformanceReported(performance_of(plan, is_final=False))
        if plan.name in self.failures:
            raise self.failures[plan.name]
        yield PerformanceReported(performance_of(plan, is_final=True))


def performance_of(plan: RunPlan, *, is_final: bool) -> Performance:
    """Return made-up indicators: a velocity of 1 mm/s times the seed."""
    velocity = Indicator("mean_velocity", "m/s", 1e-3 * plan.parameters.seed, 1e-6)
    force = Indicator("force", "N", reason="no stop")
    streams = (StreamCount("rod/velocity", plan.program.length, 0),)
    return Performance(
        plan.program.run_id, is_final, (velocity, force), streams, plan.program.length
    )


@pytest.fixture
def instant_bench() -> type[InstantBench]:
    """Return the class `InstantBench`."""
    return InstantBench


@pytest.fixture
def make_campaign() -> Callable[..., Campaign]:
    """Return a function that makes a campaign of short points with so many seeds."""

    def make(count: int = 3, **point: Any) -> Campaign:
        seeds = list(range(1, count + 1))
        leaves = {"drive.hold_time": 0.01, **point}
        return campaign_from_mapping({"name": "c", "point": leaves, "sweep": {"seed": seeds}})

    return make


@pytest.fixture
def quick_predictions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare the models, which take a tenth of a second for each point."""
    monkeypatch.setattr(tasks, "predict_point", lambda *_: {"model_1": {"mean_velocity": 0.1}})


@pytest.fixture
def output(tmp_path: Path) -> Path:
    """Return a folder for results, which does not exist yet."""
    return tmp_path / "deep" / "out"

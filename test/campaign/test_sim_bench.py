"""Whole runs in one process, short ones: from campaign to bag and results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.bench import DriveAdvanced, PerformanceReported, PhaseEntered
from imotor_ros.campaign.campaign import Campaign, NamedPoint, campaign_from_mapping
from imotor_ros.campaign.plan import RunPlan, plan_run
from imotor_ros.campaign.point import PointParameters
from imotor_ros.campaign.runner import CampaignFinished, run_campaign
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.contracts import topics
from imotor_ros.contracts.graph import VIRTUAL_STAND
from imotor_ros.core.indicators import UNITS

SHORT = {
    "drive.hold_time": 0.03,
    "stand.motor.load.upper_stop": 1e-3,
    "evaluator.guard_periods": 3,
    "report_interval": 0.01,
}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunPlan, list[Any]]:
    """Carry out one short run; return its plan and its events."""
    point = NamedPoint("p", PointParameters.from_leaves(SHORT))
    plan = plan_run(point, tmp_path_factory.mktemp("sim") / "p", {"host": "here"})
    with SimBench() as bench:
        return plan, list(bench.run(plan))


def test_run_ends_with_final_indicators_and_nothing_lost(done: tuple[RunPlan, list[Any]]) -> None:
    plan, events = done
    assert isinstance(events[0], PhaseEntered)
    reports = [e.performance for e in events if isinstance(e, PerformanceReported)]
    assert [one.is_final for one in reports] == [False] * (len(reports) - 1) + [True]
    final = reports[-1]
    assert [one.name for one in final.indicators] == list(UNITS)
    assert 0.01 < final.indicator("mean_velocity").value < 0.2
    assert {s.name: (s.received, s.lost) for s in final.streams} == {
        topic.name: (plan.program.length, 0) for topic in topics.MEASURED_TOPICS
    }


def test_provisional_reports_come_at_the_interval(done: tuple[RunPlan, list[Any]]) -> None:
    plan, events = done
    reports = [e.performance for e in events if isinstance(e, PerformanceReported)]
    step = round(0.01 * plan.program.sample_rate)
    assert [one.end_index for one in reports[:-1]] == list(range(step, plan.program.length, step))
    assert reports[-1].end_index == plan.program.length


def test_drive_advances_to_the_end(done: tuple[RunPlan, list[Any]]) -> None:
    plan, events = done
    consumed = [e.consumed for e in events if isinstance(e, DriveAdvanced)]
    assert consumed == sorted(consumed)
    assert consumed[-1] == plan.program.length


def test_bag_holds_every_stream_whole_and_the_run_info(done: tuple[RunPlan, list[Any]]) -> None:
    plan, events = done
    with RunBag(plan.bag_path) as bag:
        assert bag.end_state == "completed"
        assert bag.run_info == plan.run_info
        assert bag.program == plan.program
        streams = [t for role in VIRTUAL_STAND for t in role.publishes if topics.is_sampled(t)]
        for topic in streams:
            samples, _, first = bag.samples(topic.name)
            assert (len(samples), first) == (plan.program.length, 0), topic
        voltage, _, _ = bag.samples("drive/voltage")
        assert voltage.tobytes() == plan.program.render(0, plan.program.length).tobytes()
        reported = [e.performance for e in events if isinstance(e, PerformanceReported)]
        assert repr(bag.performance) == repr(reported[-1])


def test_run_that_is_stopped_leaves_a_readable_bag(tmp_path: Path) -> None:
    plan = plan_run(NamedPoint("p", PointParameters.from_leaves(SHORT)), tmp_path / "p")
    events = SimBench().run(plan)
    next(e for e in events if isinstance(e, DriveAdvanced) and e.consumed >= 20_000)
    events.close()  # type: ignore[attr-defined]
    with RunBag(plan.bag_path) as bag:
        assert bag.end_state.startswith("aborted")
        samples, _, _ = bag.samples("rod/velocity")
        assert len(samples) >= 10_000


def test_second_run_replaces_the_bag_of_the_first(tmp_path: Path) -> None:
    plan = plan_run(NamedPoint("p", PointParameters.from_leaves(SHORT)), tmp_path / "p")
    SimBench().run(plan).__next__()
    list(SimBench().run(plan))
    with RunBag(plan.bag_path) as bag:
        assert bag.end_state == "completed"


def test_blocks_make_no_difference(done: tuple[RunPlan, list[Any]], tmp_path: Path) -> None:
    """The same run in blocks of 777 has the same indicators to the last bit."""
    _, events = done
    leaves = {**SHORT, "stand.block_length": 777}
    plan = plan_run(NamedPoint("p", PointParameters.from_leaves(leaves)), tmp_path / "p")
    other = [e.performance for e in SimBench().run(plan) if isinstance(e, PerformanceReported)]
    first = [e.performance for e in events if isinstance(e, PerformanceReported)]
    assert [repr(p.indicators) for p in other] == [repr(p.indicators) for p in first]


def short_campaign() -> Campaign:
    """Return two short points."""
    return campaign_from_mapping({"name": "short", "point": SHORT, "sweep": {"seed": [1, 2]}})


def test_campaign_end_to_end_and_resumed(tmp_path: Path) -> None:
    """Interrupted in the second run and resumed: the same file as without interruption."""
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    with SimBench() as bench:
        last = list(run_campaign(short_campaign(), bench, whole))[-1]
        events = run_campaign(short_campaign(), bench, parts)
        next(e for e in events if type(e).__name__ == "PointFinished")
        next(e for e in events if isinstance(getattr(e, "event", None), DriveAdvanced))
        events.close()
        list(run_campaign(short_campaign(), bench, parts, resume=True))
    assert isinstance(last, CampaignFinished)
    assert [one.status for one in last.results] == ["done", "done"]
    text = (whole / "results.json").read_text()
    assert (parts / "results.json").read_text() == text
    first, second = json.loads(text)["points"]
    assert first["performance"]["indicators"] != second["performance"]["indicators"], "other noise"
    assert set(first["predictions"]) == {"model_1", "model_2"}


def test_point_that_cannot_be_recorded_fails_alone(tmp_path: Path) -> None:
    campaign = short_campaign()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / campaign.points[0].name).write_text("a file in the way")
    with SimBench() as bench:
        last = list(run_campaign(campaign, bench, tmp_path / "out"))[-1]
    assert isinstance(last, CampaignFinished)
    assert [one.status for one in last.results] == ["failed", "done"]
    assert "in the way" not in last.results[0].error
    assert str(tmp_path / "out" / campaign.points[0].name) in last.results[0].error

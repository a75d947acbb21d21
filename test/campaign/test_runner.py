"""The runner: points go on after a failure, results are whole at all times, and can be resumed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.campaign import runner
from imotor_ros.campaign.bench import PerformanceReported
from imotor_ros.campaign.campaign import Campaign
from imotor_ros.campaign.runner import (
    DONE,
    FAILED,
    CampaignFinished,
    CampaignStarted,
    PointFinished,
    PointStarted,
    RunAdvanced,
    run_campaign,
)
from imotor_ros.core.indicators import Performance
from imotor_ros.errors import (
    BadInputError,
    DriveLimitError,
    ExcitationError,
    NodeDiedError,
    RunError,
    UnreadableFileError,
)

pytestmark = pytest.mark.usefixtures("quick_predictions")

MakeCampaign = Callable[..., Campaign]


def results(output: Path) -> dict[str, Any]:
    """Return the content of the results file."""
    content: dict[str, Any] = json.loads((output / "results.json").read_text())
    return content


def statuses(output: Path) -> dict[str, str]:
    """Return the status of each point in the results file."""
    return {point["name"]: point["status"] for point in results(output)["points"]}


def test_events_tell_the_whole_story_in_order(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    campaign = make_campaign(2)
    events = list(run_campaign(campaign, instant_bench(), output, provenance=lambda: {"host": "h"}))
    kinds = [
        type(event.event if isinstance(event, RunAdvanced) else event).__name__ for event in events
    ]
    excitation = ["PhaseEntered", "ExcitationAdvanced"]
    run = ["PhaseEntered", "DriveAdvanced", *["PerformanceReported"] * 2]
    point = ["PointStarted", *excitation, *run]
    assert kinds == ["CampaignStarted", *[*point, "PointFinished"] * 2, "CampaignFinished"]
    assert isinstance(events[0], CampaignStarted)
    assert (events[0].campaign, events[0].done_before) == (campaign, 0)
    started = [event for event in events if isinstance(event, PointStarted)]
    assert [event.number for event in started] == [0, 1]
    assert started[0].plan.provenance == {"host": "h"}
    finished = [event for event in events if isinstance(event, PointFinished)]
    last = events[-1]
    assert isinstance(last, CampaignFinished)
    assert last.results == tuple(event.result for event in finished)
    assert last.results_path == output / "results.json"


def test_results_hold_campaign_indicators_and_predictions(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    campaign = make_campaign(2)
    list(run_campaign(campaign, instant_bench(), output))
    content = results(output)
    assert content["bench"] == "instant"
    assert content["campaign"] == campaign.to_mapping()
    first = content["points"][0]
    assert first["name"] == "seed-1"
    assert first["run_id"].startswith("seed-1-")
    assert first["bag"] == "seed-1/bag"
    assert first["error"] == ""
    assert Performance.from_mapping(first["performance"]).indicator("mean_velocity").value == 1e-3
    assert first["predictions"] == {"model_1": {"mean_velocity": 0.1}}


@pytest.mark.parametrize(
    "failure", [NodeDiedError("plant", "signal SIGKILL", ("last words",)), RunError("no reason")]
)
def test_failing_point_is_reported_and_the_others_go_on(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path, failure: RunError
) -> None:
    bench = instant_bench({"seed-2": failure})
    events = list(run_campaign(make_campaign(3), bench, output))
    assert bench.carried_out == ["seed-1", "seed-2", "seed-3"]
    assert statuses(output) == {"seed-1": DONE, "seed-2": FAILED, "seed-3": DONE}
    failed = results(output)["points"][1]
    assert failed["error"] == str(failure)
    assert failed["performance"] is None, "provisional indicators are no result"
    assert isinstance(events[-1], CampaignFinished)
    assert [one.status for one in events[-1].results] == [DONE, FAILED, DONE]


def test_run_without_final_indicators_has_failed(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    class Provisional(instant_bench):  # type: ignore[misc]
        def run(self, plan: Any) -> Any:
            for event in super().run(plan):
                if not (isinstance(event, PerformanceReported) and event.performance.is_final):
                    yield event

    list(run_campaign(make_campaign(1), Provisional(), output))
    assert results(output)["points"][0]["error"] == "the run ended without final indicators"


def test_error_of_the_bench_itself_ends_the_campaign(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    """A namespace that is taken, an executable that is missing: no point can be carried out."""
    bench = instant_bench({"seed-2": BadInputError("is not installed", where="package x")})
    with pytest.raises(BadInputError, match="package x"):
        list(run_campaign(make_campaign(3), bench, output))
    assert statuses(output) == {"seed-1": DONE}


def test_unexpected_error_is_not_swallowed(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    with pytest.raises(ZeroDivisionError):
        list(run_campaign(make_campaign(2), instant_bench({"seed-1": ZeroDivisionError()}), output))


def test_point_that_cannot_be_planned_is_named_before_anything_runs(
    make_campaign: MakeCampaign,
    instant_bench: Any,
    output: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    original = runner.plan_run

    def refuse(point: Any, directory: Path) -> Any:
        if point.name == "seed-2":
            raise BadInputError("cannot be driven", where="signal.stroke", value=1.0)
        return original(point, directory)

    monkeypatch.setattr(runner, "plan_run", refuse)
    bench = instant_bench()
    with pytest.raises(BadInputError, match=r"point seed-2: signal.stroke: cannot be driven"):
        list(run_campaign(make_campaign(3), bench, output))
    assert bench.carried_out == []
    assert not output.exists()


# ---- results.json ----------------------------------------------------------------------------


def test_results_are_replaced_in_one_step_after_every_point(
    make_campaign: MakeCampaign,
    instant_bench: Any,
    output: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At the moment of replacement both the old and the new file are whole."""
    seen: list[tuple[int, int]] = []
    replace = Path.replace

    def watched(self: Path, target: Path) -> Path:
        before = len(json.loads(target.read_text())["points"]) if target.exists() else 0
        seen.append((before, len(json.loads(self.read_text())["points"])))
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", watched)
    list(run_campaign(make_campaign(3), instant_bench(), output))
    assert seen == [(0, 1), (1, 2), (2, 3)]
    assert sorted(p.name for p in output.iterdir() if p.is_file()) == ["results.json"]


def test_results_that_cannot_be_written_are_one_clear_error(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    output.mkdir(parents=True)
    (output / "results.json").mkdir()
    with pytest.raises(RunError, match=r"results\.json: cannot be written"):
        list(run_campaign(make_campaign(1), instant_bench(), output))


def test_output_below_a_file_is_bad_input(
    make_campaign: MakeCampaign, instant_bench: Any, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(BadInputError, match="file"):
        list(run_campaign(make_campaign(1), instant_bench(), tmp_path / "file" / "out"))


# ---- resuming ------------------------------------------------------------------------------------


def test_resumed_campaign_repeats_nothing_and_leaves_the_same_results(
    make_campaign: MakeCampaign, instant_bench: Any, tmp_path: Path
) -> None:
    """Interrupted within the second of three points; also a point that failed runs again."""
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    campaign = make_campaign(3)
    list(run_campaign(campaign, instant_bench(), whole))
    first = instant_bench()
    events = run_campaign(campaign, first, parts)
    next(e for e in events if isinstance(e, PointStarted) and e.number == 1)
    next(events)
    events.close()
    assert statuses(parts) == {"seed-1": DONE}
    second = instant_bench({"seed-2": RunError("once")})
    resumed = list(run_campaign(campaign, second, parts, resume=True))
    assert isinstance(resumed[0], CampaignStarted)
    assert resumed[0].done_before == 1
    assert second.carried_out == ["seed-2", "seed-3"]
    third = instant_bench()
    last = list(run_campaign(campaign, third, parts, resume=True))[-1]
    assert third.carried_out == ["seed-2"]
    assert isinstance(last, CampaignFinished)
    assert [one.name for one in last.results] == ["seed-1", "seed-2", "seed-3"], "in order"
    assert (parts / "results.json").read_text() == (whole / "results.json").read_text()


def test_resuming_what_is_done_runs_nothing(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    campaign = make_campaign(2)
    list(run_campaign(campaign, instant_bench(), output))
    text = (output / "results.json").read_text()
    bench = instant_bench()
    last = list(run_campaign(campaign, bench, output, resume=True))[-1]
    assert bench.carried_out == []
    assert isinstance(last, CampaignFinished)
    assert len(last.results) == 2
    assert (output / "results.json").read_text() == text


def test_point_whose_bag_is_gone_runs_again(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    campaign = make_campaign(2)
    list(run_campaign(campaign, instant_bench(), output))
    (output / "seed-1" / "bag").rmdir()
    bench = instant_bench()
    list(run_campaign(campaign, bench, output, resume=True))
    assert bench.carried_out == ["seed-1"]


def test_longer_campaign_resumes_a_shorter_one(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    list(run_campaign(make_campaign(1), instant_bench(), output))
    bench = instant_bench()
    list(run_campaign(make_campaign(3), bench, output, resume=True))
    assert bench.carried_out == ["seed-2", "seed-3"]


def test_results_of_other_parameters_are_refused(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    list(run_campaign(make_campaign(2), instant_bench(), output))
    other = make_campaign(2, **{"drive.offset": 10.0})
    bench = instant_bench()
    with pytest.raises(BadInputError, match=r"results\.json: holds points of another campaign"):
        list(run_campaign(other, bench, output, resume=True))
    assert bench.carried_out == []


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"points": 3}', '{"points": [{}]}', '{"points": [null]}', "\xff"]
)
def test_results_that_do_not_parse_are_refused(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path, text: str
) -> None:
    output.mkdir(parents=True)
    (output / "results.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(UnreadableFileError, match=r"results\.json: does not parse") as caught:
        list(run_campaign(make_campaign(1), instant_bench(), output, resume=True))
    assert "\n" not in str(caught.value)
    assert (output / "results.json").read_bytes() == text.encode("latin-1")


def test_results_of_a_bad_performance_are_refused(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    campaign = make_campaign(1)
    list(run_campaign(campaign, instant_bench(), output))
    content = results(output)
    del content["points"][0]["performance"]["indicators"]
    (output / "results.json").write_text(json.dumps(content))
    with pytest.raises(UnreadableFileError, match=r"results\.json: does not parse"):
        list(run_campaign(campaign, instant_bench(), output, resume=True))


def test_point_whose_excitation_is_refused_fails_alone(
    make_campaign: MakeCampaign, instant_bench: Any, output: Path
) -> None:
    bench = instant_bench()
    bench.refusals = {
        "seed-1": DriveLimitError("hold", "voltage", 131.2, 120.0, "V"),
        "seed-3": ExcitationError("harmonic 3 is off by 4 %"),
    }
    list(run_campaign(make_campaign(3), bench, output))
    assert statuses(output) == {"seed-1": FAILED, "seed-2": DONE, "seed-3": FAILED}
    assert bench.carried_out == ["seed-2"], "nothing is driven without its voltage"
    errors = [point["error"] for point in results(output)["points"]]
    assert errors[0] == "hold: needs a voltage of 131.2 V, expected at most 120 V"
    assert errors[2] == "harmonic 3 is off by 4 %"

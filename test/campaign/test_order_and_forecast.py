"""Order and repetition of runs, and what a dry run says of them."""

import json
from collections.abc import Callable
from pathlib import Path
from shutil import _ntuple_diskusage as Usage
from typing import Any

import pytest

from imotor_ros.campaign import forecast
from imotor_ros.campaign.bench import Bench
from imotor_ros.campaign.campaign import Campaign, campaign_from_mapping
from imotor_ros.campaign.forecast import forecast_run
from imotor_ros.campaign.order import sequence_of
from imotor_ros.campaign.plan import plan_run
from imotor_ros.campaign.runner import PointFinished, run_campaign
from imotor_ros.cli.main import main
from imotor_ros.errors import BadInputError, RecordingError

PAPER = Path(__file__).parents[2] / "params" / "campaigns" / "paper.yaml"


def campaign(**keys: Any) -> Campaign:
    return campaign_from_mapping({"sweep": {"signal.harmonics": [2, 3]}, **keys})


def test_rounds_and_rows_of_repetitions() -> None:
    assert sequence_of(2, 2) == [(0, 0), (1, 0), (0, 1), (1, 1)]
    assert sequence_of(2, 2, "together") == [(0, 0), (0, 1), (1, 0), (1, 1)]


def test_random_order_holds_every_run_and_depends_on_its_seed_alone() -> None:
    shuffled = sequence_of(20, 3, "random", 5)
    assert sorted(shuffled) == sequence_of(20, 3, "together")
    assert shuffled == sequence_of(20, 3, "random", 5)
    assert shuffled != sequence_of(20, 3, "random", 6)


def test_repetitions_have_names_and_seeds_of_their_own() -> None:
    points = campaign(repetitions=2, point={"seed": 7}).points
    names = ["harmonics-2_r1", "harmonics-3_r1", "harmonics-2_r2", "harmonics-3_r2"]
    assert [one.name for one in points] == names
    assert [one.parameters.seed for one in points] == [7, 7, 8, 8]


def test_campaign_in_order_survives_a_round_trip() -> None:
    made = campaign(repetitions=3, order="random", order_seed=2)
    assert campaign_from_mapping(made.to_mapping()) == made


@pytest.mark.parametrize(
    "keys", [{"repetitions": 0}, {"repetitions": True}, {"order": "any"}, {"order_seed": -1}]
)
def test_impossible_order_is_refused_by_name(keys: dict[str, Any]) -> None:
    with pytest.raises(BadInputError, match=next(iter(keys))):
        campaign(**keys)


def test_forecast_agrees_with_the_plan() -> None:
    point = campaign().points[0]
    found, program = forecast_run(point), plan_run(point, Path()).program
    assert (found.run_id, found.samples) == (program.run_id, program.length)
    assert found.duration == pytest.approx(program.length / program.sample_rate)
    assert found.lowest_voltage < 50.0 < found.highest_voltage
    assert not found.problem


def test_forecast_finds_a_drive_beyond_the_amplifier() -> None:
    point = campaign(point={"signal.stroke": 60e-6}).points[0]
    assert "needs a voltage of 242.8 V, expected at most 120 V" in forecast_run(point).problem
    for frequency, reason in (
        (60e3, "needs a current of 18.2 A, expected at most 10 A"),
        (80e3, "needs a slew rate of 3.045e+07 V/s, expected at most 2e+07 V/s"),
    ):
        fast = campaign(point={"signal.maximum_frequency": frequency}).points[0]
        assert reason in forecast_run(fast).problem


def test_dry_run_lists_the_runs_and_makes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(PAPER), "--dry-run", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    names = [one["name"] for one in found["runs"]]
    assert (len(names), names[0]) == (13, "identification")
    assert found["duration"] == pytest.approx(sum(one["duration"] for one in found["runs"]))
    assert list(tmp_path.iterdir()) == []


def test_bags_that_would_fill_the_disk_are_refused_before_anything_runs(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    make_campaign: Callable[..., Campaign],
    instant_bench: Callable[[], Bench],
) -> None:
    campaign = make_campaign(3)
    needed = sum(forecast_run(point).bag_size for point in campaign.points)
    for free, is_enough in ((needed, True), (needed - 1, False)):
        usage = Usage(total=10 * needed, used=10 * needed - free, free=free)
        monkeypatch.setattr(forecast.shutil, "disk_usage", lambda _, usage=usage: usage)
        output = tmp_path / str(free)
        with instant_bench() as bench:
            run = run_campaign(campaign, bench, output)
            if is_enough:
                assert len([one for one in run if isinstance(one, PointFinished)]) == 3
                continue
            with pytest.raises(RecordingError, match=r"disk is too full.* need about .* are free"):
                list(run)
        assert not list(output.iterdir())

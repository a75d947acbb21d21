"""Points by the model alone, in one process and in several."""

import csv
import json
from pathlib import Path

import pytest

from imotor_ros.campaign import model_sweep
from imotor_ros.campaign.campaign import Campaign, campaign_from_mapping
from imotor_ros.campaign.model_sweep import predict_points
from imotor_ros.cli.main import main
from imotor_ros.core.friction import VelocityDependentFriction
from imotor_ros.core.model import Prediction, predict
from imotor_ros.core.parameters import varying_leaves
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import SliderParameters
from imotor_ros.errors import BadInputError, SolverError

PAPER = Path(__file__).parents[2] / "params" / "campaigns" / "paper.yaml"


@pytest.fixture
def campaign() -> Campaign:
    return campaign_from_mapping(
        {"sweep": {"signal.maximum_frequency": [9250.0, 12e3, 15e3], "signal.harmonics": [2, 3]}}
    )


def test_predictions_are_those_of_the_closed_form(campaign: Campaign) -> None:
    found = list(predict_points(campaign.points, 1))
    assert [one["name"] for one in found] == [point.name for point in campaign.points]
    for one, point in zip(found, campaign.points, strict=True):
        motion = point.parameters.signal.motion
        expected = predict(motion, SliderParameters(), VelocityDependentFriction())
        assert expected.solver == "closed_form"
        assert one["mean_velocity"] == expected.mean_velocity
        assert one["ripple"] == expected.ripple


def test_number_of_processes_changes_nothing(campaign: Campaign) -> None:
    alone = list(predict_points(campaign.points, 1))
    assert list(predict_points(campaign.points, 2)) == alone


def test_no_process_is_refused(campaign: Campaign) -> None:
    with pytest.raises(BadInputError, match="jobs"):
        list(predict_points(campaign.points, 0))


def test_verb_prints_and_writes_every_point(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "sweep.csv"
    assert main(["sweep", str(PAPER), "--jobs", "1", "--output", str(path), "--json"]) == 0
    points = json.loads(capsys.readouterr().out)["points"]
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["mean_velocity"]) for row in rows] == [p["mean_velocity"] for p in points]
    assert len(rows) == 12
    # beside the names, what differs between the points
    assert {float(row["signal.maximum_frequency"]) for row in rows} == {
        2312.5, 4625.0, 9250.0, 18500.0,
    }  # fmt: skip


def test_case_that_no_solver_can_do_leaves_the_others_alone(
    monkeypatch: pytest.MonkeyPatch, campaign: Campaign
) -> None:
    def fails_at_15_khz(motion: HarmonicMotion, *rest: object) -> Prediction:
        if motion.max_frequency == 15e3:
            raise SolverError("the events have no end")
        return predict(motion, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(model_sweep, "predict", fails_at_15_khz)
    rows = list(predict_points(campaign.points, 1))
    assert [row["error"] for row in rows] == ["", "", "", "", *2 * ["the events have no end"]]
    assert rows[5]["mean_velocity"] is None
    assert rows[0]["mean_velocity"] > 0.0


def test_table_names_what_differs_where_laws_differ(tmp_path: Path) -> None:
    points = campaign_from_mapping(
        {"points": [{"stand.motor.friction.law": "coulomb"}, {"stand.motor.friction.slope": 1.0}]}
    ).points
    assert varying_leaves([point.parameters for point in points]) == [
        {"stand.motor.friction.law": "coulomb", "stand.motor.friction.sliding_force": 1.01,
         "stand.motor.friction.slope": None},
        {"stand.motor.friction.law": "velocity", "stand.motor.friction.sliding_force": 0.94,
         "stand.motor.friction.slope": 1.0},
    ]  # fmt: skip


@pytest.mark.parametrize("options", [["--output", "t.xls"], ["--jobs", "1", "--scheduler", "x"]])
def test_bad_options_are_refused_before_any_work(options: list[str]) -> None:
    assert main(["sweep", str(PAPER), *options]) == 2

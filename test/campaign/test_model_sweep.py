"""Points by the model alone, in one process and in several."""

import csv
import json
from pathlib import Path

import pytest

from imotor_ros.campaign.campaign import Campaign, campaign_from_mapping
from imotor_ros.campaign.model_sweep import predict_points
from imotor_ros.cli.main import main
from imotor_ros.core.friction import VelocityDependentFriction
from imotor_ros.core.model import predict
from imotor_ros.core.slider import SliderParameters
from imotor_ros.errors import BadInputError

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

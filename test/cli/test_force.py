"""The verb `force`."""

import csv
import json
import shutil
from pathlib import Path

import pytest

from imotor_ros.cli.main import main

POINT = ["force", "--harmonics", "2", "--max-frequency", "9250", "--friction", "velocity"]


def test_force_gives_both_curves_as_json_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "force.png"
    options = ["--stiffnesses", "1e3,2e3,4e3", "--points", "3", "--json"]
    assert main([*POINT, *options, "--picture", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["stiffness"] for one in found["springs"]] == [1e3, 2e3, 4e3]
    assert found["plateau"]["value"] == pytest.approx(found["stall_force"]["value"], rel=1e-3)
    assert found["critical_stiffness"]["value"] is None
    assert found["critical_stiffness"]["reason"]
    assert len(found["characteristic"]) == 3
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--stiffnesses", "1e3,soft"], "--stiffnesses"),
        (["--stiffnesses", "0"], "stiffness"),
        (["--points", "1"], "points"),
    ],
)
def test_bad_numbers_are_refused(
    options: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*POINT, *options]) == 2
    assert text in capsys.readouterr().err


MEASURE = ["force", "--harmonics", "2", "--max-frequency", "9250", "--bench", "sim"]


def test_force_is_measured_beside_both_models_and_goes_on_where_it_was_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "force"
    options = ["--stiffnesses", "1e3,1e4,1e5", "--points", "2", "--output", str(output), "--json"]
    assert main([*MEASURE, *options]) == 0
    found = json.loads(capsys.readouterr().out)
    model = found["models"]["model_2"]
    # the rod of the virtual motor keeps some per cent of unwanted motion, the sensor 1 %
    for one in found["springs"]:
        assert one["force"]["value"] == pytest.approx(model["plateau"]["value"], rel=0.05)
        assert 0.0 < one["force"]["uncertainty"] < 0.01
    assert found["plateau"]["value"] == pytest.approx(found["stop_force"]["value"], rel=0.03)
    free, loaded = found["characteristic"]
    assert free["mean_velocity"]["value"] == pytest.approx(
        model["characteristic"][0]["mean_velocity"], rel=0.05
    )
    assert loaded["load_force"] == pytest.approx(0.95 * model["stall_force"]["value"])
    assert 0.0 < loaded["mean_velocity"]["value"] < 0.1 * free["mean_velocity"]["value"]
    assert Path(found["picture"]).stat().st_size > 10_000
    with Path(found["table"]).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["load"] for row in rows] == [*3 * ["spring"], *2 * ["weight"], "stop"]

    shutil.rmtree(output / "stop")
    bag = output / "k1000" / "bag"
    before = {path: path.stat().st_mtime_ns for path in bag.iterdir()}
    assert main([*MEASURE, *options, "--resume"]) == 0
    assert json.loads(capsys.readouterr().out) == found
    assert {path: path.stat().st_mtime_ns for path in bag.iterdir()} == before


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ([*MEASURE, "--friction", "coulomb"], "--friction: stands beside --bench"),
        ([*MEASURE, "--points", "1"], "points: is out of bounds"),
        ([*MEASURE, "--stiffnesses", "-1"], "stiffness: is out of bounds"),
        (MEASURE[:-2], "--friction: is missing"),
        ([*POINT, "--output", "x"], "--output: needs --bench"),
    ],
)
def test_options_that_contradict_each_other_are_refused(
    options: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(options) == 2
    assert text in capsys.readouterr().err

"""The verb `identify-friction`: a small run, its files, and what it refuses."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.bag.reader import RunBag
from imotor_ros.cli.friction_option import friction_law
from imotor_ros.cli.main import main
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.errors import BadInputError

Imotor = Callable[..., Any]

ROOT = Path(__file__).parents[2]

CAMPAIGN = """
name: small
point:
  name: run
  report_interval: 0.0
  stand:
    slider_vibrometer: {calibration_uncertainty: 0.0}
    rod_vibrometer: {calibration_uncertainty: 0.0}
  drive:
    kind: stepped_sine
    steps: 4
    lowest_amplitude: LOWEST
    highest_amplitude: HIGHEST
    step_time: 0.012
    corrections: 1
    corrected_frequency: 6000.0
"""


def small_run(folder: Path, lowest: float, highest: float) -> tuple[int, Path]:
    """Carry out a run of eight steps; return the exit code and the folder of the results."""
    campaign = folder / "small.yaml"
    numbers = (("LOWEST", lowest), ("HIGHEST", highest))
    text = CAMPAIGN
    for word, number in numbers:
        text = text.replace(word, f"{number:.9f}")
    campaign.write_text(text)
    output = folder / "out"
    options = ["--campaign", str(campaign), "--bench", "sim", "--output", str(output)]
    return main(["identify-friction", *options]), output


@pytest.fixture(scope="session")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an identification, whose motor has the line (8)."""
    code, output = small_run(tmp_path_factory.mktemp("friction"), 2.5e-6, 8e-6)
    assert code == 0
    return output


def test_run_leaves_law_numbers_and_pictures(identified: Path) -> None:
    found = json.loads((identified / "identification.json").read_text())
    line = found["laws"]["velocity"]["estimates"]
    assert line["sliding_force"]["value"] == pytest.approx(0.940, rel=0.01)
    assert line["slope"]["value"] == pytest.approx(2.213, rel=0.03)
    for number in (7, 8, 9):
        picture = identified / f"figure_{number}.png"
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_documented_keys_are_those_of_the_result(identified: Path) -> None:
    text = (ROOT / "docs" / "friction_identification.md").read_text()
    rows = re.findall(r"^\| (`.*?) \|", text.partition("## Keys of")[2], re.MULTILINE)
    documented = {key for row in rows for key in re.findall(r"`(\w+)`", row)}
    found = json.loads((identified / "identification.json").read_text())
    assert documented == {"bag", "output", "files", *found}


def test_recorded_run_gives_the_same_numbers(
    identified: Path, imotor: Imotor, tmp_path: Path
) -> None:
    bag, output = identified / "run" / "bag", tmp_path / "again"
    answer = imotor("identify-friction", bag, "--output", output, "--json")
    assert answer.code == 0
    again = json.loads((output / "identification.json").read_text())
    assert again == json.loads((identified / "identification.json").read_text())
    assert {key: answer.json[key] for key in again} == again
    assert set(answer.json["files"]) == {"numbers", "law", "figure_7", "figure_8", "figure_9"}
    # nothing is overwritten
    assert imotor("identify-friction", bag, "--output", output).code == 2


def test_law_is_what_models_and_motor_take(identified: Path, imotor: Imotor) -> None:
    path = identified / "friction.yaml"
    law = friction_law(str(path))
    assert isinstance(law, FrictionLaw)
    found = json.loads((identified / "identification.json").read_text())["friction"]
    assert law.numbers.force == found["sliding_force"]
    point = ("simulate", "--harmonics", 2, "--max-frequency", 9250, "--json", "--friction")
    by_file, by_name = imotor(*point, path), imotor(*point, "velocity")
    assert by_file.code == 0
    assert by_file.json["mean_velocity"] != by_name.json["mean_velocity"]
    assert by_file.json["mean_velocity"] == pytest.approx(by_name.json["mean_velocity"], rel=0.03)


def test_run_that_only_sticks_ends_in_a_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, output = small_run(tmp_path, 0.3e-6, 0.7e-6)
    assert code == 1
    assert "error: no friction law: only 0 of 8 steps slide" in capsys.readouterr().err
    assert not (output / "friction.yaml").exists()
    assert json.loads((output / "identification.json").read_text())["friction"] is None


def test_bag_of_another_kind_of_run_is_refused(bag: Path, imotor: Imotor, tmp_path: Path) -> None:
    for options in ([], ["--json"]):
        answer = imotor("identify-friction", bag, "--output", tmp_path / "out", *options)
        assert answer.code == 2
        assert "has no steps" in answer.error
    assert not (tmp_path / "out").exists()


def test_file_that_is_no_bag_is_refused(imotor: Imotor, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("no bag")
    for name in ("text", "missing"):
        answer = imotor("identify-friction", tmp_path / name, "--output", tmp_path / "out")
        assert answer.code == 2
        assert name in answer.error


def test_bag_that_does_not_tell_the_mass_wants_to_be_told(
    identified: Path, imotor: Imotor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RunBag, "run_info", {})  # as a rig's driver may leave it
    bag = identified / "run" / "bag"
    answer = imotor("identify-friction", bag, "--output", tmp_path / "none")
    assert answer.code == 2
    assert "slider mass: is unknown" in answer.error
    assert "--mass" in answer.error
    told = imotor(
        "identify-friction", bag, "--mass", 13.84e-3, "--output", tmp_path / "told", "--json"
    )
    true = json.loads((identified / "identification.json").read_text())
    assert told.code == 0
    found, known = (
        one["laws"]["velocity"]["estimates"]["sliding_force"]["value"] for one in (told.json, true)
    )
    assert found == pytest.approx(2.0 * known, rel=1e-3), "the force is mass times acceleration"


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--frequency", 1000], "--frequency: is for a new run"),
        (["--mass", -1], "--mass: is out of bounds"),
        (["--threshold", -1], "threshold: is out of bounds"),
    ],
)
def test_impossible_options_are_refused(
    identified: Path, imotor: Imotor, tmp_path: Path, options: list[Any], text: str
) -> None:
    bag = identified / "run" / "bag"
    answer = imotor("identify-friction", bag, "--output", tmp_path / "out", *options)
    assert answer.code == 2
    assert text in answer.error


def test_run_of_another_kind_is_no_friction_campaign(imotor: Imotor, campaign_file: Path) -> None:
    answer = imotor("identify-friction", "--campaign", campaign_file, "--bench", "sim")
    assert answer.code == 2
    assert "does not have one point" in answer.error


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("load: {upper_stop: 1.0e-3}\n", "friction: is missing"),
        ("friction: {law: sticky}\n", "friction.law"),
        ("friction: {law: coulomb, sliding_force: -1}\n", "sliding_force"),
    ],
)
def test_file_without_a_law_is_refused(tmp_path: Path, content: str, text: str) -> None:
    path = tmp_path / "motor.yaml"
    path.write_text(content)
    with pytest.raises(BadInputError, match=text):
        friction_law(str(path))


def test_name_that_is_no_law_is_refused(imotor: Imotor) -> None:
    answer = imotor("simulate", "--harmonics", 2, "--max-frequency", 9250, "--friction", "none")
    assert answer.code == 2
    assert "is neither a law nor a file, got 'none'" in answer.error

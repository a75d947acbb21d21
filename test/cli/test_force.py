"""The verb `force`."""

import json
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

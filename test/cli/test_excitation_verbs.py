"""The verbs frequency-response and excite: files, JSON, tables, refusals."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imotor_ros.bag.reader import RunBag
from imotor_ros.cli import frequency_response, motor_stand
from imotor_ros.cli.main import main
from imotor_ros.core.response import MeasuredResponse

MOTORS = Path(__file__).parents[2] / "params" / "motors"
SIM = ["--bench", "sim"]


def run_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    """Run a verb with --json; return what it printed, which must be one object and no more."""
    assert main([*arguments, "--json"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("\n") == 1
    content: dict[str, Any] = json.loads(printed)
    return content


def run_refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Run a verb that refuses its input; return the one line it says."""
    assert main(list(arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    return captured.err


def response(*extra: str) -> list[str]:
    return ["frequency-response", *SIM, "--points", "6", *extra]


def test_response_is_printed_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    told = run_json(capsys, *response("--output", str(folder)))
    written = json.loads((folder / "response.json").read_text())
    assert {key: told[key] for key in written} == written
    found = MeasuredResponse.from_mapping(written)
    assert np.array(told["admittance_magnitudes"]) == pytest.approx(np.abs(found.admittances))
    assert np.array(told["gains"]) * 2 * np.pi * np.array(told["frequencies"]) == pytest.approx(
        told["admittance_magnitudes"]
    )
    assert told["gains"][0] == pytest.approx(0.164e-6, rel=0.03)
    assert min(told["coherences"]) > 0.9999
    assert told["warnings"] == []
    assert told["offset"] == 50.0
    assert (folder / "response.png").read_bytes().startswith(b"\x89PNG")
    for name in ("probe-1", "sweep-1"):
        with RunBag(folder / "trials" / name / "bag") as bag:
            assert bag.end_state == "completed"


def test_low_coherence_is_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    original = motor_stand.follow

    def follow(events: Any) -> MeasuredResponse:
        found: MeasuredResponse = original(events)
        return dataclasses.replace(found, coherences=(0.9, 0.5, 1.0, 0.25, 1.0, 1.0))

    monkeypatch.setattr(frequency_response, "follow", follow)
    warning = "coherence below 0.9 at 2 of 6 frequencies, lowest 0.25: no basis for a voltage there"
    assert run_json(capsys, *response("--output", str(tmp_path / "a")))["warnings"] == [warning]
    assert main(response("--output", str(tmp_path / "b"))) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"warning: {warning}"


def test_response_of_another_motor_swings_about_the_middle_of_its_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motor = str(MOTORS / "small_stack.yaml")
    told = run_json(capsys, *response("--motor", motor, "--output", str(tmp_path / "out")))
    assert told["offset"] == 60.0
    assert max(told["gains"]) > 1.5 * told["gains"][0], "the resonance at 15 kHz"


def test_multisine_is_another_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = run_json(capsys, *response("--method", "multisine", "--output", str(tmp_path / "out")))
    assert told["method"] == "multisine"
    assert told["gains"][0] == pytest.approx(0.15e-6, rel=0.2)


def test_tables_are_for_people(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(response("--output", str(tmp_path / "response"))) == 0
    assert "|Y| (mm/s/V)" in capsys.readouterr().out
    excite = ["excite", *SIM, "--harmonics", "2", "--max-frequency", "9250"]
    assert main([*excite, "--output", str(tmp_path / "excite")]) == 0
    printed = capsys.readouterr().out
    assert "corrected (V)" in printed
    assert "after 1 correction" in printed
    assert "brought to rest: harmonics 3 to 10" in printed


def test_excitation_is_printed_as_in_table_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    told = run_json(
        capsys, "excite", *SIM, "--motor", str(MOTORS / "paper.yaml"), "--harmonics", "4",
        "--max-frequency", "18500", "--suppressed", "0", "--output", str(folder),
    )  # fmt: skip
    written = json.loads((folder / "excitation.json").read_text())
    assert {key: told[key] for key in written} == written
    wanted = told["wanted"]
    assert wanted["amplitudes"] == pytest.approx([6.23e-6, 2.43e-6, 1.07e-6, 0.37e-6], abs=5e-9)
    assert np.degrees(wanted["phases"]) == pytest.approx([0.0, -153.7, 46.9, -113.9], abs=0.05)
    assert told["linear_model"]["amplitudes"] == pytest.approx([37.44, 13.98, 5.75, 2.05], rel=0.03)
    assert told["corrected"]["amplitudes"] == pytest.approx([36.87, 14.09, 5.76, 1.97], rel=0.06)
    assert max(map(abs, told["errors"]["amplitudes"])) < 0.01
    assert max(map(abs, told["errors"]["phases"])) < math.radians(1.0)
    assert told["cycles"] <= 3
    assert len(told["history"]) == told["cycles"] + 1
    assert told["suppressed"]["amplitudes"] == []
    for name in ("wanted", "linear_model", "corrected"):
        absolute = np.array(told[name]["absolute_phases"])
        orders = np.arange(1, 5)
        relative = np.angle(np.exp(1j * (absolute - orders * absolute[0])))
        assert told[name]["phases"] == pytest.approx(relative, abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--stroke", "25e-6"], r"needs a voltage of .* V, expected at most 120 V"),
        (["--offset", "110"], "at most 120 V"),
        (["--offset", "130"], "--offset: is out of the motor's range"),
        (["--harmonics", "0"], "--harmonics: "),
        (["--motor", "missing.yaml"], "missing.yaml"),
    ],
)
def test_excite_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], reason: str
) -> None:
    line = run_refused(
        capsys, "excite", *SIM, "--harmonics", "2", "--max-frequency", "18500",
        "--output", str(tmp_path / "out"), *arguments,
    )  # fmt: skip
    assert re.search(reason, line)


@pytest.mark.parametrize(
    ("amplifier", "quantity"),
    [
        ("slew_rate: 2.0e+6", r"a slew rate of \S+ V/s, expected at most 2e\+06 V/s"),
        ("current_limit: 3.0", r"a current of \S+ A, expected at most 3 A"),
        (
            "lowest_voltage: 0.0, highest_voltage: 80.0",
            r"a voltage of \S+ V, .* 8?0 V",
        ),
    ],
)
def test_excite_refuses_what_the_amplifier_of_a_motor_cannot_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], amplifier: str, quantity: str
) -> None:
    """With the needed and the allowed value, and no result."""
    motor, folder = tmp_path / "motor.yaml", tmp_path / "out"
    motor.write_text(f"amplifier: {{{amplifier}}}\n", encoding="utf-8")
    line = run_refused(
        capsys, "excite", *SIM, "--motor", str(motor), "--harmonics", "2",
        "--max-frequency", "18500", "--output", str(folder),
    )  # fmt: skip
    assert re.search(f"needs {quantity}", line)
    assert not (folder / "excitation.json").exists()


def test_excite_refuses_what_the_vibrometer_cannot_show(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stand = tmp_path / "stand.yaml"
    stand.write_text("rod_vibrometer: {velocity_range: 0.025}\n", encoding="utf-8")
    line = run_refused(
        capsys, "excite", *SIM, "--stand", str(stand), "--harmonics", "2",
        "--max-frequency", "18500", "--output", str(tmp_path / "out"),
    )  # fmt: skip
    assert "needs a velocity of 0.5886 m/s, expected at most 0.25 m/s" in line


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--amplitude", "75"], "at most 70 V"),
        (["--highest-frequency", "500"], "--highest-frequency: "),
        (["--points", "1"], "--points: "),
    ],
)
def test_response_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], reason: str
) -> None:
    line = run_refused(capsys, *response("--output", str(tmp_path / "out"), *arguments))
    assert reason in line


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "response.json").write_text("{}")
    assert "holds a result already" in run_refused(capsys, *response("--output", str(tmp_path)))

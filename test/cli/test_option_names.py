"""Errors of the verbs name the option that was given, not the parameter behind it."""

from __future__ import annotations

from pathlib import Path

import pytest

from imotor_ros.cli.main import main

DEMO = str(Path(__file__).parents[2] / "params" / "campaigns" / "demo.yaml")
SIM = ("--bench", "sim")
MOTION = ("--harmonics", "2", "--max-frequency", "9250")
MODEL = (*MOTION, "--friction", "coulomb")


@pytest.mark.parametrize(
    ("verb", "given", "option", "value"),
    [
        ("excite", (*MOTION, *SIM), "--harmonics", "0"),
        ("excite", (*MOTION, *SIM), "--max-frequency", "1e9"),
        ("excite", (*MOTION, *SIM), "--stroke", "nan"),
        ("excite", (*MOTION, *SIM), "--suppressed", "-1"),
        ("excite", (*MOTION, *SIM), "--seed", "-1"),
        ("excite", (*MOTION, *SIM), "--offset", "130"),
        ("frequency-response", SIM, "--amplitude", "nan"),
        ("frequency-response", SIM, "--lowest-frequency", "0"),
        ("frequency-response", SIM, "--highest-frequency", "500"),
        ("frequency-response", SIM, "--highest-frequency", "1e9"),
        ("frequency-response", SIM, "--points", "1"),
        ("signal", MOTION[:2], "--harmonics", "1000000"),
        ("simulate", MODEL, "--max-frequency", "-1"),
        ("simulate", MODEL, "--harmonics", "0"),
        ("simulate", MODEL, "--load-stiffness", "-1"),
        ("simulate", MODEL, "--load-force", "nan"),
        ("simulate", MODEL, "--sample-rate", "0"),
        ("force", MODEL, "--max-frequency", "0"),
        ("force", MODEL, "--points", "1"),
        ("identify-friction", SIM, "--frequency", "nan"),
        ("identify-friction", SIM, "--threshold", "-1"),
        ("sweep", (DEMO,), "--jobs", "0"),
    ],
)
def test_error_names_the_option(
    verb: str, given: tuple[str, ...], option: str, value: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main([verb, *given, f"{option}={value}"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"error: {option}: ")
    assert captured.err.count("\n") == 1
    assert not list(tmp_path.iterdir()), "nothing is written"


def test_parameter_in_a_file_keeps_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motor = tmp_path / "motor.yaml"
    motor.write_text("amplifier: {slew_rate: -1}\n", encoding="utf-8")
    assert main(["excite", *MOTION, *SIM, "--motor", str(motor)]) == 2
    assert f"error: {motor}: amplifier" in capsys.readouterr().err

"""The parameters of the stand, and the files that hold them."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from imotor_ros.core.motor import MotorParameters
from imotor_ros.core.stand import StandParameters
from imotor_ros.errors import BadInputError, UnknownKeyError

PARAMS = Path(__file__).parents[2] / "params"
MOTOR_FILE = PARAMS / "motors" / "paper.yaml"
STAND_FILE = PARAMS / "stands" / "paper.yaml"


def load(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def names(mapping: dict[str, Any], prefix: str = "") -> set[str]:
    """Return the dotted names of all values."""
    result = set()
    for key, value in mapping.items():
        name = prefix + key
        result |= names(value, name + ".") if isinstance(value, dict) else {name}
    return result


def test_paper_motor_is_the_default_motor() -> None:
    assert MotorParameters.from_mapping(load(MOTOR_FILE), str(MOTOR_FILE)) == MotorParameters()


def test_paper_stand_is_the_default_stand() -> None:
    mapping = {**load(STAND_FILE), "motor": load(MOTOR_FILE)}
    assert StandParameters.from_mapping(mapping, str(STAND_FILE)) == StandParameters()


def test_paper_files_hold_every_parameter() -> None:
    mapping = {**load(STAND_FILE), "motor": load(MOTOR_FILE)}
    assert names(mapping) == {name for name, _, _ in StandParameters().leaves()}


@pytest.mark.parametrize("path", sorted((PARAMS / "motors").glob("*.yaml")), ids=lambda p: p.stem)
def test_motor_files_are_motors(path: Path) -> None:
    motor = MotorParameters.from_mapping(load(path), str(path))
    assert names(load(path)) == {name for name, _, _ in motor.leaves()}


@pytest.mark.parametrize("path", sorted((PARAMS / "motors").glob("*.yaml")), ids=lambda p: p.stem)
def test_every_value_of_a_motor_has_its_source_beside_it(path: Path) -> None:
    lines = [line for line in path.read_text().splitlines() if re.search(r":\s+\S", line)]
    values = [line for line in lines if not line.startswith("#")]
    without = {line.split("#")[0].strip() for line in values if "#" not in line}
    assert len(values) > 30
    assert without == set()


def test_every_parameter_of_the_stand_says_what_it_is() -> None:
    for name, _, info in StandParameters().leaves():
        assert info.meaning, name


def test_stand_round_trips_through_a_mapping() -> None:
    stand = StandParameters.from_mapping(
        {
            "motor": {"friction": {"law": "coulomb"}, "slider": {"mass": 1e-3}},
            "rod_vibrometer": {"noise_density": 1e-7, "digitiser": {"bits": 12}},
        }
    )
    assert StandParameters.from_mapping(stand.to_mapping()) == stand
    leaves = {name: value for name, value, _ in stand.leaves()}
    assert leaves["motor.slider.mass"] == 1e-3
    assert leaves["motor.friction.law"] == "coulomb"
    assert leaves["rod_vibrometer.noise_density"] == 1e-7
    assert leaves["rod_vibrometer.digitiser.bits"] == 12


def test_stand_names_what_it_refuses() -> None:
    with pytest.raises(UnknownKeyError, match=r"stator.*resonance"):
        StandParameters.from_mapping({"motor": {"stator": {"resonance": 1.0}}})
    with pytest.raises(BadInputError, match=r"mass.*> 0 kg"):
        StandParameters.from_mapping({"motor": {"slider": {"mass": 0.0}}})

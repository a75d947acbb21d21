"""Parameters: what is wrong is refused with its place, what is right makes the round trip."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imotor_ros.core.parameters import (
    FieldInfo,
    Parameters,
    all_leaves,
    choice,
    deciding_choice,
    group,
    parameter,
)
from imotor_ros.errors import BadInputError, UnknownKeyError


@dataclass(frozen=True)
class Spring(Parameters):
    """A group."""

    stiffness: float = parameter(10.0, "stiffness", unit="N/m", low=0.0, excludes_low=True)
    coils: int = parameter(3, "number of coils", low=1, high=20)


@dataclass(frozen=True)
class Dry(Parameters):
    """A choice without parameters of its own beside the shared one."""

    force: float = parameter(1.0, "sliding force", unit="N", low=0.0, high=100.0)


@dataclass(frozen=True)
class Wet(Parameters):
    """A choice whose `force` has another default, and that has one key more."""

    force: float = parameter(0.5, "sliding force", unit="N", low=0.0, high=100.0)
    viscosity: float = parameter(2.0, "viscosity", unit="N s/m", low=0.0)


@dataclass(frozen=True)
class Machine(Parameters):
    """One of each kind."""

    mass: float = parameter(1.0, "mass", unit="kg", low=1e-3, high=10.0)
    offset: float = parameter(0.0, "offset without bounds", unit="V")
    seed: int = parameter(1, "seed", low=0, high=2**63 - 1)
    is_open: bool = parameter(True, "whether it is open")
    label: str = parameter("", "any text")
    shape: str = parameter("round", "shape", options=("round", "square"))
    gains: tuple[float, ...] = parameter((1.0, 2.0), "gains", low=0.0, high=5.0)
    spring: Spring = group(Spring)
    friction: Dry | Wet = choice("law", "dry", {"dry": Dry, "wet": Wet})

    def check(self) -> None:
        """Refuse what only two fields together show."""
        if self.label == "light" and self.mass > 5.0:
            raise BadInputError("is too heavy", where="mass", value=self.mass, bound="<= 5 kg")


@pytest.mark.parametrize(
    ("mapping", "error", "text"),
    [
        ({"wheels": 4}, UnknownKeyError, "m.yaml: wheels: is not a parameter, expected one of "),
        ({"spring": {"colour": 1}}, UnknownKeyError, "m.yaml: spring: colour: is not a parameter"),
        ({"friction": {"magic": 1}}, UnknownKeyError, "m.yaml: friction: magic: is not"),
        (
            {"friction": {"law": "dry", "viscosity": 1.0}},
            UnknownKeyError,
            "m.yaml: friction: viscosity: is not a parameter, expected one of force",
        ),
        (
            {"mass": 11.0},
            BadInputError,
            "m.yaml: Machine.mass: is out of bounds, got 11.0, expected >= 0.001 and <= 10 kg",
        ),
        ({"mass": -1}, BadInputError, "Machine.mass: is out of bounds, got -1"),
        ({"mass": math.nan}, BadInputError, "Machine.mass: is out of bounds, got nan"),
        ({"offset": math.inf}, BadInputError, "got inf, expected a finite number V"),
        ({"mass": "heavy"}, BadInputError, "Machine.mass: is not a number, got 'heavy'"),
        ({"mass": True}, BadInputError, "Machine.mass: is not a number, got True"),
        ({"mass": None}, BadInputError, "Machine.mass: is not a number"),
        ({"mass": [1.0]}, BadInputError, "Machine.mass: is not a number"),
        ({"seed": 1.5}, BadInputError, "Machine.seed: is not a whole number, got 1.5"),
        ({"seed": -1}, BadInputError, "Machine.seed: is out of bounds, got -1"),
        ({"seed": math.inf}, BadInputError, "Machine.seed: is out of bounds, got inf"),
        ({"seed": math.nan}, BadInputError, "Machine.seed: is out of bounds, got nan"),
        ({"is_open": 1}, BadInputError, "Machine.is_open: is not a bool, got 1"),
        ({"label": 3}, BadInputError, "Machine.label: is not a str, got 3"),
        (
            {"shape": "flat"},
            BadInputError,
            "Machine.shape: is not a choice, got 'flat', expected one of round, square",
        ),
        ({"gains": 1.0}, BadInputError, "Machine.gains: is not a list of numbers, got 1.0"),
        ({"gains": "12"}, BadInputError, "Machine.gains: is not a list of numbers, got '12'"),
        ({"gains": [1.0, "x"]}, BadInputError, r"Machine.gains\[1\]: is not a number, got 'x'"),
        ({"gains": [9.0]}, BadInputError, r"Machine.gains\[0\]: is out of bounds, got 9.0"),
        (
            {"spring": {"stiffness": 0.0}},
            BadInputError,
            "m.yaml: spring: Spring.stiffness: is out of bounds, got 0.0, expected > 0 N/m",
        ),
        ({"spring": 5}, BadInputError, "m.yaml: spring: is not a mapping, got 5"),
        ({"friction": 5}, BadInputError, "m.yaml: friction: is not a mapping, got 5"),
        (
            {"friction": {"law": "sticky"}},
            BadInputError,
            "friction.law: is not a choice, got 'sticky', expected one of dry, wet",
        ),
        ({"friction": {"law": ["dry"]}}, BadInputError, "friction.law: is not a choice"),
        ({"label": "light", "mass": 6.0}, BadInputError, "m.yaml: mass: is too heavy, got 6.0"),
    ],
)
def test_bad_mapping_is_refused_with_place_value_and_bound(
    mapping: dict[str, Any], error: type[BadInputError], text: str
) -> None:
    with pytest.raises(error, match=text.replace("(", r"\(")) as caught:
        Machine.from_mapping(mapping, "m.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("mapping", [None, 3, [1], "text"])
def test_what_is_no_mapping_is_refused(mapping: Any) -> None:
    with pytest.raises(BadInputError, match=r"m\.yaml: is not a mapping"):
        Machine.from_mapping(mapping, "m.yaml")


def test_error_carries_its_parts_as_data() -> None:
    with pytest.raises(BadInputError) as caught:
        Machine(mass=11.0)
    error = caught.value
    assert isinstance(error, ValueError)
    assert (error.what, error.where, error.value) == ("is out of bounds", "Machine.mass", 11.0)
    assert error.bound == ">= 0.001 and <= 10 kg"


def test_group_of_another_class_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"Machine.spring: is of the wrong class, got 'Dry'"):
        Machine(spring=Dry())  # type: ignore[arg-type]
    with pytest.raises(BadInputError, match="got 'Spring', expected Dry or Wet"):
        Machine(friction=Spring())  # type: ignore[arg-type]


def test_bounds_themselves_are_accepted_unless_excluded() -> None:
    assert Machine(mass=1e-3, gains=(0.0, 5.0)).gains == (0.0, 5.0)
    assert Machine(seed=2**63 - 1).seed == 2**63 - 1
    with pytest.raises(BadInputError):
        Spring(stiffness=0.0)


def test_whole_numbers_serve_as_floats_and_whole_floats_as_integers() -> None:
    machine = Machine(mass=2, seed=3.0, gains=[1, 2])  # type: ignore[arg-type]
    assert type(machine.mass) is float
    assert type(machine.seed) is int
    assert machine.gains == (1.0, 2.0)
    assert all(type(gain) is float for gain in machine.gains)


def test_missing_keys_keep_defaults_and_the_default_choice() -> None:
    assert Machine.from_mapping({}) == Machine()
    assert Machine.from_mapping({"friction": {"force": 2.0}}).friction == Dry(force=2.0)
    assert Machine.from_mapping({"friction": {"law": "wet"}}).friction == Wet()


def test_replace_checks_the_copy() -> None:
    assert Machine().replace(mass=2.0).mass == 2.0
    with pytest.raises(BadInputError):
        Machine().replace(mass=20.0)


def test_bound_in_words() -> None:
    assert FieldInfo("x").bound == "a finite number"
    assert FieldInfo("x", unit="m", low=0.0, excludes_low=True).bound == "> 0 m"
    assert FieldInfo("x", high=3.0).bound == "<= 3"
    assert FieldInfo("x", options=("a", "b")).bound == "one of a, b"


# ---- leaves --------------------------------------------------------------------------------


def test_leaves_name_every_value_and_the_choice_first() -> None:
    names = [name for name, _, _ in Machine(friction=Wet()).leaves()]
    assert names == [
        "mass", "offset", "seed", "is_open", "label", "shape", "gains",
        "spring.stiffness", "spring.coils",
        "friction.law", "friction.force", "friction.viscosity",
    ]  # fmt: skip
    values = {name: value for name, value, _ in Machine(friction=Wet()).leaves("m.")}
    assert values["m.friction.law"] == "wet"
    assert values["m.friction.force"] == 0.5


def test_all_leaves_hold_those_of_every_choice_once_and_unset() -> None:
    found = {name: value for name, value, _ in all_leaves(Machine)}
    assert len(found) == len(list(all_leaves(Machine)))
    assert found["friction.law"] == "dry"
    assert found["friction.force"] is None
    assert found["friction.viscosity"] is None
    assert found["spring.stiffness"] == 10.0
    assert Machine.from_leaves(found) == Machine(), "they are the defaults"


def test_chosen_class_takes_its_own_defaults_and_others_are_left_out() -> None:
    every = {name: value for name, value, _ in all_leaves(Machine)}
    assert Machine.from_leaves({**every, "friction.law": "wet"}).friction == Wet()
    left_out = Machine.from_leaves({**every, "friction.viscosity": 9.0})
    assert left_out.friction == Dry(), "viscosity is not a parameter of dry friction"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("wheels", "Machine: wheels: is not a parameter, expected one of mass, offset"),
        ("spring", "Machine: spring: is not a parameter"),
        ("mass.unit", "Machine: mass.unit: is not a parameter"),
        ("spring.colour", "spring: colour: is not a parameter"),
        ("friction.magic", "friction: magic: is not a parameter"),
        ("spring.stiffness.unit", "is not a parameter"),
    ],
)
def test_unknown_leaf_is_refused(name: str, text: str) -> None:
    with pytest.raises(UnknownKeyError, match=text):
        Machine.from_leaves({name: 1.0})


def test_leaf_of_an_unknown_choice_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"friction\.law: is not a choice, got 'sticky'"):
        Machine.from_leaves({"friction.law": "sticky", "friction.force": 1.0})


machines = st.builds(
    Machine,
    mass=st.floats(1e-3, 10.0),
    offset=st.floats(allow_nan=False, allow_infinity=False),
    seed=st.integers(0, 2**63 - 1),
    is_open=st.booleans(),
    label=st.text(),
    shape=st.sampled_from(["round", "square"]),
    gains=st.lists(st.floats(0.0, 5.0)).map(tuple),
    spring=st.builds(Spring, stiffness=st.floats(1e-9, 1e9), coils=st.integers(1, 20)),
    friction=st.one_of(
        st.builds(Dry, force=st.floats(0.0, 100.0)),
        st.builds(Wet, force=st.floats(0.0, 100.0), viscosity=st.floats(0.0, 1e9)),
    ),
).filter(lambda machine: machine.label != "light")


@given(machines)
def test_round_trip_through_mapping_json_and_leaves(machine: Machine) -> None:
    assert Machine.from_mapping(machine.to_mapping()) == machine
    assert Machine.from_mapping(json.loads(json.dumps(machine.to_mapping()))) == machine
    leaves = {name: value for name, value, _ in machine.leaves()}
    assert Machine.from_leaves(leaves) == machine
    unset = {name: None for name, _, _ in all_leaves(Machine)}
    assert Machine.from_leaves({**unset, **leaves}) == machine, "as ROS parameters hold them"


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("15e-6", "15.0e-6"),
        ("1e3", "1.0e+3"),
        ("2.5e3", "2.5e+3"),
        ("-.5E-2", "-.5e-2"),
        ("7", "7"),
    ],
)
def test_number_that_yaml_takes_for_a_text_is_answered_with_how_to_write_it(
    text: str, written: str
) -> None:
    with pytest.raises(BadInputError, match=re.escape(f", written {written}") + "$"):
        Machine(mass=text)  # type: ignore[arg-type]


def test_default_out_of_bounds_is_refused_when_the_class_is_first_used() -> None:
    @dataclass(frozen=True)
    class Wrong(Parameters):
        mass: float = parameter(-1.0, "mass", unit="kg", low=0.0)

    with pytest.raises(BadInputError, match=r"Wrong\.mass: is out of bounds"):
        Wrong(mass=1.0)


def test_every_parameter_knows_the_choice_it_depends_on() -> None:
    found = {leaf: deciding_choice(Machine, leaf) for leaf, _, _ in all_leaves(Machine)}
    decided = {leaf for leaf, key in found.items() if key}
    assert decided == {"friction.force", "friction.viscosity"}
    assert found["friction.force"] == "friction.law"

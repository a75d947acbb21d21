"""Campaigns from YAML: what is wrong is named with its file, what is right round-trips."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path
from typing import Any

import pytest
import yaml

from imotor_ros.campaign.campaign import Campaign, campaign_from_mapping, load_campaign
from imotor_ros.campaign.point import PointParameters
from imotor_ros.core.friction import CoulombFriction
from imotor_ros.errors import BadInputError, UnknownKeyError, UnreadableFileError

PARAMS = Path(__file__).parents[2] / "params"


def write(folder: Path, text: str, name: str = "c.yaml") -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("", BadInputError, "c.yaml: is not a mapping"),
        ("[1, 2]", BadInputError, "c.yaml: is not a mapping"),
        ("nmae: x", UnknownKeyError, "c.yaml: nmae: is not a key of a campaign, expected one of"),
        ("point: [1]", BadInputError, "c.yaml: point: is not a mapping"),
        ("point: {drive: 3}", UnknownKeyError, "c.yaml: drive: is not a parameter of a point"),
        (
            "point: {drive: {hold_tiem: 1.0}}",
            UnknownKeyError,
            "c.yaml: drive.hold_tiem: is not a parameter of a point",
        ),
        (
            "point: {drive: {hold_time: -1.0}}",
            BadInputError,
            "c.yaml: drive: DriveParameters.hold_time: is out of bounds, got -1.0, expected > 0",
        ),
        (
            "point: {signal: {shape: round}}",
            BadInputError,
            "SignalParameters.shape: is not a choice, got 'round', expected one of",
        ),
        (
            "point: {stand: {motor: {friction: {law: ice}}}}",
            BadInputError,
            "friction.law: is not a choice, got 'ice', expected one of coulomb",
        ),
        ("point: {drive: {offset: }}", BadInputError, "point: drive.offset: has no value"),
        ("sweep: [1]", BadInputError, "c.yaml: sweep: is not a mapping"),
        ("sweep: {seed: 3}", BadInputError, "c.yaml: sweep: seed: is not a list of values, got 3"),
        ("sweep: {seed: []}", BadInputError, "c.yaml: sweep: seed: is not a list of values"),
        ("sweep: {sede: [1]}", UnknownKeyError, "c.yaml: sede: is not a parameter of a point"),
        ("points: 3", BadInputError, "c.yaml: points: is not a list"),
        ("points: {seed: 3}", BadInputError, "c.yaml: points: is not a list"),
        ("points: [3]", BadInputError, "c.yaml: points: is not a mapping, got 3"),
        ("points: [null]", BadInputError, "c.yaml: points: is not a mapping"),
        ("point: {seed: null}", BadInputError, "c.yaml: point: seed: has no value"),
        ("stand: [1]", BadInputError, "c.yaml: stand: is not a mapping"),
        ("stand: {sample_rate: 5.0}", BadInputError, "StandParameters.sample_rate: is out of"),
        ("name: [unclosed", UnreadableFileError, "c.yaml: does not parse: "),
        ("name: a\n\tb: c", UnreadableFileError, "c.yaml: does not parse: "),
        ("stand: nowhere.yaml", UnreadableFileError, "nowhere.yaml: No such file or directory"),
        ("seed: &a [*a]", UnknownKeyError, "c.yaml: seed: is not a key of a campaign"),
    ],
)
def test_bad_campaign_is_refused_in_one_line(
    tmp_path: Path, text: str, error: type[BadInputError], message: str
) -> None:
    with pytest.raises(error) as caught:
        load_campaign(write(tmp_path, text))
    assert message in str(caught.value)
    assert str(tmp_path) in str(caught.value), "the file is named"
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder_and_binary_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFileError, match="No such file or directory"):
        load_campaign(tmp_path / "nothing.yaml")
    with pytest.raises(UnreadableFileError, match="Is a directory"):
        load_campaign(tmp_path)
    (tmp_path / "b.yaml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(UnreadableFileError, match=r"b\.yaml: does not parse"):
        load_campaign(tmp_path / "b.yaml")


def test_campaign_without_keys_is_one_default_point() -> None:
    campaign = campaign_from_mapping({})
    assert [point.name for point in campaign.points] == ["point"]
    assert campaign.points[0].parameters == PointParameters()
    assert campaign.name == "campaign"


def test_sweep_makes_every_combination_in_order() -> None:
    campaign = campaign_from_mapping(
        {"sweep": {"signal.harmonics": [1, 2, 3], "seed": [5, 6]}, "point": {"seed": 1}}
    )
    found = [(p.parameters.signal.harmonics, p.parameters.seed) for p in campaign.points]
    assert found == [(1, 5), (1, 6), (2, 5), (2, 6), (3, 5), (3, 6)]
    assert campaign.points[3].name == "harmonics-2_seed-6"


def test_single_points_override_sweep_and_sweep_overrides_the_common_point() -> None:
    campaign = campaign_from_mapping(
        {
            "point": {"seed": 1, "drive": {"hold_time": 0.5}},
            "sweep": {"seed": [2, 3]},
            "points": [{"name": "a"}, {"name": "b", "seed": 9, "drive": {"offset": 10.0}}],
        }
    )
    assert [p.name for p in campaign.points] == ["a", "a_2", "b", "b_2"]
    assert [p.parameters.seed for p in campaign.points] == [2, 3, 9, 9]
    assert {p.parameters.drive.hold_time for p in campaign.points} == {0.5}
    assert campaign.points[2].parameters.drive.offset == 10.0


def test_names_are_fit_for_folders_and_unique() -> None:
    points = [{"name": name} for name in ("a/b c", "a-b-c", "../x", "", 7, "..", "logs")]
    names = [p.name for p in campaign_from_mapping({"points": points}).points]
    assert names == ["a-b-c", "a-b-c_2", "..-x", "point", "7", ".._2", "logs_2"]


def test_unique_names_do_not_collide_with_given_ones() -> None:
    points = [{"name": "a"}, {"name": "a"}, {"name": "a_2"}]
    names = [p.name for p in campaign_from_mapping({"points": points}).points]
    assert len(set(names)) == 3, names


def test_stand_comes_from_a_file_beside_the_campaign(tmp_path: Path) -> None:
    write(tmp_path, "block_length: 500\nmotor: {friction: {law: coulomb}}", "stand.yaml")
    path = write(tmp_path, "stand: stand.yaml\npoint: {stand: {sample_rate: 2.0e+6}}")
    stand = load_campaign(path).points[0].parameters.stand
    assert (stand.block_length, stand.sample_rate) == (500, 2e6)
    assert stand.motor.friction == CoulombFriction()


def test_point_overrides_the_stand() -> None:
    campaign = campaign_from_mapping(
        {"stand": {"block_length": 500}, "point": {"stand": {"block_length": 200}}}
    )
    assert campaign.points[0].parameters.stand.block_length == 200


def test_swept_law_takes_its_own_defaults() -> None:
    """The stand of the demonstration gives a slope, which Coulomb friction does not have."""
    mapping = {
        "stand": {"motor": {"friction": {"law": "velocity", "slope": 3.0}}},
        "sweep": {"stand.motor.friction.law": ["coulomb", "velocity"]},
    }
    found = [p.parameters.stand.motor.friction for p in campaign_from_mapping(mapping).points]
    assert found[0] == CoulombFriction()
    assert found[1].slope == 3.0  # type: ignore[union-attr]


def test_campaign_round_trips_through_json() -> None:
    campaign = campaign_from_mapping(
        {
            "name": "n",
            "description": "d",
            "point": {"stand": {"motor": {"friction": {"law": "stribeck"}}}},
            "sweep": {"signal.harmonics": [1, 2], "drive.hold_time": [0.1, 1 / 3]},
        }
    )
    again = campaign_from_mapping(json.loads(json.dumps(campaign.to_mapping())))
    assert again == campaign
    assert campaign_from_mapping(yaml.safe_load(yaml.safe_dump(campaign.to_mapping()))) == campaign


# ---- the files of the project --------------------------------------------------------------


@pytest.mark.parametrize("path", sorted(PARAMS.glob("campaigns/*.yaml")), ids=lambda p: p.stem)
def test_campaigns_of_the_project_load(path: Path) -> None:
    campaign = load_campaign(path)
    assert isinstance(campaign, Campaign)
    assert campaign.description
    assert campaign.points


def test_every_parameter_file_lies_in_a_folder_that_a_test_reads() -> None:
    """
    A new kind needs a test.

    Campaigns are read here, motors and stands in test/core/test_stand.py, what belongs to a bench
    of instruments in test/nodes/scpi/test_files.py.
    """
    known = {"campaigns", "motors", "stands", "benches", "dialects", "laboratories"}
    files = [path for path in PARAMS.rglob("*") if path.is_file()]
    strange = [p for p in files if p.suffix == ".yaml" and p.parent.name not in known]
    assert not strange
    assert files


LAW = "stand.motor.friction"


def test_anything_can_be_swept() -> None:
    """Motor, friction, load, signal and instruments, one or several at once."""
    swept: dict[str, list[Any]] = {
        "stand.motor.slider.mass": [5e-3, 7e-3],
        f"{LAW}.slope": [0.0, 2.2],
        "stand.motor.load.spring_stiffness": [0.0, 1e3],
        "signal.maximum_frequency": [9250.0, 12e3],
        "stand.slider_vibrometer.noise_density": [0.0, 1e-6],
    }
    points = campaign_from_mapping({"sweep": swept}).points
    found = [{name: value for name, value, _ in one.parameters.leaves()} for one in points]
    assert len({tuple(leaves[name] for name in swept) for leaves in found}) == 2**5
    assert len({one.name for one in points}) == 2**5


def test_law_of_a_later_layer_leaves_the_parameters_of_the_earlier_one_behind() -> None:
    mapping = {
        "stand": {"motor": {"friction": {"law": "velocity", "slope": 3.0}}},
        "sweep": {f"{LAW}.law": ["velocity", "coulomb", "stribeck"]},
    }
    laws = [one.parameters.stand.motor.friction for one in campaign_from_mapping(mapping).points]
    assert [type(law).__name__ for law in laws] == [
        "VelocityDependentFriction", "CoulombFriction", "StribeckFriction",
    ]  # fmt: skip
    assert [getattr(law, "slope", None) for law in laws] == [3.0, None, 3.0]


@pytest.mark.parametrize(
    ("mapping", "text"),
    [
        ({"point": {f"{LAW}.law": "coulomb", f"{LAW}.slope": 1.0}}, f"{LAW}.slope: is not a param"),
        ({"point": {f"{LAW}.decay_velocity": 1e-3}}, f"{LAW}.law = velocity, expected one of"),
        ({"point": {f"{LAW}.law": "coulomb"}, "sweep": {f"{LAW}.slope": [1.0, 2.0]}}, "= coulomb"),
        ({"sweep": {f"{LAW}.slope": [1.0, 2.0]}, "points": [{f"{LAW}.law": "coulomb"}]}, "slope"),
        ({"points": [{f"{LAW}.law": "coulomb"}, {f"{LAW}.slope": 1.0, f"{LAW}.law": "coulomb"}]},
         "sliding_force"),
        ({"name": [1, 2]}, "campaign: name: is not a text, got"),
        ({"description": True}, "campaign: description: is not a text, got True"),
        ({"points": []}, r"campaign: points: is not a list of points, got \[\]"),
        ({"points": None}, "campaign: points: is not a list of points"),
        ({"points": [{"name": [1, 2]}]}, "campaign: name: is not a text"),
        ({"sweep": None}, "campaign: sweep: is not a mapping of lists"),
        ({"point": {"signal.stroke": "15e-6"}}, r"> 0 and <= 0.001 m, written 15.0e-6$"),
    ],
)  # fmt: skip
def test_what_would_silently_be_something_else_is_refused(
    mapping: dict[str, Any], text: str
) -> None:
    with pytest.raises(BadInputError, match=text):
        campaign_from_mapping(mapping)


def test_campaign_of_the_documentation_has_as_many_runs_as_it_says(tmp_path: Path) -> None:
    text = (PARAMS.parent / "docs" / "campaigns.md").read_text(encoding="utf-8")
    block = next(part for part in text.split("\n\n") if part.startswith("    name: "))
    (tmp_path / "stands").mkdir()
    stand = (PARAMS / "stands" / "paper.yaml").read_text(encoding="utf-8")
    write(tmp_path / "stands", stand, "paper.yaml")
    (tmp_path / "campaigns").mkdir()
    campaign = load_campaign(write(tmp_path / "campaigns", textwrap.dedent(block)))
    assert "= 72 runs" in text
    assert len(campaign.points) == 72

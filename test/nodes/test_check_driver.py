"""
The check of drivers, on the drivers of this repository: each passes all that applies to it.

Drivers that are wrong are in test_conformance.py as records, and as nodes in the mutants' tests.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from imotor_ros.campaign.conformance.requirements import Result, Verdict
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.cli.main import main
from imotor_ros.errors import BadInputError
from imotor_ros.nodes.driver_nodes import find_driver

Check = Callable[..., dict[str, Result]]


def verdicts(results: dict[str, Result], verdict: Verdict) -> dict[str, str]:
    """Return the evidence of all requirements with a verdict."""
    return {name: one.evidence for name, one in results.items() if one.verdict is verdict}


def test_virtual_stand_passes(check_driver: Check) -> None:
    results = check_driver("virtual")
    assert verdicts(results, Verdict.FAIL) == {}
    assert verdicts(results, Verdict.NOT_APPLICABLE) == {
        "L4": "the driver was to be started once only",
        "S3": "the driver plays block by block: see S2",
    }


def test_player_passes_what_applies_to_a_recorded_run(
    check_driver: Check, recorded: RunPlan
) -> None:
    results = check_driver("player", path=str(recorded.bag_path.absolute()))
    assert verdicts(results, Verdict.FAIL) == {}
    passed = " ".join(verdicts(results, Verdict.PASS))
    assert passed == "I1 I2 I3 L1 L2 L3 L4 L6 C1 C2 C3 D1 D2 D3 D4 D5 F1 F2 F3 F5 V1 A1"
    assert "recorded run" in results["S5"].evidence


def test_template_passes(check_driver: Check) -> None:
    results = check_driver("template_driver", lives=2)
    assert verdicts(results, Verdict.FAIL) == {}
    assert list(verdicts(results, Verdict.NOT_APPLICABLE)) == ["S3"]


def test_program_that_is_no_driver_fails_by_how_it_ended(
    namespace: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    junit = tmp_path / "report.xml"
    arguments = ["/bin/false", "--namespace", namespace, "--json", "--junit", str(junit)]
    assert main(["check-driver", *arguments]) == 1
    content = json.loads(capsys.readouterr().out)
    assert (content["driver"], content["passed"]) == ("/bin/false", False)
    failed = {one["id"]: one for one in content["requirements"] if one["verdict"] == "fail"}
    assert list(failed) == ["L1"]
    assert "node driver ended during the run (exit code 1)" in failed["L1"]["evidence"]
    unreached = {one["evidence"] for one in content["requirements"] if one["id"] != "L1"}
    assert unreached == {"not reached: node driver ended during the run (exit code 1)"}
    suite = ElementTree.parse(junit).getroot().find("testsuite")
    assert suite is not None
    assert suite.get("failures") == "1"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "needs either a driver or --running"),
        (["virtual", "--running"], "needs either a driver or --running"),
        (["--running", "--params", "x.yaml"], "--params: is for a driver that is started"),
        (["--running"], "holds no node with a lifecycle"),
        (["nothere"], "package imotor_ros: no such executable, got 'nothere'"),
        (["no_package/driver"], "package no_package: is not installed"),
        (["./setup.cfg"], "driver: cannot be executed, got './setup.cfg'"),
        (["virtual", "--params", "x.yaml"], "--params: no such file, got 'x.yaml'"),
        (["virtual", "--junit", "nowhere/x.xml"], "--junit: no such folder, got 'nowhere'"),
        (["virtual", "--voltage-range", "0", "40"], "reaches beyond the range, got 54.0"),
        (["virtual", "--without", "rod"], "argument --without: invalid choice: 'rod'"),
    ],
)
def test_bad_input_is_refused(
    namespace: str, arguments: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check-driver", *arguments, "--namespace", namespace]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert text in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    "text",
    [
        "my_rig:\n  ros__parameters: {block_length: 7, motor: {rate: 2.0}}",
        "/stand/driver:\n  ros__parameters: {block_length: 7, motor.rate: 2.0}",
        "ros__parameters: {block_length: 7, motor: {rate: 2.0}}",
        "{block_length: 7, motor: {rate: 2.0}}",
        "{block_length: 7, motor.rate: 2.0}",
    ],
)
def test_parameters_reach_the_driver_under_any_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(text)
    (file,) = find_driver("/bin/false", path)
    option, written = file.arguments_with_parameters(tmp_path / "logs")
    assert option == "--params-file"
    assert yaml.safe_load(Path(written).read_text()) == {
        "/**": {"ros__parameters": {"block_length": 7, "motor.rate": 2.0}}
    }


@pytest.mark.parametrize(
    ("driver", "text", "error"),
    [
        ("/bin/false", "a: [1", "does not parse"),
        ("/bin/false", "just text", "is not a mapping"),
        ("/bin/false", "{a: {ros__parameters: {x: 1}}, b: {x: 2}}", "of several nodes"),
        ("/bin/false", "{space: {a: {ros__parameters: {x: 1}}}}", "more than the name of one"),
        ("virtual", "a: [1", "does not parse"),
        ("virtual", "{block_length: 7}", "names no node of the virtual driver"),
        ("virtual", "{rig: {ros__parameters: {x: 1}}}", "virtual driver, got 'rig'"),
    ],
)
def test_parameters_that_no_node_would_take_are_refused(
    tmp_path: Path, driver: str, text: str, error: str
) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(text)
    with pytest.raises(BadInputError, match=error):
        find_driver(driver, path)


@pytest.mark.parametrize("name", ["/**", "plant", "/stand/force_sensor"])
def test_file_for_the_virtual_driver_is_passed_as_it_is(tmp_path: Path, name: str) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(f"{name}: {{ros__parameters: {{x: 1}}}}")
    for file in find_driver("virtual", path):
        assert file.arguments_with_parameters(tmp_path) == ("--params-file", str(path))


def test_driver_that_cannot_configure_fails_with_its_reason(check_driver: Check) -> None:
    results = check_driver("player", path="/nowhere/bag")
    failed = verdicts(results, Verdict.FAIL)
    assert list(failed) == ["L2"]
    assert "/diagnostics: cannot configure: /nowhere/bag: does not exist" in failed["L2"]

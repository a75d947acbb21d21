"""What the set-up looks for on a machine, and the variables it sets."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from bootstrap import environment, interpreters, verbs
from bootstrap.errors import SetupError
from bootstrap.layout import SOURCED, WHEELS, Layout, find_layout


def test_missing_compiler_is_named(link_programs):
    path = link_programs("sh")
    with pytest.raises(SetupError, match=r"no C compiler: looked for cc, gcc, clang on PATH"):
        interpreters.require_compilers({"PATH": str(path)})


def test_missing_cxx_compiler_is_named(link_programs):
    path = link_programs("sh")
    (path / "cc").symlink_to(path / "sh")
    with pytest.raises(SetupError, match=r"no C\+\+ compiler: looked for c\+\+, g\+\+"):
        interpreters.require_compilers({"PATH": str(path)})
    with pytest.raises(SetupError, match=r"no C\+\+ compiler: looked for special-c\+\+"):
        interpreters.require_compilers({"PATH": str(path), "CXX": "special-c++ -m64"})


def test_unsuitable_python_is_named_with_its_fault(tmp_path):
    python = tmp_path / "python3"
    answer = {
        "executable": "/usr/bin/python3.13",
        "version": "3.13",
        "implementation": "CPython",
        "machine": "x86_64",
        "venv": True,
        "headers": True,
    }
    python.write_text(f"#!/bin/sh\necho '{json.dumps(answer)}'\n")
    python.chmod(0o755)
    with pytest.raises(
        SetupError, match=r"CPython 3\.11 or 3\.12 .*python3\.13 \(is CPython 3\.13"
    ):
        interpreters.find_interpreter(Layout(WHEELS), os.environ, str(python), "")


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({}, ""),
        ({"implementation": "PyPy"}, "is PyPy 3.11"),
        ({"machine": "aarch64"}, "is for aarch64"),
        ({"venv": False}, "apt install python3.11-venv"),
        ({"headers": False}, "apt install python3.11-dev"),
    ],
)
def test_faults_of_a_python(change, fault):
    good = {
        "version": "3.11",
        "implementation": "CPython",
        "machine": "x86_64",
        "venv": True,
        "headers": True,
    }
    found = interpreters.find_fault({**good, **change})
    assert fault in found
    assert bool(found) == bool(fault)


def test_recorded_python_is_kept(tmp_path):
    recorded = interpreters.probe(sys.executable, os.environ)["executable"]
    found = interpreters.find_interpreter(Layout(WHEELS), {"PATH": str(tmp_path)}, "", recorded)
    assert found.executable == recorded


def test_sourced_jazzy_is_used(tmp_path):
    (tmp_path / "rclpy").mkdir()
    environ = {"ROS_DISTRO": "jazzy", "PYTHONPATH": f"/elsewhere:{tmp_path}"}
    layout = find_layout(environ)
    assert (layout.kind, layout.ros_modules) == (SOURCED, str(tmp_path))


@pytest.mark.parametrize("distribution", ["humble", "rolling", ""])
def test_other_distributions_are_not_used(tmp_path, distribution):
    (tmp_path / "rclpy").mkdir()
    environ = {"ROS_DISTRO": distribution, "PYTHONPATH": str(tmp_path)}
    assert find_layout(environ).kind == WHEELS


def test_jazzy_without_rclpy_is_not_used(tmp_path):
    assert find_layout({"ROS_DISTRO": "jazzy", "PYTHONPATH": str(tmp_path)}).kind == WHEELS


def test_variables_of_the_user_are_kept():
    users = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "NUMBA_CACHE_DIR": "/cache",
        "AMENT_PREFIX_PATH": "/theirs",
        "LD_LIBRARY_PATH": "/libraries",
    }
    changed = environment.changed_variables(Layout(WHEELS), "3.11", users)
    assert "ROS_AUTOMATIC_DISCOVERY_RANGE" not in changed
    assert "NUMBA_CACHE_DIR" not in changed
    assert changed["AMENT_PREFIX_PATH"].endswith(":/theirs")
    assert changed["LD_LIBRARY_PATH"].endswith(":/libraries")
    assert changed["ROS_PYTHON_CHECK_FIELDS"] == "1"


def test_variables_do_not_grow_when_set_twice():
    layout = Layout(WHEELS)
    environ = {"PYTHONPATH": "/theirs"}
    environ.update(environment.changed_variables(layout, "3.11", environ))
    assert environment.is_active(layout, environ)
    again = environment.changed_variables(layout, "3.11", environ)
    assert {**environ, **again} == environ


def test_middleware_without_a_wheel_is_replaced():
    environ = {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}
    wheels = environment.changed_variables(Layout(WHEELS), "3.11", environ)
    sourced = environment.changed_variables(Layout(SOURCED), "3.12", environ)
    assert wheels["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"
    assert "RMW_IMPLEMENTATION" not in sourced


def test_shell_env_can_be_evaluated(capsys):
    awkward = {"AMENT_PREFIX_PATH": "/a folder/with 'quotes'"}
    layout = Layout(WHEELS)
    assert verbs.run(["shell-env"], layout, awkward) == 0
    shown = 'printf "%s\\n%s" "$AMENT_PREFIX_PATH" "$PATH"'
    answer = subprocess.run(
        ["sh", "-c", capsys.readouterr().out + shown], check=True, capture_output=True, text=True
    )
    prefix, path = answer.stdout.split("\n")
    assert prefix == awkward["AMENT_PREFIX_PATH"]
    assert path.split(":")[0] == str(Path(layout.venv, "bin"))

"""The `imotor` command itself, and what a set-up leaves for ROS tools."""

import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

from bootstrap import steps
from bootstrap.layout import SOURCED, find_layout

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def checkout(tmp_path):
    """A checkout in a folder with a space, whose bootstrap prints how it was called."""
    root = tmp_path / "a checkout"
    (root / "bootstrap").mkdir(parents=True)
    shutil.copy(ROOT / "imotor", root)
    (root / "bootstrap" / "__main__.py").write_text(
        "import json, sys; print(json.dumps([__file__, *sys.argv[1:]]))"
    )
    return root


def test_launcher_passes_arguments_from_any_folder_and_through_a_link(checkout, tmp_path):
    link = tmp_path / "link"
    link.symlink_to(checkout / "imotor")
    answer = subprocess.run(
        [link, "run", "two words", "--json"], cwd="/", check=True, capture_output=True
    )
    assert json.loads(answer.stdout) == [
        str(checkout / "bootstrap" / "__main__.py"),
        "run",
        "two words",
        "--json",
    ]


def test_launcher_uses_the_environments_python_first(checkout):
    python = checkout / ".imotor" / "wheels" / "venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text('#!/bin/sh\n[ "$3" = -c ] || echo the environment\n')
    python.chmod(0o755)
    answer = subprocess.run([checkout / "imotor"], check=True, capture_output=True, text=True)
    assert answer.stdout == "the environment\n"


def test_launcher_survives_an_environment_whose_python_vanished(checkout):
    python = checkout / ".imotor" / "wheels" / "venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.symlink_to("/nowhere/python3.11")
    environ = {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.defpath])}
    subprocess.run([checkout / "imotor"], check=True, capture_output=True, env=environ)


def test_launcher_says_that_python_is_missing(checkout, link_programs):
    path = link_programs("sh", "dirname", "readlink")
    answer = subprocess.run(
        [checkout / "imotor"], env={"PATH": str(path)}, capture_output=True, text=True
    )
    assert answer.returncode == 1
    assert answer.stdout == ""
    assert answer.stderr.startswith("imotor: no Python found: looked for python3")


def test_executables_are_found_as_ros2_run_finds_them():
    folder = Path(get_package_prefix("imotor_ros"), "lib", "imotor_ros")
    wanted = {
        point.name
        for point in entry_points(group="console_scripts")
        if point.value.startswith("imotor_ros.")
    }
    assert "plant" in wanted
    assert {path.name for path in folder.iterdir()} == wanted
    assert all(os.access(path, os.X_OK) for path in folder.iterdir())


def test_environment_python_starts_from_a_bare_shell():
    query = "import os, rclpy, imotor_msgs.msg; print(os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'])"
    layout = find_layout(os.environ)
    if layout.kind == SOURCED:
        pytest.skip("a sourced ROS has to be sourced")
    answer = subprocess.run(
        [layout.venv_python, "-c", query], env={}, check=True, capture_output=True, text=True
    )
    assert answer.stdout == "LOCALHOST\n"


def test_colcon_installs_the_package(tmp_path):
    command = [
        "colcon",
        "--log-base",
        tmp_path / "log",
        "build",
        "--build-base",
        tmp_path / "build",
    ]
    command += ["--install-base", tmp_path / "install", "--base-paths", "."]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    subprocess.run(
        command, cwd=ROOT, env={**os.environ, "PATH": path}, check=True, capture_output=True
    )
    prefix = tmp_path / "install" / "imotor_ros"
    assert os.access(prefix / "lib" / "imotor_ros" / "plant", os.X_OK)
    index = prefix / "share" / "ament_index" / "resource_index" / "packages" / "imotor_ros"
    assert index.is_file()
    sources = sorted(path.relative_to(ROOT) for path in ROOT.glob("params/**/*.yaml"))
    share = prefix / "share" / "imotor_ros"
    assert sorted(path.relative_to(share) for path in share.glob("params/**/*.yaml")) == sources
    assert (share / "launch" / "stand.launch.py").is_file()


def test_start_script_works_where_the_path_has_a_space(tmp_path):
    python = tmp_path / "a folder" / "python"
    python.parent.mkdir()
    python.symlink_to(sys.executable)
    script = tmp_path / "script"
    script.write_text(steps.start_script(str(python), "platform:machine"))
    script.chmod(0o755)
    answer = subprocess.run([script], capture_output=True, text=True, env={})
    assert (answer.returncode, answer.stderr) == (1, "x86_64\n")

"""Which steps a start does again, after a change and after a kill."""

import os
import shutil
import sys
from pathlib import Path
from typing import ClassVar

import pytest

from bootstrap import installation, requirements, state
from bootstrap.errors import SetupError
from bootstrap.layout import WHEELS, Layout

ROOT = Path(__file__).resolve().parents[2]


def test_every_package_is_pinned_to_one_version():
    """Two extras may need the same package; nobody has two versions of it."""
    sections = requirements.read_sections(str(ROOT))
    assert set(sections) >= {"installer", "run", "ros", "build", "test", "bench"}
    sections.pop("numpy-of-ros")
    for pins in sections.values():
        assert len({pin.split("==")[0].lower() for pin in pins}) == len(pins)
    pinned = {pin.lower() for pins in sections.values() for pin in pins}
    names = [pin.split("==")[0] for pin in pinned]
    assert sorted(names) == sorted(set(names))
    needed_always = {pin.lower() for pin in sections["run"]}
    for extra in ("test", "bench", "dask"):
        assert not needed_always & {pin.lower() for pin in sections[extra]}


def test_later_section_overrides_earlier_one():
    sections = {"run": ["numpy==2.4.6", "scipy==1.17.1"], "numpy-of-ros": ["numpy==1.26.4"]}
    assert requirements.select(sections, ["run", "numpy-of-ros"]) == [
        "numpy==1.26.4",
        "scipy==1.17.1",
    ]


@pytest.mark.parametrize("line", ["numpy>=2", "numpy", "-r other.txt"])
def test_inexact_pin_is_refused(tmp_path, line):
    (tmp_path / requirements.FILE_NAME).write_text(f"# [run]\n{line}\n")
    with pytest.raises(SetupError, match=r"requirements\.lock:2: not an exact pin"):
        requirements.read_sections(str(tmp_path))


class Recorder:
    """Stands in for the steps: writes down which ones are done, and makes what they make."""

    done: ClassVar[list[str]] = []
    fail_in = ""

    def __init__(self, layout, *_):
        self._layout = layout

    def __getattr__(self, name):
        def do(*arguments):
            self.done.append(arguments[0] if arguments else name)
            if self.fail_in == self.done[-1]:
                raise KeyboardInterrupt
            Path(self._layout.marker).parent.mkdir(parents=True, exist_ok=True)
            Path(self._layout.marker).touch()
            python = Path(self._layout.venv_python)
            python.parent.mkdir(parents=True, exist_ok=True)
            python.unlink(missing_ok=True)
            python.symlink_to(os.path.realpath(sys.executable))

        return do

    def pins(self):
        return (Path(self._layout.root) / "requirements.lock").read_text().split()

    def pins_of(self, section):
        return [f"{section}-tool==1"]


ALL = ["install_packages", "build_interfaces", "link_package", "compile_kernels"]


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A checkout with just what a set-up reads."""
    (tmp_path / "msg_defs" / "msg").mkdir(parents=True)
    (tmp_path / "msg_defs" / "msg" / "A.msg").write_text("int8 a\n")
    (tmp_path / "imotor_ros" / "core").mkdir(parents=True)
    (tmp_path / "imotor_ros" / "core" / "compilation.py").write_text("# kernels\n")
    (tmp_path / "setup.py").write_text("# entry points\n")
    (tmp_path / "requirements.lock").write_text("numpy==1\n")
    monkeypatch.setattr(installation, "Steps", Recorder)
    monkeypatch.setattr(installation, "NEEDED_SPACE", 0)
    monkeypatch.setattr(os, "sync", lambda: None)
    monkeypatch.setattr(Recorder, "done", [])
    monkeypatch.setattr(Recorder, "fail_in", "")
    return Layout(WHEELS, root=str(tmp_path))


def start(layout, *extras):
    """Return the steps that a start does."""
    Recorder.done.clear()
    if not state.State.read(layout.state_file).is_current(layout, extras):
        installation.run(layout, extras, "")
    return list(Recorder.done)


def test_second_start_does_nothing(project):
    assert start(project) == ALL
    assert start(project) == []


def test_touched_file_is_compared_by_content_once(project):
    start(project)
    setup = Path(project.root, "setup.py")
    os.utime(setup, (1, 1))
    assert not state.State.read(project.state_file).is_current(project)
    assert start(project) == []
    assert state.State.read(project.state_file).is_current(project)


@pytest.mark.parametrize(
    ("file", "again"),
    [
        ("setup.py", ALL[2:3]),
        ("msg_defs/msg/A.msg", ALL[1:3]),
        ("msg_defs/msg/New.msg", ALL[1:3]),
        ("imotor_ros/core/compilation.py", ALL[3:]),
        ("imotor_ros/core/slider.py", []),
        ("requirements.lock", ALL),
    ],
)
def test_changed_file_repeats_what_depends_on_it(project, file, again):
    start(project)
    Path(project.root, file).write_text("changed==2\n")
    assert start(project) == again
    assert start(project) == []


def test_extra_packages_are_installed_on_demand(project):
    assert start(project) == ALL
    assert start(project, "test") == ["test"]
    assert start(project, "test") == []
    assert start(project) == []


def test_killed_step_is_done_again(project):
    Recorder.fail_in = "build_interfaces"
    with pytest.raises(KeyboardInterrupt):
        start(project)
    Recorder.fail_in = ""
    assert start(project) == ALL[1:]


def test_killed_installation_of_extras_makes_the_environment_anew(project):
    start(project)
    Recorder.fail_in = "test"
    with pytest.raises(KeyboardInterrupt):
        start(project, "test")
    Recorder.fail_in = ""
    assert start(project) == ALL


def test_vanished_python_makes_the_environment_anew(project):
    start(project)
    python = Path(project.venv_python)
    python.unlink()
    python.symlink_to("/nowhere/python3.11")
    assert start(project) == ALL


def test_removed_overlay_is_made_again(project):
    start(project)
    shutil.rmtree(project.overlay)
    assert start(project) == ALL[1:3]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"steps": {}}'])
def test_damaged_record_counts_as_none(tmp_path, text):
    path = tmp_path / "state.json"
    path.write_text(text)
    assert state.State.read(str(path)).steps == {}


def test_failed_setup_says_why_in_one_line(project, monkeypatch, capsys):
    monkeypatch.setattr(installation, "NEEDED_SPACE", 1e18)
    assert installation.run(project, (), "") == ""
    assert "imotor: set-up stopped: the disk is full" in capsys.readouterr().err

"""What was set up, from which input: compared at every start, by file times first."""

from __future__ import annotations

import json
import os

from bootstrap.layout import Layout

# What a set-up depends on; the sources in imotor_ros/ are used in place and are not among it.
INPUT_FILES = (
    "requirements.lock",
    "setup.py",
    "setup.cfg",
    "package.xml",
    os.path.join("resource", "imotor_ros"),
    os.path.join("imotor_ros", "core", "compilation.py"),
)
INPUT_FOLDERS = ("bootstrap", "msg_defs")


STEPS = ("packages", "interfaces", "links", "kernels")
"""What every verb needs, in the order in which it is done."""


class State:
    """
    The record of one environment, kept in its `state.json`.

    Attributes
    ----------
    interpreter : str
        Real path of the Python the virtual environment was made from.
    version : str
        Its version, such as "3.11".
    ros_modules : str
        Folder of a sourced ROS installation's Python modules, "" with wheels.
    steps : dict of str to str
        Finished step to a hash of what it was done with.
    running : str
        The step that is being done, still set after a kill.
    stamps : dict of str to list
        Input file to size and modification time when the steps were last compared.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self.interpreter = ""
        self.version = ""
        self.ros_modules = ""
        self.steps: dict[str, str] = {}
        self.running = ""
        self.stamps: dict[str, list[int]] = {}

    @classmethod
    def read(cls, path: str) -> State:
        """Return the record, an empty one where the file is missing or damaged."""
        state = cls(path)
        try:
            with open(path, encoding="utf-8") as file:
                record = json.load(file)
            state.interpreter = record["interpreter"]
            state.version = record["version"]
            state.ros_modules = record["ros_modules"]
            state.steps = record["steps"]
            state.running = record["running"]
            state.stamps = record["stamps"]
        except (OSError, ValueError, KeyError, TypeError):
            return cls(path)
        return state

    def write(self) -> None:
        """Replace the file in one step, on the disk when this returns."""
        record = {
            "interpreter": self.interpreter,
            "version": self.version,
            "ros_modules": self.ros_modules,
            "steps": self.steps,
            "running": self.running,
            "stamps": self.stamps,
        }
        temporary = self._path + ".new"
        with open(temporary, "w", encoding="utf-8") as file:
            json.dump(record, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, self._path)

    def is_current(self, layout: Layout, extras: tuple[str, ...] = ()) -> bool:
        """
        Return whether nothing has changed since the last set-up, going by file times alone.

        Parameters
        ----------
        layout : Layout
            The environment.
        extras : tuple of str
            Sections of the lock file wanted beside the usual ones.
        """
        return (
            not self.running
            and all(step in self.steps for step in STEPS)
            and all(extra in self.steps for extra in extras)
            and self.ros_modules == layout.ros_modules
            and os.path.realpath(layout.venv_python) == self.interpreter
            and os.path.exists(self.interpreter)
            and os.path.exists(layout.marker)
            and self.stamps == take_stamps(layout.root)
        )


def take_stamps(root: str) -> dict[str, list[int]]:
    """Return size and modification time (ns) of every input file that exists."""
    stamps = {}
    for name in input_files(root):
        status = os.stat(os.path.join(root, name))
        stamps[name] = [status.st_size, status.st_mtime_ns]
    return stamps


def input_files(root: str) -> list[str]:
    """Return the input files that exist, relative to the checkout."""
    names = [name for name in INPUT_FILES if os.path.isfile(os.path.join(root, name))]
    for folder in INPUT_FOLDERS:
        names += files_under(root, folder)
    return names


def files_under(root: str, folder: str) -> list[str]:
    """Return all files under a folder of the checkout, sorted, without hidden and cache ones."""
    found = []
    for path, folders, files in os.walk(os.path.join(root, folder)):
        folders[:] = [name for name in folders if not name.startswith((".", "__pycache__"))]
        found += [
            os.path.relpath(os.path.join(path, name), root)
            for name in files
            if not name.startswith(".")
        ]
    return sorted(found)

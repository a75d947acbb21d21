"""The nodes of a driver: which processes they are, and how to start and end them."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from imotor_ros.campaign.campaign import read_yaml
from imotor_ros.campaign.driver import Driver
from imotor_ros.contracts import graph
from imotor_ros.contracts.graph import DRIVER_NAME, Role
from imotor_ros.errors import BadInputError
from imotor_ros.nodes.process import NodeProcess, find_executable, stop_processes

VIRTUAL = "virtual"
"""Name that stands for the virtual motor with its instruments."""

VIRTUAL_DRIVER = (
    graph.PLANT,
    graph.ROD_VIBROMETER,
    graph.SLIDER_VIBROMETER,
    graph.FORCE_SENSOR,
)

_ROS_KEY = "ros__parameters"


@dataclass(frozen=True)
class DriverProgramFile:
    """
    One node of a driver.

    Attributes
    ----------
    path : Path
        File to execute.
    role : Role
        Its name and remappings.
    arguments : tuple of str
        Further arguments of its command line.
    parameters : mapping
        Values of its parameters by dotted name; the others keep what the node has.

    """

    path: Path
    role: Role
    arguments: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def arguments_with_parameters(self, folder: Path) -> tuple[str, ...]:
        """Return the arguments; the parameters are written to a file in a folder."""
        if not self.parameters:
            return self.arguments
        path = folder.absolute() / f"{self.role.name}-parameters.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        content = {"/**": {_ROS_KEY: dict(self.parameters)}}
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return (*self.arguments, "--params-file", str(path))


def find_driver(name: str, parameter_file: Path | None = None) -> tuple[DriverProgramFile, ...]:
    """
    Return what has to be started for a driver.

    Parameters
    ----------
    name : str
        "virtual", an executable of imotor_ros, "package/executable", or the path of a file.
    parameter_file : Path, optional
        Parameters of its node, as a campaign takes them: nested, with dotted names, or a ROS
        parameter file for one node of any name. For "virtual", a ROS parameter file.

    Raises
    ------
    BadInputError
        If there is no such driver, no such file, or no node that would take what it has.

    """
    content: Any = None
    if parameter_file is not None:
        if not parameter_file.is_file():
            raise BadInputError("no such file", where="--params", value=str(parameter_file))
        content = read_yaml(parameter_file)
    if name == VIRTUAL:
        arguments: tuple[str, ...] = ()
        if parameter_file is not None:
            _check_names(content, f"--params {parameter_file}")
            arguments = ("--params-file", str(parameter_file.absolute()))
        return tuple(
            DriverProgramFile(find_executable(role.executable), role, arguments)
            for role in VIRTUAL_DRIVER
        )
    path = Path(name)
    is_path = path.is_absolute() or name.startswith(".") or path.is_file()
    if is_path and not os.access(path, os.X_OK):
        raise BadInputError("cannot be executed", where="driver", value=name)
    path = path.absolute() if is_path else find_executable(name)
    parameters = _parameters_of_one(content, f"--params {parameter_file}")
    return (DriverProgramFile(path, Role(name, DRIVER_NAME), parameters=parameters),)


def _parameters_of_one(content: Any, where: str) -> Mapping[str, Any]:
    """Return the parameters by dotted name that a campaign would take from the same file."""
    mapping = {"driver": DRIVER_NAME, "driver_parameters": content}
    parameters = Driver.from_mapping(mapping, where).parameters
    for name in parameters:
        if _ROS_KEY in name.split("."):
            raise BadInputError(
                "is below more than the name of one node", where=where, value=name,
                bound=f"NODE: {_ROS_KEY}: ...",
            )  # fmt: skip
    return parameters


def _check_names(content: Any, where: str) -> None:
    """Refuse a file of which no node of the virtual driver would take anything."""
    found = list(_node_names(content))
    own = [role.name for role in VIRTUAL_DRIVER]
    if not any(name.rpartition("/")[2] in (*own, "*", "**") for name in found):
        raise BadInputError(
            "names no node of the virtual driver", where=where,
            value=", ".join(found) or "no name of a node", bound="one of " + ", ".join(own),
        )  # fmt: skip


def _node_names(content: Any, prefix: str = "") -> Iterator[str]:
    """Yield the names, with namespaces, below which a ROS parameter file has parameters."""
    if not isinstance(content, Mapping):
        return
    for key, value in content.items():
        if key == _ROS_KEY and prefix:
            yield prefix
        else:
            yield from _node_names(value, f"{prefix}/{key}" if prefix else str(key))


class DriverProcesses:
    """
    The processes of a driver.

    Parameters
    ----------
    files : tuple of DriverProgramFile
        What to start.
    namespace : str
        Namespace of the nodes.
    log_directory : Path
        Folder for their logs.

    """

    def __init__(
        self, files: tuple[DriverProgramFile, ...], namespace: str, log_directory: Path
    ) -> None:
        self.names = [one.role.name for one in files]
        self._processes = [
            NodeProcess(
                one.path,
                one.role.name,
                namespace,
                log_directory / f"{one.role.name}.log",
                one.role.remappings,
                one.arguments_with_parameters(log_directory),
            )
            for one in files
        ]

    def check(self) -> None:
        """
        Check that all are there.

        Raises
        ------
        NodeDiedError
            If one has ended.

        """
        for process in self._processes:
            process.check()

    def request_stop(self) -> None:
        """Send SIGTERM to all."""
        for process in self._processes:
            process.request_stop()

    def survivors(self, timeout: float) -> list[str]:
        """Wait for all to end; return those that have not within the timeout (s)."""
        end = time.monotonic() + timeout
        return [process.name for process in self._processes if not process.wait(end)]

    def exit_codes(self) -> dict[str, int | None]:
        """Return the exit codes of those that have ended, None for the others."""
        return {process.name: process.exit_code for process in self._processes}

    @property
    def are_running(self) -> bool:
        """Whether at least one has not ended."""
        return any(process.is_running for process in self._processes)

    def stop(self, timeout: float) -> list[str]:
        """End all; return those that had to be killed."""
        return stop_processes(self._processes, timeout)

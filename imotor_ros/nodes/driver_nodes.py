"""The nodes of a driver: which processes they are, and how to start and end them."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

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


@dataclass(frozen=True)
class DriverProgramFile:
    """One node of a driver: its file, its role, and further arguments of its command line."""

    path: Path
    role: Role
    arguments: tuple[str, ...] = ()


def find_driver(name: str, parameter_file: Path | None = None) -> tuple[DriverProgramFile, ...]:
    """
    Return what has to be started for a driver.

    Parameters
    ----------
    name : str
        "virtual", an executable of imotor_ros, "package/executable", or the path of a file.
    parameter_file : Path, optional
        ROS parameter file for its nodes.

    Raises
    ------
    BadInputError
        If there is no such driver, or no such file.

    """
    arguments: tuple[str, ...] = ()
    if parameter_file is not None:
        if not parameter_file.is_file():
            raise BadInputError("no such file", where="--params", value=str(parameter_file))
        arguments = ("--params-file", str(parameter_file.absolute()))
    if name == VIRTUAL:
        return tuple(
            DriverProgramFile(find_executable(role.executable), role, arguments)
            for role in VIRTUAL_DRIVER
        )
    path = Path(name)
    is_path = path.is_absolute() or name.startswith(".") or path.is_file()
    if is_path and not os.access(path, os.X_OK):
        raise BadInputError("cannot be executed", where="driver", value=name)
    path = path.absolute() if is_path else find_executable(name)
    return (DriverProgramFile(path, Role(name, DRIVER_NAME), arguments),)


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
                one.arguments,
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

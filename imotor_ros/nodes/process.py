"""Nodes as processes: found and started as `ros2 run` does, watched, and stopped."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from imotor_ros.errors import BadInputError, NodeDiedError

PACKAGE = "imotor_ros"
_PR_SET_PDEATHSIG = 1


def find_executable(name: str, package: str = PACKAGE) -> Path:
    """
    Return the file that `ros2 run PACKAGE NAME` would execute.

    Parameters
    ----------
    name : str
        The executable, or "package/executable".
    package : str
        Where it is looked for if the name does not say.

    Raises
    ------
    BadInputError
        If the package or the executable is not installed.

    """
    if "/" in name:
        package, _, name = name.partition("/")
    try:
        folder = Path(get_package_prefix(package)) / "lib" / package
    except PackageNotFoundError as error:
        raise BadInputError(
            "is not installed", where=f"package {package}", bound="a package in AMENT_PREFIX_PATH"
        ) from error
    path = folder / name
    if not os.access(path, os.X_OK):
        found = sorted(p.name for p in folder.iterdir()) if folder.is_dir() else []
        raise BadInputError(
            "no such executable",
            where=f"package {package}",
            value=name,
            bound="one of " + ", ".join(found),
        )
    return path


def _die_with_parent() -> None:
    """Ask the kernel to end this process when the one that started it has gone."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


class NodeProcess:
    """
    One node, running in a process of its own.

    Parameters
    ----------
    executable : Path
        File to execute.
    name : str
        Name of the node.
    namespace : str
        Its namespace, e.g. "/stand".
    log_path : Path
        File that takes what it writes.
    remappings : mapping, optional
        Names in the executable, and what they become.
    arguments : sequence of str
        Further arguments for ROS, e.g. a parameter file.

    """

    def __init__(
        self,
        executable: Path,
        name: str,
        namespace: str,
        log_path: Path,
        remappings: Mapping[str, str] | None = None,
        arguments: Sequence[str] = (),
    ) -> None:
        self.name = name
        self.log_path = log_path
        log_path.parent.mkdir(parents=True, exist_ok=True)
        rules = {"__node": name, "__ns": namespace, **(remappings or {})}
        command = [str(executable), "--ros-args"]
        for left, right in rules.items():
            command += ["-r", f"{left}:={right}"]
        command += arguments
        with log_path.open("wb") as log:
            # a session of its own keeps a Ctrl-C at the terminal for the one who orders the stop
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code; None while the process runs, minus the signal that ended it."""
        return self._process.poll()

    @property
    def is_running(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    def check(self) -> None:
        """
        Check that the node is still there.

        Raises
        ------
        NodeDiedError
            If it has ended.

        """
        code = self._process.poll()
        if code is not None:
            raise NodeDiedError(self.name, _describe_exit(code), self.last_lines())

    def last_lines(self, count: int = 8) -> tuple[str, ...]:
        """Return the last lines of the node's log."""
        try:
            text = self.log_path.read_text(encoding="utf-8", errors="replace")
        except OSError:
            return ()
        return tuple(line for line in text.splitlines() if line.strip())[-count:]

    def request_stop(self) -> None:
        """Ask the node to finish its work and end."""
        if self.is_running:
            self._process.terminate()

    def wait(self, deadline: float) -> bool:
        """Wait for the end until `deadline` (on the monotonic clock); return whether it came."""
        try:
            self._process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            return False
        return True

    def kill(self) -> None:
        """End the process at once."""
        if self.is_running:
            self._process.kill()
            self._process.wait()


def _describe_exit(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"


def stop_processes(processes: Iterable[NodeProcess], timeout: float) -> list[str]:
    """
    Stop processes together: ask, wait, and kill those that do not listen.

    Parameters
    ----------
    processes : iterable of NodeProcess
        What to stop.
    timeout : float
        Longest wait (s) before killing.

    Returns
    -------
    list of str
        Names of those that had to be killed.

    """
    running = [process for process in processes if process.is_running]
    for process in running:
        process.request_stop()
    deadline = time.monotonic() + timeout
    stubborn = [process for process in running if not process.wait(deadline)]
    for process in stubborn:
        process.kill()
    return [process.name for process in stubborn]

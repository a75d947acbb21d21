"""The nodes of a stand as a group of processes with the client that manages them."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Self

from imotor_ros.contracts.graph import Role
from imotor_ros.contracts.topics import VOLTAGE_MONITOR
from imotor_ros.core.parameters import Parameters
from imotor_ros.nodes.namespace_claim import NamespaceClaim
from imotor_ros.nodes.process import NodeProcess, find_executable, stop_processes
from imotor_ros.nodes.stand_client import (
    ACTIVATE,
    CONFIGURE,
    DEACTIVATE,
    StandClient,
)

START_TIMEOUT = 60.0
"""Longest wait (s) for the nodes to come up, and for each of their transitions."""

STOP_TIMEOUT = 10.0
"""Longest wait (s) for the nodes to end when asked to."""


class StandProcesses:
    """
    Starts the nodes of a stand, takes them through their lifecycle, and stops them.

    Parameters
    ----------
    roles : tuple of Role
        The nodes.
    log_directory : Path
        Folder for their logs.
    namespace : str
        Namespace of the stand.

    Raises
    ------
    BadInputError
        If an executable is not installed, or another stand runs in the namespace.

    """

    def __init__(self, roles: tuple[Role, ...], log_directory: Path, namespace: str) -> None:
        self.roles = roles
        self.namespace = namespace
        self.processes: dict[str, NodeProcess] = {}
        paths = {role.executable: find_executable(role.executable) for role in roles}
        self._claim = NamespaceClaim(namespace)
        self._are_configured = False
        self._is_interrupted = False
        self._handler = self._take_interrupts()
        self.client = StandClient(namespace, self.check)
        try:
            self.client.refuse_occupied_namespace()
            self._start(paths, log_directory)
        except BaseException:
            self.stop()
            raise

    def _start(self, paths: Mapping[str, Path], log_directory: Path) -> None:
        for role in self.roles:
            log = log_directory / f"{role.name}.log"
            self.processes[role.name] = NodeProcess(
                paths[role.executable], role.name, self.namespace, log, role.remappings
            )

    @property
    def names(self) -> list[str]:
        """Names of the nodes."""
        return [role.name for role in self.roles]

    def _take_interrupts(self) -> Any:
        """
        Note a Ctrl-C, and raise it at the next check: elsewhere it could be swallowed.

        Python drops an exception that is raised in a callback, as those after a fork are.
        """
        if threading.current_thread() is not threading.main_thread():
            return None
        return signal.signal(signal.SIGINT, self._on_interrupt)

    def _on_interrupt(self, _number: int, _frame: FrameType | None) -> None:
        self._is_interrupted = True

    def _raise_interrupt(self) -> None:
        if self._is_interrupted:
            self._is_interrupted = False
            raise KeyboardInterrupt

    def check(self) -> None:
        """
        Check that every node is still there, and that nobody wants to stop.

        Raises
        ------
        NodeDiedError
            If one has ended.
        KeyboardInterrupt
            If there was a Ctrl-C since.

        """
        self._raise_interrupt()
        for process in self.processes.values():
            process.check()

    def wait(self) -> None:
        """
        Wait until all nodes can be managed.

        Raises
        ------
        DeadlineError
            If one does not come up.

        """
        self.client.wait_for_nodes(self.names, START_TIMEOUT)

    def activate(
        self,
        parameters: Mapping[str, Parameters | Mapping[str, Any]],
        names: Iterable[str] | None = None,
    ) -> None:
        """
        Give all nodes their parameters and activate them; the first time, configure them too.

        Parameters
        ----------
        parameters : mapping
            By node name: an object, or values by dotted name.
        names : iterable of str, optional
            The nodes to be activated, if not all.

        Raises
        ------
        RunError
            If one refuses or fails; with the reason.

        """
        self.client.set_parameters(dict(parameters), START_TIMEOUT)
        if not self._are_configured:
            self.client.change_state(self.names, CONFIGURE, START_TIMEOUT)
            self._are_configured = True
        self.client.change_state(names or self.names, ACTIVATE, START_TIMEOUT)

    def deactivate(self, names: Iterable[str] | None = None) -> None:
        """Deactivate all nodes, or some, so that they take parameters for another run."""
        self.client.change_state(names or self.names, DEACTIVATE, START_TIMEOUT)

    def stop_driver(self) -> None:
        """Stop what puts out the voltage first, while the others hear how it goes to zero."""
        names = (role.name for role in self.roles if VOLTAGE_MONITOR in role.publishes)
        stop_processes([self.processes[name] for name in names], STOP_TIMEOUT)

    def stop(self) -> None:
        """Stop all nodes; those that do not listen are killed."""
        stop_processes(self.processes.values(), STOP_TIMEOUT)
        self.client.close()
        self._claim.release()
        if self._handler is not None:
            signal.signal(signal.SIGINT, self._handler)
            self._handler = None
        self._raise_interrupt()

    def __enter__(self) -> Self:
        """Return the group."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop all nodes."""
        self.stop()

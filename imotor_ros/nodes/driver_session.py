"""A check of a driver from its start to its end: namespace, processes, probe."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from imotor_ros.campaign.conformance.programs import CheckParameters
from imotor_ros.campaign.conformance.record import MEASURED
from imotor_ros.contracts import graph
from imotor_ros.errors import BadInputError
from imotor_ros.nodes.driver_check import Deadlines, DriverCheck
from imotor_ros.nodes.driver_nodes import DriverProcesses, find_driver
from imotor_ros.nodes.driver_probe import DriverProbe
from imotor_ros.nodes.namespace_claim import DISCOVERY_TIME, NamespaceClaim, namespace_taken

_PEERS = (graph.SIGNAL_GENERATOR.name, graph.EVALUATOR.name, graph.RECORDER.name)


@contextmanager
def driver_check(
    driver: str | None,
    parameters: CheckParameters,
    *,
    namespace: str,
    log_directory: Path,
    streams: tuple[str, ...] = MEASURED,
    parameter_file: Path | None = None,
    deadlines: Deadlines | None = None,
    lives: int = 2,
) -> Iterator[DriverCheck]:
    """
    Make a check ready to be run; nothing is left behind.

    Parameters
    ----------
    driver : str or None
        What to start, see `find_driver`; None for the nodes that run in the namespace.
    parameters : CheckParameters
        What the check may do.
    namespace : str
        Namespace of the driver's nodes.
    log_directory : Path
        Folder for their logs.
    streams : tuple of str
        The measured streams that the driver has to have.
    parameter_file : Path, optional
        ROS parameter file for its nodes.
    deadlines : Deadlines, optional
        Longest waits.
    lives : int
        How often the driver may be started, once or twice; see `DriverCheck`.

    Raises
    ------
    BadInputError
        If there is no such driver, or the namespace does not hold what it should.

    """
    files = () if driver is None else find_driver(driver, parameter_file)
    claim = NamespaceClaim(namespace) if files else None
    probe = DriverProbe(namespace, lambda: None)
    started: list[DriverProcesses] = []

    def start() -> DriverProcesses:
        folder = log_directory / f"life-{len(started) + 1}"
        started.append(DriverProcesses(files, namespace, folder))
        return started[-1]

    try:
        found = _nodes_found(probe, namespace)
        if files:
            _refuse_occupied(found, namespace)
            nodes = [one.role.name for one in files]
        else:
            nodes = _running_nodes(probe, found, namespace)
        yield DriverCheck(
            probe, nodes, parameters,
            streams=streams, start=start if files else None, deadlines=deadlines, lives=lives,
        )  # fmt: skip
    finally:
        probe.watch = lambda: None
        for life in started:
            life.stop(1.0)
        probe.close()
        if claim is not None:
            claim.release()
        gc.collect()


def _nodes_found(probe: DriverProbe, namespace: str) -> list[str]:
    probe.spin_for(DISCOVERY_TIME)
    inside = namespace.rstrip("/")
    pairs = probe.node.get_node_names_and_namespaces()
    own = probe.node.get_name()
    return sorted(name for name, space in pairs if space.rstrip("/") == inside and name != own)


def _refuse_occupied(found: list[str], namespace: str) -> None:
    if found:
        way_out = "--running to check its nodes"
        raise namespace_taken(namespace, ", ".join(found), way_out)


def _running_nodes(probe: DriverProbe, found: list[str], namespace: str) -> list[str]:
    peers = [name for name in found if name in _PEERS]
    if peers:
        raise BadInputError(
            "holds peers of the driver, whose part the check plays",
            where=f"namespace {namespace}", value=", ".join(peers), bound="a driver alone",
        )  # fmt: skip
    nodes = [name for name in probe.managed_nodes() if name in found]
    if not nodes:
        raise BadInputError(
            "holds no node with a lifecycle", where=f"namespace {namespace}",
            value=", ".join(found) or "no node", bound="a driver that runs",
        )  # fmt: skip
    return nodes

"""The bench on the ROS graph: starts the nodes, drives them over topics, stops them."""

from __future__ import annotations

import shutil
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from imotor_msgs.msg import RecordingState

from imotor_ros.bag.recover import recover
from imotor_ros.campaign.bench import (
    DriveAdvanced,
    PerformanceReported,
    PhaseEntered,
    RunEvent,
)
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.contracts import graph
from imotor_ros.contracts.graph import Role
from imotor_ros.contracts.messages import performance_from_message
from imotor_ros.contracts.topics import DEFAULT_NAMESPACE
from imotor_ros.core.parameters import Parameters
from imotor_ros.errors import DriveFaultError, ImotorError, RecordingError
from imotor_ros.nodes.node_parameters import parameters_of_nodes
from imotor_ros.nodes.process import NodeProcess, find_executable, stop_processes
from imotor_ros.nodes.stand_client import (
    ACTIVATE,
    CLEAN_UP,
    CONFIGURE,
    DEACTIVATE,
    PlayedProgram,
    StandClient,
)


@dataclass(frozen=True)
class Timeouts:
    """How long the bench waits (s) for what."""

    start: float = 60.0
    transition: float = 60.0
    stall: float = 30.0
    finish: float = 60.0
    stop: float = 10.0


class RosBench:
    """
    Carries out runs on nodes that it starts itself.

    The nodes are started once, at the first run, and serve all runs; after a failed run they
    are stopped, and started anew for the next.

    Parameters
    ----------
    log_directory : Path
        Folder for the nodes' logs.
    namespace : str
        Namespace of the stand.
    roles : tuple of Role
        The nodes.
    timeouts : Timeouts
        How long to wait for what.

    """

    name = "ros"

    def __init__(
        self,
        log_directory: Path,
        *,
        namespace: str = DEFAULT_NAMESPACE,
        roles: tuple[Role, ...] = graph.VIRTUAL_STAND,
        timeouts: Timeouts | None = None,
    ) -> None:
        self._logs = log_directory
        self._namespace = namespace
        self._roles = roles
        self._timeouts = timeouts or Timeouts()
        self._processes: dict[str, NodeProcess] = {}
        self._client: StandClient | None = None

    @property
    def processes(self) -> Mapping[str, NodeProcess]:
        """The running nodes by name."""
        return self._processes

    def __enter__(self) -> Self:
        """Return the bench; nodes start with the first run."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop all nodes."""
        self._stop_nodes()

    # ---- nodes ---------------------------------------------------------------------------

    @property
    def _names(self) -> list[str]:
        return [role.name for role in self._roles]

    def _start_nodes(self) -> StandClient:
        paths = {role.executable: find_executable(role.executable) for role in self._roles}
        for role in self._roles:
            log = self._logs / f"{role.name}.log"
            self._processes[role.name] = NodeProcess(
                paths[role.executable], role.name, self._namespace, log, role.remappings
            )
        self._client = StandClient(self._namespace, self._check_processes)
        return self._client

    def _check_processes(self) -> None:
        for process in self._processes.values():
            process.check()

    def _stop_nodes(self) -> None:
        stop_processes(self._processes.values(), self._timeouts.stop)
        self._processes.clear()
        if self._client is not None:
            self._client.close()
            self._client = None

    # ---- one run -------------------------------------------------------------------------

    def run(self, plan: RunPlan) -> Iterator[RunEvent]:
        """
        Carry out one run; see `Bench.run`.

        Raises
        ------
        NodeDiedError
            If a node ends during the run.
        RunError
            If the run does not reach its end for another reason.

        """
        try:
            yield from self._carry_out(plan)
        except BaseException:
            self._abandon(plan)
            raise

    def _carry_out(self, plan: RunPlan) -> Iterator[RunEvent]:
        client = self._client
        times = self._timeouts
        if client is None:
            yield PhaseEntered("start nodes")
            client = self._start_nodes()
            client.wait_for_nodes(self._names, times.start)
        yield PhaseEntered("configure")
        plan.directory.mkdir(parents=True, exist_ok=True)
        if plan.bag_path.exists():
            shutil.rmtree(plan.bag_path)
        client.begin_run(plan.program, plan.run_info_json)
        client.set_parameters(self._parameters(plan), times.transition)
        client.change_state(self._names, CONFIGURE, times.transition)
        client.change_state(self._names, ACTIVATE, times.transition)
        yield PhaseEntered("run")
        played = client.play(plan.program, times.transition)
        try:
            yield from self._follow(client, played, plan)
        except (KeyboardInterrupt, GeneratorExit):
            self._stop_gently(client, played)
            raise
        yield PhaseEntered("finish")
        client.change_state(self._names, DEACTIVATE, times.transition)
        client.change_state(self._names, CLEAN_UP, times.transition)

    def _parameters(self, plan: RunPlan) -> dict[str, Parameters]:
        return parameters_of_nodes(plan, self._roles)

    def _follow(
        self, client: StandClient, played: PlayedProgram, plan: RunPlan
    ) -> Iterator[RunEvent]:
        """Yield events until the program is played, evaluated and recorded."""
        yield from self._follow_drive(client, played, plan)
        if played.outcome != "completed":
            raise DriveFaultError(played.outcome)
        reported = 0
        while not _is_closed(client):
            reported = yield from _new_reports(client, reported)
            client.spin_until(
                lambda seen=reported: len(client.performances) > seen or _is_closed(client),
                "the evaluator and the recorder to finish the run",
                self._timeouts.finish,
            )
            client.check_faults()
        yield from _new_reports(client, reported)
        if client.recordings[-1].state == RecordingState.STATE_FAILED:
            raise RecordingError(client.recordings[-1].error)

    def _follow_drive(
        self, client: StandClient, played: PlayedProgram, plan: RunPlan
    ) -> Iterator[RunEvent]:
        consumed = -1
        while not played.is_done:
            client.spin_until(
                lambda seen=consumed: played.is_done or played.consumed > seen,
                f"the plant to consume more than {consumed} samples",
                self._timeouts.stall,
            )
            client.check_faults()
            if played.consumed > consumed:
                consumed = played.consumed
                yield DriveAdvanced(consumed, plan.program.length)

    def _stop_gently(self, client: StandClient, played: PlayedProgram) -> None:
        """Bring the voltage to zero and let evaluator and recorder end the shortened run."""
        try:
            played.cancel()
            client.spin_until(
                lambda: played.is_done and _is_closed(client),
                "the stopped run to end",
                self._timeouts.stop,
            )
        except (ImotorError, KeyboardInterrupt):
            return

    def _abandon(self, plan: RunPlan) -> None:
        """Stop the nodes, which close the bag; mend it if the recorder could not."""
        self._stop_nodes()
        if plan.bag_path.exists():
            try:
                recover(plan.bag_path)
            except ImotorError:
                return  # nothing was recorded yet


def _is_closed(client: StandClient) -> bool:
    ends = (RecordingState.STATE_CLOSED, RecordingState.STATE_FAILED)
    return bool(client.recordings) and client.recordings[-1].state in ends


def _new_reports(client: StandClient, reported: int) -> Generator[RunEvent, None, int]:
    """Yield the performances that came since; return how many have been reported."""
    while reported < len(client.performances):
        yield PerformanceReported(performance_from_message(client.performances[reported]))
        reported += 1
    return reported

"""The bench on the ROS graph: starts the nodes, drives them over topics, stops them."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

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
from imotor_ros.contracts.outcomes import CANCELLED, COMPLETED
from imotor_ros.contracts.topics import DEFAULT_NAMESPACE
from imotor_ros.core.correction import Excitation, ExcitationRequest
from imotor_ros.errors import DriveFaultError, ImotorError, StoppedError
from imotor_ros.nodes.excitation_search import ExcitationSearch
from imotor_ros.nodes.node_parameters import Leaves, parameters_of_nodes
from imotor_ros.nodes.process import NodeProcess
from imotor_ros.nodes.stand_client import PlayedProgram, StandClient
from imotor_ros.nodes.stand_processes import START_TIMEOUT, STOP_TIMEOUT, StandProcesses

STALL_TIMEOUT = 30.0
"""Longest wait (s) for the plant to consume anything."""

TRIAL_TIMEOUT = 600.0
"""Longest wait (s) for a trial of an excitation; the generator itself notices a stall sooner."""

FINISH_TIMEOUT = 60.0
"""Longest wait (s) for evaluator and recorder to finish a run that was played."""


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

    """

    name = "ros"

    def __init__(
        self,
        log_directory: Path,
        *,
        namespace: str = DEFAULT_NAMESPACE,
    ) -> None:
        self._logs = log_directory
        self._namespace = namespace
        self._driver_parameters: list[str] = []
        self._stand: StandProcesses | None = None

    @property
    def processes(self) -> Mapping[str, NodeProcess]:
        """The running nodes by name."""
        return {} if self._stand is None else self._stand.processes

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

    def _stop_nodes(self) -> None:
        if self._stand is not None:
            self._stand.stop()
            self._stand = None

    def _started(self, plan: RunPlan) -> Generator[RunEvent, None, StandProcesses]:
        """Return the nodes that a run needs; start them unless they are there."""
        roles = _roles_of(plan)
        if self._stand is not None and self._stand.roles != roles:
            self._stop_nodes()
        if self._stand is None:
            yield PhaseEntered("start nodes")
            self._stand = StandProcesses(roles, self._logs, self._namespace)
            self._stand.wait()
            self._driver_parameters = (
                []
                if plan.driver.is_virtual
                else self._stand.client.declared_parameters(graph.DRIVER_NAME, START_TIMEOUT)
            )
        return self._stand

    def _parameters(self, plan: RunPlan) -> dict[str, Leaves]:
        return parameters_of_nodes(plan, _roles_of(plan), self._driver_parameters)

    # ---- excitation ----------------------------------------------------------------------

    def excite(
        self, plan: RunPlan, request: ExcitationRequest
    ) -> Generator[RunEvent, None, Excitation]:
        """
        Find the voltage for a motion; see `Bench.excite`.

        The signal generator does, by its action; of the other nodes only those are active that
        move the rod and measure it.
        """
        try:
            search = yield from self._search(plan, request)
        except BaseException:
            self._stop_nodes()
            raise
        return search.excitation()

    def _search(
        self, plan: RunPlan, request: ExcitationRequest
    ) -> Generator[RunEvent, None, ExcitationSearch]:
        stand = yield from self._started(plan)
        client = stand.client
        names = [role.name for role in graph.in_correction(stand.roles)]
        stand.activate(self._parameters(plan), names)
        search = client.search(request, STALL_TIMEOUT)
        seen = 0
        try:
            while not search.is_done:
                client.spin_until(
                    partial(search.has_passed, seen), "the trial to end", TRIAL_TIMEOUT
                )
                client.check_faults()
                while seen < len(search.steps):
                    yield search.steps[seen]
                    seen += 1
        except (KeyboardInterrupt, GeneratorExit):
            search.cancel()
            with suppress(ImotorError, KeyboardInterrupt):
                client.spin_until(lambda: search.is_done, "the search to end", STOP_TIMEOUT)
            raise
        stand.deactivate(names)
        return search

    # ---- one run -------------------------------------------------------------------------

    def run(self, plan: RunPlan) -> Iterator[RunEvent]:
        """
        Carry out one run; see `Bench.run`.

        Raises
        ------
        NodeDiedError
            If a node ends during the run.
        StoppedError
            If an operator stopped the drive.
        RunError
            If the run does not reach its end for another reason.

        """
        try:
            yield from self._carry_out(plan)
        except BaseException:
            self._abandon(plan)
            raise

    def _carry_out(self, plan: RunPlan) -> Iterator[RunEvent]:
        stand = yield from self._started(plan)
        client = stand.client
        yield PhaseEntered("configure")
        plan.prepare_folder()
        client.begin_run(plan.program, plan.run_info_json)
        stand.activate(self._parameters(plan))
        yield PhaseEntered("run")
        played = client.play(plan.program, STALL_TIMEOUT)
        try:
            yield from self._follow(client, played, plan)
        except (KeyboardInterrupt, GeneratorExit):
            self._stop_gently(client, played)
            raise
        yield PhaseEntered("finish")
        stand.deactivate()

    def _follow(
        self, client: StandClient, played: PlayedProgram, plan: RunPlan
    ) -> Iterator[RunEvent]:
        """Yield events until the program is played, evaluated and recorded."""
        yield from self._follow_drive(client, played, plan)
        if played.outcome == CANCELLED:
            with suppress(ImotorError):  # the shortened run comes to its regular end
                client.spin_until(lambda: client.is_recorded, "the bag to be closed", STOP_TIMEOUT)
            raise StoppedError(f"run {plan.program.run_id}")
        if played.outcome != COMPLETED:
            client.check_faults()  # the cause, where the drive was not
            raise DriveFaultError(played.outcome)
        reported = 0
        while not client.is_recorded:
            reported = yield from _new_reports(client, reported)
            client.await_performance(reported, FINISH_TIMEOUT)
            client.check_faults()
        yield from _new_reports(client, reported)
        client.check_faults()

    def _follow_drive(
        self, client: StandClient, played: PlayedProgram, plan: RunPlan
    ) -> Iterator[RunEvent]:
        consumed = -1
        while not played.is_done:
            client.spin_until(
                partial(played.has_passed, consumed),
                f"the plant to consume more than {consumed} samples",
                STALL_TIMEOUT,
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
                lambda: played.is_done and client.is_recorded,
                "the stopped run to end",
                STOP_TIMEOUT,
            )
        except (ImotorError, KeyboardInterrupt):
            return

    def _abandon(self, plan: RunPlan) -> None:
        """Stop the nodes, which close the bag; mend it if the recorder could not."""
        if self._stand is not None:
            self._stand.stop_driver()
        self._stop_nodes()
        if plan.bag_path.exists():
            try:
                recover(plan.bag_path)
            except ImotorError:
                return  # nothing was recorded yet


def _roles_of(plan: RunPlan) -> tuple[Role, ...]:
    if plan.driver.is_virtual:
        return graph.VIRTUAL_STAND
    return graph.stand_with(plan.driver.executable)


def _new_reports(client: StandClient, reported: int) -> Generator[RunEvent, None, int]:
    """Yield the performances that came since; return how many have been reported."""
    while reported < len(client.performances):
        yield PerformanceReported(performance_from_message(client.performances[reported]))
        reported += 1
    return reported

"""Replay: a recorded run through the topics to the evaluator node."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.bench import PerformanceReported, PhaseEntered, RunEvent
from imotor_ros.campaign.point import PointParameters
from imotor_ros.contracts import graph
from imotor_ros.contracts.graph import expected_readers
from imotor_ros.contracts.messages import performance_from_message
from imotor_ros.contracts.topics import DEFAULT_NAMESPACE
from imotor_ros.nodes.evaluator import EvaluatorNodeParameters
from imotor_ros.nodes.player import PlayerParameters
from imotor_ros.nodes.stand_processes import StandProcesses

STALL_TIMEOUT = 60.0
"""Longest wait (s) for the next indicators."""


def replay(
    bag_path: Path, log_directory: Path, namespace: str = DEFAULT_NAMESPACE
) -> Iterator[RunEvent]:
    """
    Play a bag to an evaluator node and yield what it says; the last event is the final word.

    Parameters
    ----------
    bag_path : Path
        Folder of the bag.
    log_directory : Path
        Folder for the logs of the two nodes.
    namespace : str
        Namespace of the stand that is replayed.

    Raises
    ------
    UnreadableFileError
        If the bag cannot be read.
    RunError
        If the replay does not come to its end.

    """
    settings = _evaluator_parameters(bag_path)
    roles = (graph.PLAYER, graph.EVALUATOR)
    yield PhaseEntered("start nodes")
    with StandProcesses(roles, log_directory, namespace) as stand:
        stand.wait()
        readers = expected_readers(graph.PLAYER, roles)
        player = PlayerParameters(path=str(bag_path.absolute()), expected_readers=readers)
        client = stand.client
        client.performances.clear()
        # the player plays once it is active: what comes to an evaluator that is not yet, is lost
        stand.activate({"player": player, "evaluator": settings}, ["evaluator"])
        stand.activate({}, ["player"])
        yield PhaseEntered("replay")
        reported = 0
        while True:
            client.await_performance(reported, STALL_TIMEOUT)
            client.check_faults()
            performance = performance_from_message(client.performances[reported])
            reported += 1
            yield PerformanceReported(performance)
            if performance.is_final:
                return


def _evaluator_parameters(bag_path: Path) -> EvaluatorNodeParameters:
    """Return the parameters that the evaluator had in the recorded run."""
    with RunBag(bag_path) as bag:
        recorded = bag.run_info.get("parameters")
        channels = " ".join(bag.channels)
    if recorded is None:
        return EvaluatorNodeParameters(channels=channels)
    point = PointParameters.from_mapping(recorded, str(bag_path))
    return EvaluatorNodeParameters(
        channels=channels, report_interval=point.report_interval, evaluator=point.evaluator
    )

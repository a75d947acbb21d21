"""The points of a campaign by the motor model alone, on all cores."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, cast

from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.model import predict
from imotor_ros.errors import BadInputError, SolverError

PREDICTED = ("mean_velocity", "start_up_time", "ripple", "durability", "force")

_CHUNKS_PER_JOB = 8
_LARGEST_CHUNK = 200


def predict_without_stops(point: NamedPoint) -> dict[str, Any]:
    """
    Return what the point's own friction law predicts for an ideal rod motion, from rest.

    Parameters
    ----------
    point : NamedPoint
        The point; its end stops are left out, its spring and constant load are not.

    Returns
    -------
    dict
        "name", the values of `PREDICTED` (SI; None where there is none), "is_steady", "error".

    """
    motor = point.parameters.stand.motor
    load = motor.load.replace(stop_stiffness=0.0, stop_damping=0.0)
    motion = point.parameters.signal.motion
    try:
        found = predict(motion, motor.slider, cast("FrictionLaw", motor.friction), load)
    except SolverError as error:
        nothing: dict[str, Any] = dict.fromkeys(PREDICTED)
        return {"name": point.name, **nothing, "is_steady": False, "error": str(error)}
    values = {key: getattr(found, key) for key in PREDICTED}
    return {"name": point.name, **values, "is_steady": found.is_steady, "error": ""}


def predict_points(
    points: Sequence[NamedPoint], jobs: int | None = None
) -> Iterator[dict[str, Any]]:
    """
    Yield the predictions of points in their order, computed in parallel.

    Parameters
    ----------
    points : sequence of NamedPoint
        The points.
    jobs : int, optional
        Number of processes; by default one for each core that this process may use. One job
        computes in this process. The results do not depend on it.

    Raises
    ------
    BadInputError
        If there is no job.

    """
    jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
    if jobs < 1:
        raise BadInputError("is out of bounds", where="jobs", value=jobs, bound=">= 1")
    if jobs == 1:
        yield from map(predict_without_stops, points)
        return
    chunk = min(max(1, len(points) // (jobs * _CHUNKS_PER_JOB)), _LARGEST_CHUNK)
    # a server that forks workers: imports are paid for once, and no thread of ours is copied
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    with ProcessPoolExecutor(jobs, context) as pool:
        yield from pool.map(predict_without_stops, points, chunksize=chunk)

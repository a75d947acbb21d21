"""
The points of a campaign by the motor model alone: on all cores, or on a Dask cluster.

Points travel in chunks, as what the model needs of them, and come back as plain values: what the
processes say to each other takes little beside what they compute. Where a point is computed does
not change its values.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from typing import Any, NamedTuple, cast

from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.point import PointParameters, SignalParameters
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.model import predict
from imotor_ros.core.parameters import Parameters
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.errors import BadInputError, ImotorError

PREDICTED = ("mean_velocity", "start_up_time", "ripple", "durability", "force")

_CHUNKS_PER_JOB = 8
_LARGEST_CHUNK = 50


class ModelCase(NamedTuple):
    """What a prediction depends on: a point without drive, instruments and end stops."""

    signal: SignalParameters
    slider: SliderParameters
    friction: Parameters
    load: LoadParameters


class ModelValues(NamedTuple):
    """The values of `PREDICTED` (SI; None where there is none), whether steady, and an error."""

    values: tuple[float | None, ...]
    is_steady: bool
    error: str


Chunk = list[ModelCase]


def case_of(parameters: PointParameters) -> ModelCase:
    """Return the case of a point; its spring and constant load are kept, its end stops are not."""
    motor = parameters.stand.motor
    load = motor.load.replace(stop_stiffness=0.0, stop_damping=0.0)
    return ModelCase(parameters.signal, motor.slider, motor.friction, load)


def predict_chunk(chunk: Chunk) -> list[ModelValues]:
    """
    Predict cases for an ideal rod motion, from rest, one after the other.

    What one of them lacks is an error of its own, for the others go on.
    """
    return [_predict_case(case) for case in chunk]


def _predict_case(case: ModelCase) -> ModelValues:
    friction = cast("FrictionLaw", case.friction)
    try:
        found = predict(case.signal.motion, case.slider, friction, case.load)
    except ImotorError as error:
        return ModelValues((None,) * len(PREDICTED), False, str(error))
    return ModelValues(tuple(getattr(found, key) for key in PREDICTED), found.is_steady, "")


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
        Number of processes, this one included; by default one for each core that this process
        may use.

    Yields
    ------
    dict
        "name", the values of `PREDICTED` by name, "is_steady", "error".

    Raises
    ------
    BadInputError
        If there is no job.

    """
    jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
    if jobs < 1:
        raise BadInputError("is out of bounds", where="jobs", value=jobs, bound=">= 1")
    chunks = chunks_of(points, jobs)
    jobs = min(jobs, len(chunks))
    found = map(predict_chunk, chunks) if jobs <= 1 else _on_cores(chunks, jobs)
    return rows_of(points, found)


def chunks_of(points: Sequence[NamedPoint], workers: int) -> list[Chunk]:
    """Return the cases of points in chunks, some for each worker."""
    size = min(max(1, len(points) // (workers * _CHUNKS_PER_JOB)), _LARGEST_CHUNK)
    cases = [case_of(point.parameters) for point in points]
    return [cases[first : first + size] for first in range(0, len(cases), size)]


def rows_of(
    points: Sequence[NamedPoint], found: Iterator[list[ModelValues]]
) -> Iterator[dict[str, Any]]:
    """Yield what `predict_points` does, from the values of its chunks."""
    values = (one for chunk in found for one in chunk)
    for point, one in zip(points, values, strict=True):
        row = dict(zip(PREDICTED, one.values, strict=True))
        yield {"name": point.name, **row, "is_steady": one.is_steady, "error": one.error}


def _on_cores(chunks: Sequence[Chunk], jobs: int) -> Iterator[list[ModelValues]]:
    """
    Yield the values of chunks in their order, by this process and others.

    The others begin with the first chunk as soon as they have started, this one with the last
    at once, until they meet.
    """
    # a server that forks workers: imports are paid for once, and no thread of ours is copied
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    with ProcessPoolExecutor(jobs - 1, context) as pool:
        futures: list[Future[list[ModelValues]]] = [
            pool.submit(predict_chunk, chunk) for chunk in chunks
        ]
        own: dict[int, list[ModelValues]] = {}
        next_one = 0
        try:
            for number in range(len(chunks) - 1, -1, -1):
                if not futures[number].cancel():
                    break
                own[number] = predict_chunk(chunks[number])
                while next_one < number and futures[next_one].done():
                    yield futures[next_one].result()
                    next_one += 1
            for number in range(next_one, len(chunks)):
                yield own[number] if number in own else futures[number].result()
        finally:
            pool.shutdown(cancel_futures=True)

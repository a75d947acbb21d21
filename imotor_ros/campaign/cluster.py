"""The points of a campaign by the motor model, on a Dask cluster."""

from __future__ import annotations

import hashlib
import platform
import re
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from importlib.metadata import version
from pathlib import Path
from typing import Any

import imotor_ros.core
from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.model_sweep import chunks_of, predict_chunk, rows_of
from imotor_ros.errors import BadInputError, DeadlineError, RunError

DEADLINE = 10.0
"""Time (s) in which scheduler and first worker must answer."""

_ADDRESS = re.compile(r"(tcp|tls)://\S+:\d+")
_PACKAGES = ("numpy", "scipy", "numba")


def predict_on_cluster(
    points: Sequence[NamedPoint], scheduler: str, deadline: float = DEADLINE
) -> Iterator[dict[str, Any]]:
    """
    Yield the predictions of points in their order, computed by the workers of a Dask cluster.

    The values are those of `model_sweep.predict_points`, which this otherwise equals.

    Parameters
    ----------
    points : sequence of NamedPoint
        The points.
    scheduler : str
        Address of the scheduler, such as "tcp://10.0.0.5:8786". It and its workers must be able
        to import this package.
    deadline : float
        Time (s) in which it and a worker must answer.

    Raises
    ------
    BadInputError
        If the address is none, or Dask is not installed.
    DeadlineError
        If scheduler or workers do not answer.
    RunError
        If the workers have other code or packages than this process, so that their values would
        differ, or do not reach the end.

    """
    if _ADDRESS.fullmatch(scheduler) is None:
        raise BadInputError(
            "is no address", where="--scheduler", value=scheduler, bound="one like tcp://host:8786"
        )
    try:
        import distributed
    except ImportError as error:
        raise BadInputError(
            f"needs Dask: {error}",
            where="--scheduler",
            bound='pip install "imotor_ros[dask]", or ./imotor, which installs it',
        ) from error
    try:
        client = distributed.Client(scheduler, timeout=deadline, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise DeadlineError(f"the Dask scheduler {scheduler} to answer", deadline) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=deadline)
        except TimeoutError as error:
            raise DeadlineError(f"a worker of the Dask scheduler {scheduler}", deadline) from error
        try:
            _check_workers(client)
            yield from rows_of(points, _results(client, points))
        except (OSError, ImportError, CancelledError, distributed.KilledWorker) as error:
            what = f"{type(error).__name__}: {error}"
            raise RunError(f"the cluster at {scheduler} did not reach the end: {what}") from error


def _results(client: Any, points: Sequence[NamedPoint]) -> Iterator[Any]:
    chunks = chunks_of(points, sum(client.nthreads().values()))
    # pure: were two chunks equal, one would do
    futures = client.map(predict_chunk, chunks, pure=True)
    for number, future in enumerate(futures):
        yield future.result()
        futures[number] = None  # the cluster may forget it


def _check_workers(client: Any) -> None:
    own = _own_fingerprint()
    for worker, other in client.run(fingerprint).items():
        for what, value in own.items():
            if other[what] != value:
                raise RunError(
                    f"worker {worker} would compute something else: its {what} is {other[what]}, "
                    f"here it is {value}"
                )


def _own_fingerprint() -> dict[str, str]:
    return fingerprint()


def fingerprint() -> dict[str, str]:
    """Return what the values of a prediction depend on beside the point: code and packages."""
    digest = hashlib.sha256()
    for folder in imotor_ros.core.__path__:
        for path in sorted(Path(folder).glob("*.py")):
            digest.update(path.read_bytes())
    packages = {name: version(name) for name in _PACKAGES}
    return {"code": digest.hexdigest()[:12], "machine": platform.machine(), **packages}

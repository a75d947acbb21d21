"""Points by the model alone on a Dask cluster, and what is said when there is none."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import distributed
import pytest

from imotor_ros.campaign import cluster
from imotor_ros.campaign.campaign import campaign_from_mapping
from imotor_ros.campaign.cluster import fingerprint, predict_on_cluster
from imotor_ros.campaign.model_sweep import predict_points
from imotor_ros.cli.main import main
from imotor_ros.errors import BadInputError, DeadlineError, RunError

POINTS = campaign_from_mapping(
    {
        "sweep": {
            "signal.harmonics": [2, 3, 4],
            "signal.maximum_frequency": [9250.0, 18500.0],
            "stand.motor.friction.slope": [0.0, 2.213, 5.0],
            "stand.motor.load.constant_force": [0.0, 0.1],
        }
    }
).points


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a cluster of two worker processes on this machine."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
    ) as local:
        yield local.scheduler_address


def test_cluster_gives_the_same_values_to_the_last_bit(scheduler: str) -> None:
    assert list(predict_on_cluster(POINTS, scheduler)) == list(predict_points(POINTS, 1))


def test_verb_takes_a_scheduler(
    scheduler: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("sweep: {signal.harmonics: [2, 3]}\n", encoding="utf-8")
    answers = []
    for options in (["--jobs", "1"], ["--scheduler", scheduler]):
        assert main(["sweep", str(path), "--json", *options]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    assert answers[0] == answers[1]
    assert [point["signal.harmonics"] for point in answers[0]["points"]] == [2, 3]


def test_worker_with_other_code_is_refused(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    changed = {**fingerprint(), "code": "of another day"}
    monkeypatch.setattr(cluster, "_own_fingerprint", lambda: changed)
    with pytest.raises(RunError, match=r"its code is .*, here it is of another day"):
        list(predict_on_cluster(POINTS, scheduler))


def test_scheduler_that_does_not_answer_is_waited_for_until_the_deadline() -> None:
    with pytest.raises(DeadlineError, match=r"waited 0\.3 s for the Dask scheduler tcp://127"):
        list(predict_on_cluster(POINTS, "tcp://127.0.0.1:1", deadline=0.3))


def test_address_that_is_none_is_refused() -> None:
    with pytest.raises(BadInputError, match="--scheduler: is no address, got 'cluster'"):
        list(predict_on_cluster(POINTS, "cluster"))


def test_missing_dask_is_named_with_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BadInputError, match=r"needs Dask.*pip install .imotor_ros\[dask\]"):
        list(predict_on_cluster(POINTS, "tcp://127.0.0.1:8786"))

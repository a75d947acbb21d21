"""Stands of real nodes on which something fails: a full disk, a second run after a failure."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.bench import DriveAdvanced, PerformanceReported
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.errors import RunError
from imotor_ros.nodes.ros_bench import RosBench

ROOM = 3_000_000
"""Bytes that the recorder may write."""


def test_full_disk_ends_the_run_with_one_error_and_the_bench_can_go_on(
    tmp_path: Path, make_plan: Callable[..., RunPlan], namespace: str
) -> None:
    """
    The limit on the size of files stands for a disk that gets full.

    The nodes are stopped then, and the next run has new ones, in the same namespace.
    """
    plan = make_plan("full", 20.0)
    with RosBench(tmp_path / "logs", namespace=namespace) as bench:
        events = bench.run(plan)
        next(event for event in events if isinstance(event, DriveAdvanced))
        recorder = bench.processes["recorder"].pid
        resource.prlimit(recorder, resource.RLIMIT_FSIZE, (ROOM, ROOM))
        begin = time.monotonic()
        with pytest.raises(RunError) as caught:
            list(events)
        assert time.monotonic() - begin < 25.0
        text = str(caught.value)
        assert f"{plan.bag_path}: cannot be written: File too large" in text
        assert "\n" not in text
        assert bench.processes == {}
        with RunBag(plan.bag_path) as bag:
            assert "File too large" in bag.end_state
            assert len(bag.samples("rod/velocity")[0]) >= 10_000
        again = [
            e for e in bench.run(make_plan("again", 0.03)) if isinstance(e, PerformanceReported)
        ]
        assert again[-1].performance.is_final
        assert all(stream.lost == 0 for stream in again[-1].performance.streams)

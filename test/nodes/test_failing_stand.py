"""Stands on which something fails: a full disk, and the namespace after a failure."""

from __future__ import annotations

import gc
import os
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from imotor_msgs.action import PlayProgram

from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.bench import DriveAdvanced
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.errors import BadInputError, RunError
from imotor_ros.nodes.namespace_claim import NamespaceClaim
from imotor_ros.nodes.ros_bench import RosBench
from imotor_ros.nodes.stand_client import StandClient

ROOM = 3_000_000
"""Bytes that the recorder may write."""


def test_full_disk_ends_the_run_with_one_error(
    tmp_path: Path, make_plan: Callable[..., RunPlan], namespace: str
) -> None:
    """The limit on the size of files stands for a disk that gets full."""
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


@pytest.fixture
def no_garbage_collection() -> Iterator[None]:
    """Let no object go by chance that was not let go on purpose."""
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("no_garbage_collection")
def test_namespace_is_free_again_when_a_stand_has_stopped(namespace: str) -> None:
    """In one process: a goal without an answer keeps rclpy's node alive if it can."""
    first = StandClient(namespace, lambda: None)
    first.refuse_occupied_namespace()
    first._player.send_goal_async(PlayProgram.Goal(), feedback_callback=print)
    first.close()
    second = StandClient(namespace, lambda: None)
    second.refuse_occupied_namespace()
    second.close()


def test_claim_keeps_others_out_until_it_is_released(
    namespace: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second of two starts in the same moment is refused, before any discovery."""
    first = NamespaceClaim(namespace)
    with pytest.raises(BadInputError, match=f"{namespace}: is taken .*process {os.getpid()}"):
        NamespaceClaim(f"{namespace}/")
    NamespaceClaim(f"{namespace}_other").release()
    with monkeypatch.context() as context:
        context.setenv("ROS_DOMAIN_ID", "101")
        NamespaceClaim(namespace).release()
    first.release()
    NamespaceClaim(namespace).release()

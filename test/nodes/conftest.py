"""Every test has a ROS domain of its own, so that tests may run beside each other and a stand."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.plan import RunPlan, plan_run
from imotor_ros.campaign.point import PointParameters

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("imotor_msgs", reason="needs the interface package")

_FIRST_DOMAIN, _LAST_DOMAIN = 20, 99


@pytest.fixture(autouse=True)
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Lend a domain that no other test on this machine has, and keep discovery on this host."""
    folder = Path(tempfile.gettempdir()) / f"imotor-test-domains-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    for number in range(_FIRST_DOMAIN, _LAST_DOMAIN + 1):
        with (folder / str(number)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
            monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            yield number
            return
    pytest.fail(f"domains {_FIRST_DOMAIN} to {_LAST_DOMAIN} are all taken")


@pytest.fixture
def namespace(domain: int) -> str:
    """Return a namespace that nobody has, should somebody else be in the domain."""
    return f"/test_{os.getpid()}_{domain}"


@pytest.fixture
def make_plan(tmp_path: Path) -> Callable[..., RunPlan]:
    """Return a function that plans a run of so many seconds in a folder below tmp_path."""

    def make(folder: str, hold_time: float, **leaves: Any) -> RunPlan:
        named = {"drive.hold_time": hold_time, "stand.motor.load.upper_stop": 1e-3, **leaves}
        point = NamedPoint("point", PointParameters.from_leaves(named))
        return plan_run(point, tmp_path / folder)

    return make

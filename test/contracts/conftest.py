"""Both sources of message classes."""

from __future__ import annotations

from typing import Any

import pytest


@pytest.fixture(params=["rclpy", "rosbags"])
def types(request: pytest.FixtureRequest) -> Any:
    """Return a maker of messages: rclpy's classes, and those that rosbags makes."""
    if request.param == "rosbags":
        from imotor_ros.bag.types import installed_types

        return installed_types()
    pytest.importorskip("imotor_msgs", reason="needs the interface package")
    from imotor_ros.nodes.message_types import RclpyTypes

    return RclpyTypes()

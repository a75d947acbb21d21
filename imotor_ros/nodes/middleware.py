"""Joining the ROS graph, with what the stand asks of the middleware."""

from __future__ import annotations

import os
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_PROFILES = Path(__file__).with_name("fast_dds.xml")


def join_graph(context: Context, arguments: list[str] | None = None) -> None:
    """
    Initialise a context, so that nodes can be made in it.

    Signals stay with the caller: rclpy's own handlers would end the context before a node could
    publish its last messages.

    Parameters
    ----------
    context : Context
        The context.
    arguments : list of str, optional
        Command line, for remappings and parameters.

    Notes
    -----
    Fast DDS loses packets on a busy host, and a reliable reader asks for what is missing only when
    the writer's next heartbeat tells it: after 3 s by default, in which a stream stands still. The
    profile makes it 50 ms. It is read when a process first joins a graph; one that the user has
    chosen takes precedence, and other middlewares do not look at it.

    """
    if not any(os.environ.get(name) for name in _VARIABLES):
        os.environ[_VARIABLES[0]] = str(_PROFILES)
    rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)

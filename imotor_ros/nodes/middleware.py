"""Joining the ROS graph, with what the stand asks of the middleware."""

from __future__ import annotations

import os
import re
from pathlib import Path

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from imotor_ros.errors import BadInputError, RunError

_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_PROFILES = Path(__file__).with_name("fast_dds.xml")

_PLACES = re.compile(r"(, at \S+:\d+)+\s*$|\s*\n\s*")
"""Where in its source rcl says that something is wrong, and its line breaks."""


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

    Raises
    ------
    BadInputError
        If something after ``--ros-args`` cannot be parsed, or is not known to ROS.
    RunError
        If the middleware cannot be used.

    Notes
    -----
    Fast DDS loses packets on a busy host, and a reliable reader asks for what is missing only when
    the writer's next heartbeat tells it: after 3 s by default, in which a stream stands still. The
    profile makes it 50 ms. It is read when a process first joins a graph; one that the user has
    chosen takes precedence, and other middlewares do not look at it.

    """
    if not any(os.environ.get(name) for name in _VARIABLES):
        os.environ[_VARIABLES[0]] = str(_PROFILES)
    try:
        rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except UnknownROSArgsError as error:
        raise BadInputError("are not known to ROS", where="--ros-args", value=str(error)) from error
    except RCLError as error:
        text = _PLACES.sub("", str(error).removeprefix("failed to initialize rcl: "))
        if "parse" in text:
            raise BadInputError(text, where="--ros-args") from error
        raise RunError(f"the ROS graph cannot be joined: {text}") from error

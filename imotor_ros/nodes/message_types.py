"""Message classes as rclpy has them."""

from __future__ import annotations

import array
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray


@cache
def message_class(type_name: str) -> Any:
    """
    Return the class of a message type, e.g. "imotor_msgs/msg/SampleBlock".

    Raises
    ------
    ModuleNotFoundError
        If the interface package is not installed.

    """
    package, kind, name = type_name.split("/")
    return getattr(import_module(f"{package}.{kind}"), name)


class RclpyTypes:
    """Makes rclpy messages; see `imotor_ros.contracts.messages.MessageTypes`."""

    def message(self, type_name: str, **fields: Any) -> Any:
        """Return a message with its fields; arrays are assigned, which spares a copy."""
        message = message_class(type_name)()
        for name, value in fields.items():
            setattr(message, name, value)
        return message

    def floats(self, values: NDArray[np.float64] | Sequence[float]) -> Any:
        """Return an `array.array`, the one form that a float64[] field takes without a copy."""
        return array.array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())

"""The stand state: what the generator does, and what goes wrong anywhere in the stand."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imotor_msgs.msg import StandState
from rclpy._rclpy_pybind11 import RCLError
from rclpy.node import Node

from imotor_ros.contracts.messages import MessageTypes, stand_state_to_message
from imotor_ros.contracts.topics import DIAGNOSTICS, STATE
from imotor_ros.nodes.qos import pulse_profile, qos_profile

PULSE_INTERVAL = 0.1
"""Interval (s) at which the state is published."""

SILENCE_LIMIT = 5.0
"""Time (s) without diagnostics after which a node counts as lost."""

_SILENT_PULSES = round(SILENCE_LIMIT / PULSE_INTERVAL)


@dataclass
class FaultBoard:
    """
    The faults of the nodes of one stand, by their diagnostics.

    A node that has told of itself and then falls silent without having ended has a fault too.

    Attributes
    ----------
    namespace : str
        Namespace of the stand.

    """

    namespace: str
    _faults: dict[str, str] = field(default_factory=dict)
    _silent: dict[str, int] = field(default_factory=dict)

    def add(self, name: str, level: bytes, message: str) -> None:
        """Take the status `name`, e.g. "stand/plant: run"."""
        space, _, node = name.partition(":")[0].rpartition("/")
        if space != self.namespace.strip("/"):
            return
        if level == DiagnosticStatus.STALE:
            self._faults.pop(node, None)
            self._silent.pop(node, None)
            return
        self._silent[node] = 0
        self._faults[node] = message if level == DiagnosticStatus.ERROR else ""

    def advance(self) -> None:
        """Take note that a pulse has passed."""
        # pulses are counted, not time: while this process is held up, nobody is heard
        for node in self._silent:
            self._silent[node] += 1

    def first(self) -> tuple[str, str]:
        """Return node and reason of a fault, or two empty texts."""
        for node, fault in self._faults.items():
            if fault:
                return node, fault
        for node, pulses in self._silent.items():
            if pulses > _SILENT_PULSES:
                return node, f"has not been heard of for {SILENCE_LIMIT:g} s"
        return "", ""


class StatePublisher:
    """
    Publishes the stand state when it changes, and as a pulse.

    Parameters
    ----------
    node : Node
        The signal generator.
    types : MessageTypes
        Makes messages.

    """

    def __init__(self, node: Node, types: MessageTypes) -> None:
        self._types = types
        self._own_name = node.get_name()
        self._board = FaultBoard(node.get_namespace())
        self._last: tuple[Any, ...] = ()
        self._publisher = node.create_publisher(
            StandState, STATE.name, pulse_profile(is_writer=True)
        )
        node.create_subscription(
            DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, qos_profile(DIAGNOSTICS)
        )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._board.add(status.name, status.level, status.message)

    def advance(self) -> None:
        """Take note that a pulse has passed: the state is published, changed or not."""
        self._board.advance()
        self._last = ()

    def publish(self, state: int, fault: str, run_id: str, sent: int, consumed: int) -> None:
        """
        Publish the state, if it is not the one published last.

        Parameters
        ----------
        state : int
            What the generator does, a STATE_ constant.
        fault : str
            Fault of the generator itself, or nothing.
        run_id, sent, consumed
            See StandState.msg.

        """
        node, reason = (self._own_name, fault) if fault else self._other_fault()
        state = StandState.STATE_FAULT if reason else state
        key = (state, run_id, node, reason)
        if key == self._last:
            return
        self._last = key
        try:
            self._publisher.publish(
                stand_state_to_message(
                    self._types, time.time_ns(), state, run_id,
                    node=node, reason=reason, sent=sent, consumed=consumed,
                )
            )  # fmt: skip
        except RCLError:  # the next pulse comes soon
            self._last = ()

    def _other_fault(self) -> tuple[str, str]:
        node, reason = self._board.first()
        return ("", "") if node == self._own_name else (node, reason)

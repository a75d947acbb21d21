"""Nodes that follow a run: they learn of it from the drive program, and may get blocks before."""

from __future__ import annotations

from collections import deque
from typing import Any, TypeVar

from imotor_ros.contracts.blocks import SampleBlock
from imotor_ros.contracts.messages import program_from_message
from imotor_ros.contracts.topics import DRIVE_PROGRAM, Topic
from imotor_ros.core.drive import DriveProgram
from imotor_ros.nodes.stand_node import NodeParameters, StandNode

P = TypeVar("P", bound=NodeParameters)


class RunFollowerNode(StandNode[P]):
    """
    A node that processes the streams of the run announced on drive/program.

    The program and the first blocks come on different topics, in any order: blocks of a run
    not yet announced wait. Derived classes extend `begin_run` and `process_block`.
    """

    program: DriveProgram | None = None
    _waiting: deque[SampleBlock]

    def follow_run(self) -> None:
        """Subscribe to the drive program; to be called in `configure`."""
        self.activate()
        self.add_subscription(DRIVE_PROGRAM, self._on_program)

    def follow_stream(self, topic: Topic) -> None:
        """Subscribe to a stream of samples; to be called in `configure`."""
        self.add_block_subscription(topic, self._on_block)

    def activate(self) -> None:
        """Forget the last run."""
        self.program = None
        self._waiting = deque()

    def begin_run(self, program: DriveProgram) -> None:
        """Make ready for the blocks of a new run."""

    def leave_run(self) -> None:
        """Bring the present run to its end, because another one begins."""

    def change_run(self, program: DriveProgram) -> None:
        """Take note that the program of the present run has changed (it was stopped early)."""

    def process_block(self, block: SampleBlock) -> None:
        """Process one block of the present run."""

    def _on_program(self, message: Any) -> None:
        if not self.is_active:
            return
        program = program_from_message(message)
        is_new = self.program is None or program.run_id != self.program.run_id
        if is_new and self.program is not None:
            self.leave_run()
        self.program = program
        if not is_new:
            self.change_run(program)
            return
        self.begin_run(program)
        waiting, self._waiting = self._waiting, deque()
        for block in waiting:
            self._on_block(block)

    def _on_block(self, block: SampleBlock) -> None:
        if not self.is_active:
            return  # a trial, played by other nodes without this one
        if self.program is None or block.run_id != self.program.run_id:
            self._waiting.append(block)
        else:
            self.process_block(block)

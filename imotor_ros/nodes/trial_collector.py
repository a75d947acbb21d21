"""What the signal generator hears of the rod while it plays a trial."""

from __future__ import annotations

from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from imotor_ros.contracts.blocks import StreamLedger
from imotor_ros.contracts.messages import block_from_message, channel_from_message
from imotor_ros.contracts.topics import ROD_VELOCITY
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.samples import Samples
from imotor_ros.core.trial import Recording
from imotor_ros.nodes.message_types import message_class


class TrialCollector:
    """
    Collects the rod velocity of a trial, whole or not at all.

    Parameters
    ----------
    program : DriveProgram
        What is played.

    """

    def __init__(self, program: DriveProgram) -> None:
        self.program = program
        self._channel: ChannelDescription | None = None
        self._parts: list[Samples] = []
        self._ledger = StreamLedger(
            ROD_VELOCITY.name, program.run_id, sample_rate=program.sample_rate
        )

    @property
    def is_complete(self) -> bool:
        """Whether all samples are there, and what they mean."""
        return self._channel is not None and self._ledger.received >= self.program.length

    @property
    def progress(self) -> str:
        """What is there, in words."""
        described = "" if self._channel else ", not described"
        return f"{self._ledger.received} of {self.program.length} samples{described}"

    def add_channel(self, message: Any) -> None:
        """Take note of a Channel message, if it is that of the rod in this trial."""
        if message.run_id == self.program.run_id and message.name == ROD_VELOCITY.name:
            self._channel = channel_from_message(message)

    def add_block(self, data: bytes) -> None:
        """
        Take a serialised SampleBlock message, if it is of this trial.

        Raises
        ------
        SamplesLostError
            If it does not follow the one before.

        """
        message = deserialize_message(data, message_class(ROD_VELOCITY.type_name))
        if message.run_id != self.program.run_id:
            return
        block = block_from_message(message)
        self._ledger.accept(block)
        self._parts.append(block.samples)

    def recording(self) -> Recording:
        """Return what was collected; it must be complete."""
        assert self._channel is not None
        name = ROD_VELOCITY.name
        samples = np.concatenate(self._parts)
        return Recording(
            self.program, {name: samples}, {name: self._channel}, {name: self._ledger.flags}
        )

"""What virtual instruments have in common as nodes: truth in, a measured channel out."""

from __future__ import annotations

from typing import TypeVar

from rclpy.publisher import Publisher

from imotor_ros.campaign.roles.instrument import Instrument, InstrumentRole
from imotor_ros.contracts.blocks import SampleBlock
from imotor_ros.contracts.messages import channel_to_message
from imotor_ros.contracts.topics import CHANNELS, Topic
from imotor_ros.core.channel import SampleFlag, flag_names
from imotor_ros.core.drive import DriveProgram
from imotor_ros.nodes.run_follower import RunFollowerNode
from imotor_ros.nodes.stand_node import NodeParameters

P = TypeVar("P", bound=NodeParameters)


class InstrumentNode(RunFollowerNode[P]):
    """
    Measures one stream of truth.

    Derived classes name the two topics as they are before remapping, and make the instrument.
    """

    truth_topic: Topic
    measured_topic: Topic
    _role: InstrumentRole | None = None
    _flags = 0
    _channels: Publisher | None = None

    def make_instrument(self, sample_rate: float, channel: str) -> Instrument:
        """Return the instrument for a run with so many samples per second (Hz)."""
        raise NotImplementedError

    def configure(self) -> None:
        """Make the endpoints."""
        self.follow_run()
        self.add_publisher(self.measured_topic)
        self._channels = self.add_publisher(CHANNELS)
        self.follow_stream(self.truth_topic)

    def begin_run(self, program: DriveProgram) -> None:
        """Make the instrument ready, and say what its channel is."""
        name = self.subject(self.measured_topic)
        instrument = self.make_instrument(program.sample_rate, name)
        self._role, self._flags = InstrumentRole(instrument, program), 0
        for channel in self._role.channels:
            message = channel_to_message(self.types, channel, program.run_id, program.epoch)
            self.publish(self._channels, message)

    def process_block(self, block: SampleBlock) -> None:
        """Measure a block."""
        assert self._role is not None
        measured = self._role.process(block)
        self._flags |= measured.flags
        self.publish_block(measured)

    def status_values(self) -> dict[str, object]:
        """Return run id, channel, samples and flags of the run."""
        if self._role is None:
            return {}
        ledger = self._role.ledger
        return {
            "run_id": ledger.run_id,
            "channel": ledger.stream,
            "samples": ledger.received,
            "lost": ledger.lost,
            "flags": flag_names(self._flags),
        }

    def warning(self) -> str:
        """Return what the instrument could not measure."""
        limited = self._flags & ~SampleFlag.RAMPED_DOWN
        return f"measured with {flag_names(limited)}" if limited else ""

"""A driver of a card that streams: one output, several inputs, all on one clock."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.publisher import Publisher
from rclpy.timer import Timer

from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, StreamLedger, sample_time
from imotor_ros.contracts.messages import block_to_message, channel_to_message
from imotor_ros.core.channel import ChannelDescription, SampleFlag
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.parameters import parameter
from imotor_ros.core.samples import Samples
from imotor_ros.errors import BadInputError, DeadlineError
from imotor_ros.nodes.guarded_driver import GuardedDriverNode, GuardedDriverParameters

RAMP_TIME = 15e-3
"""Time (s) in which a driver brings the voltage to zero by itself; 50 ms are allowed."""

_POLL_INTERVAL = 2e-3

_OUTPUT_TIMEOUT = 2.0
"""Longest wait (s) for the card to put out what it was given."""


@dataclass(frozen=True)
class CardDriverParameters(GuardedDriverParameters):
    """Parameters that every driver of a card has."""

    lowest_voltage: float = parameter(-20.0, "lowest voltage that is put out", unit="V", high=0.0)
    highest_voltage: float = parameter(
        120.0, "highest voltage that is put out", unit="V", low=0.0, excludes_low=True
    )


@dataclass(frozen=True)
class Measured:
    """
    What the card has put out and measured since it was asked last.

    Attributes
    ----------
    samples : mapping of str to ndarray, shape (n,)
        Samples (SI unit) of every channel, as many of each.
    flags : mapping of str to int
        Flags of channels that have some, bitwise or of `SampleFlag`.
    drive_flags : int
        What the amplifier could not follow.

    """

    samples: Mapping[str, Samples] = field(default_factory=dict)
    flags: Mapping[str, int] = field(default_factory=dict)
    drive_flags: int = 0

    @property
    def count(self) -> int:
        """Number of samples of each channel."""
        return min((len(one) for one in self.samples.values()), default=0)


P = TypeVar("P", bound=CardDriverParameters)


class CardDriverNode(GuardedDriverNode[P]):
    """
    Plays drive/voltage on a card and publishes what it measures, for as long as it is safe.

    Derived classes give the six methods below, in SI units; what they raise becomes a fault. What
    else docs/driver_specification.md asks for is done here and in `GuardedDriverNode`.
    """

    def __init__(
        self,
        role: str,
        parameters_class: type[P],
        *,
        context: Context | None = None,
        **options: Any,
    ) -> None:
        super().__init__(role, parameters_class, context=context, **options)
        self._channels: Publisher | None = None
        self._poll_timer: Timer | None = None
        self._forget_run()

    # ---- for derived classes ---------------------------------------------------------------

    @abstractmethod
    def connect(self) -> None:
        """Find the card and claim it."""

    @abstractmethod
    def disconnect(self) -> None:
        """Let go of the card; it may never have been connected."""

    @abstractmethod
    def arm(self, program: DriveProgram) -> Sequence[ChannelDescription]:
        """Start the card at 0 V and at the program's sample rate; return what it measures."""

    @abstractmethod
    def write(self, voltage: Samples) -> None:
        """Append the next samples (V) to the output; there are never more than 50 ms of them."""

    @abstractmethod
    def read(self) -> Measured:
        """Return what was put out and measured since the last call, without waiting for more."""

    @abstractmethod
    def switch_off(self) -> None:
        """Take the voltage off at once: the last resort where the ramp to zero has failed."""

    # ---- lifecycle -------------------------------------------------------------------------

    def configure(self) -> None:
        """Connect to the card and make the endpoints."""
        self.connect()
        for topic in topics.MEASURED_TOPICS:
            self.add_publisher(topic)
        self._channels = self.add_publisher(topics.CHANNELS)
        super().configure()

    def activate(self) -> None:
        """Forget the last run."""
        super().activate()
        self._forget_run()
        if self._poll_timer is None:
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._poll_timer = self.create_timer(_POLL_INTERVAL, self._on_poll, clock=steady)

    def cleanup(self) -> None:
        """Let go of the card."""
        if self._poll_timer is not None:
            self.destroy_timer(self._poll_timer)
            self._poll_timer = None
        self.disconnect()

    def finish(self) -> None:
        """Leave no voltage on, and let go of the card, because the process ends."""
        super().finish()
        self.disconnect()

    def status_values(self) -> dict[str, object]:
        """Return run id, progress, and whether the voltage is on."""
        run_id = self.program.run_id if self.program else ""
        return {"run_id": run_id, "consumed": self.consumed, "voltage_on": self.is_voltage_on}

    # ---- a run -----------------------------------------------------------------------------

    def _forget_run(self) -> None:
        self._ledger: StreamLedger | None = None
        self._last_voltage = 0.0
        self._written = self._measured = self._consumed = self._sequence = 0
        self._is_ramp = False

    @property
    def consumed(self) -> int:
        """Number of samples of the run that were put out."""
        return self._consumed

    @property
    def is_voltage_on(self) -> bool:
        """Whether the output is somewhere in the program."""
        return self.program is not None and self._written > 0 and not self._has_ended

    @property
    def _has_ended(self) -> bool:
        return self.program is None or self._measured >= self.program.length

    def leave_run(self) -> None:
        """Leave no voltage on, because another run begins."""
        self.bring_down()
        self._forget_run()

    def begin_run(self, program: DriveProgram) -> None:
        """Start the card, and say what it measures."""
        self._forget_run()
        super().begin_run(program)
        self._ledger = StreamLedger(
            topics.DRIVE_VOLTAGE.name, program.run_id, sample_rate=program.sample_rate
        )
        for channel in self.arm(program):
            message = channel_to_message(self.types, channel, program.run_id, program.epoch)
            self.publish(self._channels, message)

    def process_block(self, block: SampleBlock) -> None:
        """Check a block and give it to the card; it is acknowledged when it was put out."""
        if self._is_down or self._ledger is None:
            return
        self._silent_ticks = 0
        self._ledger.accept(block)
        self._check(block)
        self.write(block.samples)
        self._written += len(block.samples)
        if len(block.samples):
            self._last_voltage = float(block.samples[-1])
        self._collect()

    def _check(self, block: SampleBlock) -> None:
        low, high = self.parameters.lowest_voltage, self.parameters.highest_voltage
        is_good = (block.samples >= low) & (block.samples <= high)  # NaN is neither
        if not is_good.all():
            place = int(np.argmin(is_good))
            raise BadInputError(
                "is out of range",
                where=f"{block.stream}, sample {block.first_index + place}",
                value=float(block.samples[place]),
                bound=f"{low:g} to {high:g} V",
            )

    def _on_poll(self) -> None:
        if self.is_active and not self._is_down and self._written > self._measured:
            self._guarded(self._poll)(None)

    def _poll(self, _: None) -> None:
        self._collect()

    def _collect(self) -> bool:
        """Publish what was measured, then acknowledge it; return whether there was anything."""
        measured = self.read()
        count = measured.count
        if not count:
            return False
        for name, samples in measured.samples.items():
            self._publish_samples(name, samples, int(measured.flags.get(name, 0)))
        self._measured += count
        self._sequence += 1
        if not self._is_ramp:
            self._consumed = self._measured
            self._report(measured.drive_flags)
        return True

    def _publish_samples(self, name: str, samples: Samples, flags: int) -> None:
        assert self.program is not None
        program = self.program
        block = SampleBlock(
            stream=name,
            run_id=program.run_id,
            time=sample_time(program.epoch, self._measured, program.sample_rate),
            sequence=self._sequence,
            first_index=self._measured,
            sample_rate=program.sample_rate,
            unit=topics.topic_named(name).unit,
            flags=flags | (int(SampleFlag.RAMPED_DOWN) if self._is_ramp else 0),
            samples=samples,
        )
        if not self._is_ramp:
            self.publish_block(block)
            return
        try:  # nobody is waited for while the voltage has to go
            self._stream_publishers[name].publish(block_to_message(self.types, block))
        except RCLError:
            self.get_logger().warning(f"{name}: a reader takes nothing; samples are lost")

    def ramp_down(self) -> None:
        """Bring the output to zero without a jump: what the card has already comes first."""
        assert self.program is not None
        try:
            self._wait_for_output()
            self._is_ramp = True
            count = max(1, round(RAMP_TIME * self.program.sample_rate))
            self.write(self._last_voltage * (1.0 - np.arange(1, count + 1) / count))
            self._written += count
            self._wait_for_output()
        except BaseException:
            self.switch_off()
            raise

    def _wait_for_output(self) -> None:
        """Publish until all that the card was given is put out and measured."""
        deadline = time.monotonic() + _OUTPUT_TIMEOUT
        while self._measured < self._written:
            if not self._collect():
                if time.monotonic() > deadline:
                    raise DeadlineError("the card to put out its samples", _OUTPUT_TIMEOUT)
                time.sleep(1e-3)

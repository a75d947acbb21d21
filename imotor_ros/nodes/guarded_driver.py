"""A driver that plays block by block, and whose voltage never stays on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.publisher import Publisher

from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.contracts.messages import progress_to_message
from imotor_ros.contracts.topics import DRIVE_PROGRESS, DRIVE_VOLTAGE, STATE
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.drive import DriveProgram, Ending
from imotor_ros.core.parameters import parameter
from imotor_ros.errors import ImotorError
from imotor_ros.nodes.run_follower import RunFollowerNode
from imotor_ros.nodes.stand_node import NodeParameters

_TICK = 0.05
"""Interval (s) at which the watchdog looks."""


@dataclass(frozen=True)
class GuardedDriverParameters(NodeParameters):
    """Parameters of a driver that is watched over."""

    voltage_timeout: float = parameter(
        1.0, "silence of the generator after which the voltage is brought to zero", unit="s",
        low=0.1, high=3600.0,
    )  # fmt: skip


P = TypeVar("P", bound=GuardedDriverParameters)


class GuardedDriverNode(RunFollowerNode[P]):
    """
    A node that puts out the voltage of a run block by block; see docs/driver_specification.md.

    Derived classes make their publishers in `configure` and give `put_out`, `ramp_down`,
    `consumed` and `is_voltage_on`. When to ramp down, what to tell the generator, and which
    blocks to take no more is decided here.
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
        self._progress: Publisher | None = None
        self._is_down = False
        self._silent_ticks = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._voltage_timer = self.create_timer(_TICK, self._on_voltage_timer, clock=steady)

    # ---- for derived classes -------------------------------------------------------------

    @property
    def consumed(self) -> int:
        """Number of samples of the run that were put out."""
        raise NotImplementedError

    @property
    def is_voltage_on(self) -> bool:
        """Whether the last sample put out is one of the program, but not its end."""
        raise NotImplementedError

    def put_out(self, block: SampleBlock) -> int:
        """Put a block out, publish what was measured, and return the flags of the drive."""
        raise NotImplementedError

    def ramp_down(self) -> None:
        """Bring the voltage to zero, and publish what was measured with `RAMPED_DOWN`."""
        raise NotImplementedError

    # ---- for the node --------------------------------------------------------------------

    def configure(self) -> None:
        """Make the endpoints that all drivers have."""
        self.follow_run()
        self._progress = self.add_publisher(DRIVE_PROGRESS)
        self.add_subscription(STATE, self._on_state)
        self.follow_stream(DRIVE_VOLTAGE)

    def begin_run(self, program: DriveProgram) -> None:
        """Make ready for a run: the voltage of the last one is zero."""
        self.bring_down()
        self._is_down = program.ending is Ending.ABANDONED
        self._silent_ticks = 0

    def change_run(self, program: DriveProgram) -> None:
        """Take note of a stop; give the run up with a generator that has."""
        if program.ending is Ending.ABANDONED:
            if self.is_voltage_on:
                self.on_fault("abandoned by the signal generator")
            self._is_down = True  # blocks that are under way come to nothing

    def process_block(self, block: SampleBlock) -> None:
        """Put a block out and acknowledge it."""
        if self._is_down:
            return
        flags = self.put_out(block)
        self._silent_ticks = 0
        self._report(flags)

    def bring_down(self) -> bool:
        """Bring the voltage to zero if it is on; return whether that was so, and done."""
        if self._is_down or not self.is_voltage_on:
            return False
        self._is_down = True
        try:
            self.ramp_down()
        except ImotorError as error:
            self.get_logger().error(f"while the voltage went to zero: {error}")
            return False
        return True

    def on_fault(self, reason: str) -> None:
        """Bring the voltage to zero, and tell the generator, which ends the run."""
        if self.fault:
            return
        super().on_fault(reason)
        flags = int(SampleFlag.RAMPED_DOWN) if self.bring_down() else 0
        if self.program is not None:
            self._report(flags, f"{self.get_name()}: {reason}")

    def deactivate(self) -> None:
        """Leave no voltage on."""
        self.bring_down()

    def leave_output(self) -> None:
        """Leave no voltage on when the process is told to end."""
        self.bring_down()

    def finish(self) -> None:
        """Leave no voltage on when the process ends."""
        self.bring_down()

    def _report(self, flags: int, fault: str = "") -> None:
        assert self.program is not None
        assert self._progress is not None
        program, consumed = self.program, self.consumed
        moment = sample_time(program.epoch, consumed, program.sample_rate)
        message = progress_to_message(self.types, program.run_id, moment, consumed, flags, fault)
        self.publish(self._progress, message)

    # ---- watchdog ------------------------------------------------------------------------

    def _on_state(self, message: Any) -> None:
        """Hear that the generator is there and owns the run."""
        if self.program is not None and message.run_id == self.program.run_id:
            self._silent_ticks = 0

    def _on_voltage_timer(self) -> None:
        # ticks are counted, not time: those that fall into work or a held-up host are skipped
        self._silent_ticks += 1
        silence = self._silent_ticks * _TICK
        if self.fault or self._is_down or silence < self.parameters.voltage_timeout:
            return
        if self.is_voltage_on:
            self.on_fault(f"no voltage has come for {silence:.2f} s")

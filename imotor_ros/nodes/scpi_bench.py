"""The driver of a bench of SCPI instruments: waveform generator and oscilloscopes, over VISA."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.publisher import Publisher
from rclpy.timer import Timer

from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, StreamLedger, sample_time
from imotor_ros.contracts.messages import channel_to_message
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.drive import DriveProgram, Ending
from imotor_ros.core.parameters import parameter
from imotor_ros.errors import BadInputError, DriveFaultError, ImotorError
from imotor_ros.nodes.guarded_driver import GuardedDriverNode, GuardedDriverParameters
from imotor_ros.nodes.scpi.bench import Bench, Cancelled, Measurement
from imotor_ros.nodes.scpi.dialect import GeneratorDialect, OscilloscopeDialect, load_dialect
from imotor_ros.nodes.scpi.generator import check_voltage
from imotor_ros.nodes.scpi.rates import RatePlan
from imotor_ros.nodes.scpi.settings import BenchSettings, unit_of
from imotor_ros.nodes.scpi.visa import VisaLink
from imotor_ros.nodes.stand_node import run_node

_TICK = 5e-3
_PULSE_INTERVAL = 0.5
"""Interval (s) at which the generator hears that the instruments are at work."""

_ENDING_TIME = 1.0
"""Time (s) beyond that of an answer in which a measurement that is cancelled ends."""


@dataclass(frozen=True)
class ScpiBenchParameters(BenchSettings, GuardedDriverParameters):
    """Parameters of the driver: the bench, and what every driver has."""

    block_length: int = parameter(
        10_000, "samples in a block that is published", low=1, high=10_000_000
    )

    def check(self) -> None:
        """Check what both have to check."""
        BenchSettings.check(self)
        GuardedDriverParameters.check(self)


class _Job:
    """A measurement in a thread of its own, so that a stop is heard meanwhile."""

    def __init__(
        self,
        bench: Bench,
        program: DriveProgram,
        voltage: NDArray[np.float64],
        plans: dict[int, RatePlan],
        is_stopped: threading.Event,
    ) -> None:
        self.error = ""
        self.result: Measurement | None = None
        self.is_cancelled = threading.Event()
        self._arguments = (program, voltage, plans, is_stopped, self.is_cancelled)
        self._bench = bench
        self._thread = threading.Thread(target=self._run, name="measurement", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.result = self._bench.measure(*self._arguments)
        except Cancelled:
            self.error = "cancelled"
        except ImotorError as error:
            self.error = str(error)
        except Exception:
            self.error = traceback.format_exc()

    @property
    def is_running(self) -> bool:
        """Whether the thread still talks to the instruments."""
        return self._thread.is_alive()

    def join(self, timeout: float) -> None:
        """Wait for the end of the thread, not for ever."""
        self._thread.join(timeout)


class ScpiBenchNode(GuardedDriverNode[ScpiBenchParameters]):
    """
    Collects a program, plays it from the generator's memory, and publishes the records.

    All samples but the last are acknowledged as they are collected, the last one when everything
    measured is published: until then the signal generator owns the run, and can stop it.
    """

    _blocks: Iterator[tuple[SampleBlock, ...]]

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("scpi_bench", ScpiBenchParameters, context=context, **options)
        self._bench: Bench | None = None
        self._job: _Job | None = None
        self._last_job: _Job | None = None
        self._timer: Timer | None = None
        self._channels: Publisher | None = None
        self._is_configuring = False
        self._forget_run()

    # ---- lifecycle -----------------------------------------------------------------------

    def configure(self) -> None:
        """Read the dialects and make the endpoints."""
        settings = self.parameters
        load_dialect(settings.generator.dialect, GeneratorDialect)
        if not settings.oscilloscopes:
            raise BadInputError("is not set", where="oscilloscope_1.address")
        for one in settings.oscilloscopes.values():
            load_dialect(one.dialect, OscilloscopeDialect)
        for topic in topics.MEASURED_TOPICS:
            self.add_publisher(topic)
        self._channels = self.add_publisher(topics.CHANNELS)
        self._is_configuring = True
        try:
            super().configure()
        finally:
            self._is_configuring = False

    def activate(self) -> None:
        """Connect to the instruments and make ready for a run."""
        super().activate()
        self._forget_run()
        if self._is_configuring:
            return
        self._disconnect()
        self._bench = Bench(self.parameters, VisaLink)
        for number, identity in self._bench.identities.items():
            self.get_logger().info(f"oscilloscope {number}: {identity}")
        if self._timer is None:
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._timer = self.create_timer(_TICK, self._on_tick, clock=steady)

    def deactivate(self) -> None:
        """Leave no voltage on, and let go of the instruments."""
        super().deactivate()
        self._disconnect()

    def finish(self) -> None:
        """Leave no voltage on, and let go of the instruments, because the process ends."""
        super().finish()
        self._disconnect()

    def _disconnect(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None
        self._drop_job()
        if self._last_job is not None:
            self._last_job.join(self.parameters.reply_timeout + _ENDING_TIME)
            self._last_job = None
        if self._bench is not None:
            self._bench.close()
            self._bench = None

    # ---- voltage -------------------------------------------------------------------------

    @property
    def consumed(self) -> int:
        """Number of samples acknowledged."""
        return self._consumed

    @property
    def is_voltage_on(self) -> bool:
        """Whether the generator plays."""
        return self._bench is not None and self._bench.is_on

    def ramp_down(self) -> None:
        """Bring the voltage to zero; there will be no record of it."""
        assert self._bench is not None
        self._is_stopped.set()
        self._bench.ramp_down()

    def _drop_job(self) -> None:
        """Let go of a measurement whose result is of no interest any more."""
        self._is_stopped.set()
        if self._job is not None:
            self._job.is_cancelled.set()
            self._last_job, self._job = self._job, None

    def on_fault(self, reason: str) -> None:
        """Bring the voltage to zero, tell the generator, and drop the measurement."""
        self._is_stopped.set()
        super().on_fault(reason)
        self._drop_job()
        self._blocks = iter(())

    # ---- a run ---------------------------------------------------------------------------

    def _forget_run(self) -> None:
        self._is_stopped = threading.Event()
        self._ledger: StreamLedger | None = None
        self._voltage = np.zeros(0)
        self._plans: dict[int, RatePlan] = {}
        self._consumed = 0
        self._blocks = iter(())
        self._is_publishing = False
        self._flags = 0
        self._last_pulse = 0.0

    def leave_run(self) -> None:
        """Leave no voltage on, because another run begins."""
        self._drop_job()
        self.bring_down()

    def begin_run(self, program: DriveProgram) -> None:
        """Check that the instruments can do it, and say what is measured."""
        super().begin_run(program)
        self._drop_job()
        self._forget_run()
        assert self._bench is not None
        self._plans = self._bench.plan(program)
        for number, plan in self._plans.items():
            if plan.rate != program.sample_rate:
                self.get_logger().info(
                    f"oscilloscope {number} samples at {plan.rate:g} Hz; read at the program's "
                    f"{program.sample_rate:g} Hz, {self.parameters.highest_frequency:g} Hz is "
                    f"wrong by at most {plan.error_bound:.1e}"
                )
        self._voltage = np.zeros(program.length)
        self._ledger = StreamLedger(
            topics.DRIVE_VOLTAGE.name, program.run_id, sample_rate=program.sample_rate
        )
        for channel in self._bench.describe(self._plans):
            message = channel_to_message(self.types, channel, program.run_id, program.epoch)
            self.publish(self._channels, message)

    def process_block(self, block: SampleBlock) -> None:
        """Collect a block of the voltage."""
        if self._is_down or self._ledger is None or self._is_measured:
            return
        assert self.program is not None
        self._silent_ticks = 0
        self._ledger.accept(block)
        if block.end_index > len(self._voltage):
            raise BadInputError(
                "goes on after the end of the program", where="drive/voltage: sample",
                value=block.end_index, bound=f"<= {len(self._voltage)}",
            )  # fmt: skip
        check_voltage(block.samples, block.first_index, self.parameters.generator)
        self._voltage[block.first_index : block.end_index] = block.samples
        self._consumed = min(block.end_index, self.program.length - 1)
        self._report(0)
        self._measure_if_complete()

    @property
    def _is_measured(self) -> bool:
        """Whether the run is being measured, or has been."""
        return self._job is not None or self._is_publishing

    def change_run(self, program: DriveProgram) -> None:
        """Stop what is played; a run that has not begun is measured without voltage."""
        super().change_run(program)
        if program.ending is Ending.ABANDONED:
            self._drop_job()
            return
        if program.ending is not Ending.STOPPED or self.fault:
            return
        self._is_stopped.set()
        if self._bench is not None:
            self._bench.ramp_down()
        if not self._is_down:
            self._measure_if_complete()

    def _measure_if_complete(self) -> None:
        if self.program is None or self._bench is None or self._is_measured:
            return
        if self._ledger is None or self._ledger.received < self.program.length:
            return
        if self._last_job is not None and self._last_job.is_running:
            return  # the instruments are still held by a run that was left; see `_on_tick`
        self._last_job = None
        voltage = self._voltage[: self.program.length]
        self._job = _Job(self._bench, self.program, voltage, self._plans, self._is_stopped)

    # ---- what comes of it ----------------------------------------------------------------

    def _on_tick(self) -> None:
        if self.is_active and not self._is_down:
            self._guarded(self._advance)(None)

    def _advance(self, _: None) -> None:
        self._measure_if_complete()
        if self._job is not None:
            self._take_result(self._job)
        elif self._is_publishing:
            self._publish_next()

    def _take_result(self, job: _Job) -> None:
        if job.is_running:
            if time.monotonic() - self._last_pulse > _PULSE_INTERVAL:
                self._last_pulse = time.monotonic()
                self._report(0)
            return
        self._job = None
        if job.result is None:
            raise DriveFaultError(job.error)
        assert self.program is not None
        self._is_publishing = True
        self._blocks = self._cut(self.program, job.result)

    def _publish_next(self) -> None:
        """Publish the next block of every channel; after the last acknowledge the run's end."""
        blocks = next(self._blocks, None)
        if blocks is not None:
            for block in blocks:
                self.publish_block(block)
                self._flags |= block.flags
            return
        assert self.program is not None
        self._is_publishing = False
        self._ledger = None
        self._consumed = self.program.length
        self._report(self._flags & int(SampleFlag.RAMPED_DOWN))

    def _cut(
        self, program: DriveProgram, measured: Measurement
    ) -> Iterator[tuple[SampleBlock, ...]]:
        """Yield the blocks of all channels, those of the same samples together."""
        size = self.parameters.block_length
        ramped_from = measured.ramped_from
        for sequence, first in enumerate(range(0, program.length, size)):
            end = min(first + size, program.length)
            is_ramped = ramped_from is not None and end > ramped_from
            moment = sample_time(program.epoch, first, program.sample_rate)
            yield tuple(
                SampleBlock(
                    name,
                    program.run_id,
                    moment,
                    sequence,
                    first,
                    program.sample_rate,
                    unit_of(name),
                    _flags(bool(measured.is_limited[name][first:end].any()), is_ramped),
                    samples[first:end],
                )
                for name, samples in measured.samples.items()
            )

    def status_values(self) -> dict[str, object]:
        """Return run id, progress and what is being done."""
        run_id = self.program.run_id if self.program else ""
        collected = self._ledger.received if self._ledger else 0
        values: dict[str, object] = {"run_id": run_id, "consumed": self._consumed}
        values.update(collected=collected, voltage_on=self.is_voltage_on)
        for number, plan in self._plans.items():
            values[f"oscilloscope_{number}.sample_rate"] = plan.rate
            values[f"oscilloscope_{number}.interpolation_error"] = f"{plan.error_bound:.1e}"
        return values


def _flags(is_limited: bool, is_ramped: bool) -> int:
    flags = SampleFlag.OVER_RANGE if is_limited else SampleFlag(0)
    return int(flags | SampleFlag.RAMPED_DOWN) if is_ramped else int(flags)


def main() -> int:
    """Run the node."""
    return run_node(ScpiBenchNode)

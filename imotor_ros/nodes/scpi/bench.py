"""The bench: generator and oscilloscopes through one run, from a voltage to measured samples."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.errors import InstrumentError
from imotor_ros.nodes.scpi.dialect import (
    GeneratorDialect,
    OscilloscopeDialect,
    load_dialect,
)
from imotor_ros.nodes.scpi.generator import Generator, check_program
from imotor_ros.nodes.scpi.instrument import Instrument
from imotor_ros.nodes.scpi.link import LinkMaker
from imotor_ros.nodes.scpi.oscilloscope import POLL_TIME, Oscilloscope
from imotor_ros.nodes.scpi.rates import RatePlan, plan_rate
from imotor_ros.nodes.scpi.settings import BenchSettings, describe, step_of

_TRIGGER_LATENCY = 5e-3
"""Longest time (s) from sending the trigger to the first sample of the record."""


class Cancelled(Exception):
    """The measurement is of no interest any more."""


@dataclass(frozen=True)
class Measurement:
    """
    What was measured in a run.

    Attributes
    ----------
    samples : dict
        Samples (SI unit) at those of the program, by channel.
    is_limited : dict
        Which of them rest on a converter or a transducer at an end of its range.
    ramped_from : int or None
        First sample whose voltage may not be that of the program because of a stop.

    """

    samples: dict[str, NDArray[np.float64]]
    is_limited: dict[str, NDArray[np.bool_]]
    ramped_from: int | None


class Bench:
    """
    Generator and oscilloscopes.

    One thread measures; `ramp_down` may come from another one.

    Parameters
    ----------
    settings : BenchSettings
        The bench.
    make_link : callable
        Makes a connection; see `LinkMaker`.

    Raises
    ------
    BadInputError
        If a dialect cannot be had.
    InstrumentError
        If an instrument is not there, is another one, or reports an error.

    """

    def __init__(self, settings: BenchSettings, make_link: LinkMaker) -> None:
        self.settings = settings
        self._make_link = make_link
        self._scopes: dict[int, Oscilloscope] = {}
        self._is_cancelled = threading.Event()
        self._stopped_at = 0.0
        self._generator = self._open_generator()
        try:
            for number in settings.oscilloscopes:
                self._scopes[number] = self._open_oscilloscope(number)
        except BaseException:
            self.close()
            raise

    def _connect(
        self, name: str, address: str, serial: str, dialect: GeneratorDialect | OscilloscopeDialect
    ) -> Instrument:
        timeouts = self.settings.connect_timeout, self.settings.reply_timeout
        return Instrument(name, address, serial, dialect, self._make_link, timeouts)

    def _open_generator(self) -> Generator:
        settings = self.settings.generator
        dialect = load_dialect(settings.dialect, GeneratorDialect)
        tool = self._connect("generator", settings.address, settings.serial, dialect)
        return Generator(tool, dialect, settings)

    def _open_oscilloscope(self, number: int) -> Oscilloscope:
        settings = self.settings.oscilloscopes[number]
        dialect = load_dialect(settings.dialect, OscilloscopeDialect)
        name = f"oscilloscope {number}"
        tool = self._connect(name, settings.address, settings.serial, dialect)
        ranges = {
            one.input: one.input_range
            for one in self.settings.channels.values()
            if one.oscilloscope == number
        }
        return Oscilloscope(tool, dialect, settings, ranges)

    @property
    def identities(self) -> dict[int, str]:
        """What the oscilloscopes are, by number."""
        return {number: one.instrument.identity for number, one in self._scopes.items()}

    @property
    def is_on(self) -> bool:
        """Whether a voltage may be on."""
        return self._generator.is_on

    def plan(self, program: DriveProgram) -> dict[int, RatePlan]:
        """
        Return how the oscilloscopes sample a program, by number.

        Raises
        ------
        BadInputError
            If generator or oscilloscopes cannot do what it needs.

        """
        check_program(program, self.settings.generator)
        return {
            number: plan_rate(
                length=program.length,
                sample_rate=program.sample_rate,
                delay=self.settings.trigger_delay,
                rates=one.sample_rates,
                memory=one.memory,
                highest_frequency=self.settings.highest_frequency,
                tolerance=self.settings.resampling_tolerance,
                where=f"oscilloscope {number}",
            )
            for number, one in self.settings.oscilloscopes.items()
        }

    def describe(self, plans: dict[int, RatePlan]) -> tuple[ChannelDescription, ...]:
        """Return the descriptions of all channels of a run."""
        return tuple(
            describe(name, self.settings, plans[one.oscilloscope].rate, self.identities)
            for name, one in self.settings.channels.items()
        )

    def measure(
        self,
        program: DriveProgram,
        voltage: NDArray[np.float64],
        plans: dict[int, RatePlan],
        is_stopped: threading.Event,
        is_cancelled: threading.Event,
    ) -> Measurement:
        """
        Put out a voltage and return what all channels showed.

        Parameters
        ----------
        program : DriveProgram
            The run.
        voltage : ndarray, shape (n,)
            Drive voltage (V).
        plans : dict
            As from `plan`.
        is_stopped : Event
            Set when the run is stopped: before the trigger 0 V are put out instead of the voltage.
        is_cancelled : Event
            Set when the measurement is of no interest any more.

        Raises
        ------
        InstrumentError
            If an instrument does not do what it is told; the output is off then as far as can be
            known.
        Cancelled
            If `is_cancelled` was set.

        """
        self._is_cancelled = is_cancelled
        try:
            return self._measure(program, voltage, plans, is_stopped)
        except InstrumentError as error:
            raise self._made_safe(error) from error
        except Cancelled:
            self._generator.make_safe()
            raise

    def _made_safe(self, error: InstrumentError) -> InstrumentError:
        """Switch off after an error; say so if that cannot be told."""
        if self._generator.make_safe():
            return error
        more = "; whether the output is off is not known: the record itself ends at 0 V"
        return InstrumentError(error.instrument, error.command, error.what + more)

    def _measure(
        self,
        program: DriveProgram,
        voltage: NDArray[np.float64],
        plans: dict[int, RatePlan],
        is_stopped: threading.Event,
    ) -> Measurement:
        self._stopped_at = 0.0
        plays = not is_stopped.is_set() and self._play(program, voltage, plans, is_stopped)
        if not plays:
            # stopped before the trigger: the streams get their samples, the motor no voltage
            self._play(program, np.zeros(len(voltage)), plans, threading.Event())
        started = time.monotonic()
        self._await_records(len(voltage) / program.sample_rate)
        self._generator.disable()
        self._generator.instrument.check_errors("after the record")
        ramped_from = None if plays else 0
        if self._stopped_at:
            late = self._stopped_at - started - _TRIGGER_LATENCY
            ramped_from = max(0, int(late * program.sample_rate))
        return self._collect(program, len(voltage), ramped_from)

    def _play(
        self,
        program: DriveProgram,
        voltage: NDArray[np.float64],
        plans: dict[int, RatePlan],
        is_stopped: threading.Event,
    ) -> bool:
        self._generator.load(voltage, program.sample_rate)
        for number, scope in self._scopes.items():
            self._check_cancelled()
            scope.arm(plans[number], self.settings.arm_timeout)
        return self._generator.trigger(is_stopped)

    def _await_records(self, duration: float) -> None:
        longest = duration + self.settings.trigger_timeout
        deadline = time.monotonic() + longest
        waiting = list(self._scopes.values())
        while True:
            self._check_cancelled()
            waiting = [scope for scope in waiting if not scope.is_done()]
            if not waiting:
                return
            if time.monotonic() > deadline:
                for scope in waiting:
                    with suppress(InstrumentError):
                        scope.give_up()
                raise waiting[0].no_trigger(longest)
            time.sleep(POLL_TIME)

    def _collect(self, program: DriveProgram, length: int, ramped_from: int | None) -> Measurement:
        samples, limited = {}, {}
        rate, delay = program.sample_rate, self.settings.trigger_delay
        for name, one in self.settings.channels.items():
            self._check_cancelled()
            scope = self._scopes[one.oscilloscope]
            record = scope.read(one.input)
            if not record.covers(delay, delay + (length - 1) / rate):
                raise scope.instrument.fault(
                    f"input {one.input}",
                    f"the record of {len(record.volts)} samples begins {record.start:.6g} s after "
                    f"the trigger, which does not hold the run's {length / rate:.6g} s",
                )
            volts, is_limited = record.read(delay, 1.0 / rate, length)
            step = step_of(name, self.settings)
            values = samples[name] = np.rint(volts * (one.factor / step)) * step
            limited[name] = is_limited | (np.abs(values) >= one.span)
        return Measurement(samples, limited, ramped_from)

    def _check_cancelled(self) -> None:
        if self._is_cancelled.is_set():
            raise Cancelled

    def ramp_down(self) -> bool:
        """
        Bring the voltage to zero, if it is on; return whether it was.

        Raises
        ------
        InstrumentError
            If the generator cannot be told.

        """
        at = time.monotonic()
        if not self._generator.ramp_down():
            return False
        self._stopped_at = at
        return True

    def close(self) -> None:
        """Bring the voltage to zero and let go of all instruments."""
        self._generator.close()
        for scope in self._scopes.values():
            scope.close()

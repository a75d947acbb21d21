"""The waveform generator: takes a whole drive voltage, plays it once, goes to zero when told."""

from __future__ import annotations

import threading
import time

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.drive import DriveProgram
from imotor_ros.errors import BadInputError, InstrumentError
from imotor_ros.nodes.scpi.dialect import GeneratorDialect
from imotor_ros.nodes.scpi.instrument import Instrument, fill
from imotor_ros.nodes.scpi.settings import GeneratorSettings

_NAME = "imotor"


def check_program(program: DriveProgram, settings: GeneratorSettings) -> None:
    """
    Check that the generator can play a program.

    Raises
    ------
    BadInputError
        If its rate or its memory does not do, or the program does not start and end at 0 V.

    """
    rate = program.sample_rate
    if not settings.lowest_rate <= rate <= settings.highest_rate:
        raise BadInputError(
            "is none of the generator's", where="drive/program: sample_rate", value=rate,
            bound=f"{settings.lowest_rate:g} to {settings.highest_rate:g} Hz",
        )  # fmt: skip
    if program.length + 1 > settings.memory:
        raise BadInputError(
            "is longer than the generator's memory with the 0 V at its end",
            where=f"drive/program: length of {program.run_id}", value=program.length,
            bound=f"<= {settings.memory - 1} samples ({(settings.memory - 1) / rate:.4g} s at "
            f"{rate:g} Hz)",
        )  # fmt: skip
    ends = program.render(0, 1)[0], program.render(program.length, 1)[0]
    for place, voltage in zip(("starts", "ends"), ends, strict=True):
        if abs(voltage) > 1e-9:
            raise BadInputError(
                f"{place} with a voltage, at which the generator would stay",
                where=f"drive/program: {program.run_id}", value=float(voltage), bound="0 V",
            )  # fmt: skip


def check_voltage(voltage: NDArray[np.float64], first: int, settings: GeneratorSettings) -> None:
    """
    Check samples of the drive voltage (V).

    Raises
    ------
    BadInputError
        If one is not a number, or beyond what motor or generator may be given.

    """
    least = max(settings.lowest_drive_voltage, -settings.highest_voltage * settings.amplifier_gain)
    most = min(settings.highest_drive_voltage, settings.highest_voltage * settings.amplifier_gain)
    good = (voltage >= least) & (voltage <= most)
    if not good.all():
        at = int(np.argmin(good))
        raise BadInputError(
            "is out of range", where=f"drive/voltage: sample {first + at}",
            value=float(voltage[at]), bound=f"{least:g} to {most:g} V",
        )  # fmt: skip


class Generator:
    """
    A waveform generator whose output is off, unless a record is being played.

    Parameters
    ----------
    instrument : Instrument
        The connection.
    dialect : GeneratorDialect
        How to talk to it.
    settings : GeneratorSettings
        Ranges.

    Attributes
    ----------
    is_enabled, is_on : bool
        Whether the output may be switched on, and whether it may show more than 0 V.

    Notes
    -----
    Voltages are scaled about 0 V, which is a whole word: before the trigger and after the record
    the output shows exactly that. A stop may come from another thread.
    """

    def __init__(
        self, instrument: Instrument, dialect: GeneratorDialect, settings: GeneratorSettings
    ) -> None:
        self.instrument = instrument
        self.is_on = False
        self.is_enabled = False
        self._dialect = dialect
        self._settings = settings
        self._lock = threading.Lock()
        self._values: dict[str, object] = {"output": settings.output, "name": _NAME}
        instrument.tell_all(dialect.reset, self._values)
        instrument.tell_all(dialect.disable, self._values)
        instrument.tell_all(settings.setup.splitlines(), {})

    def load(self, voltage: NDArray[np.float64], rate: float) -> None:
        """
        Upload a drive voltage and wait for the trigger.

        Parameters
        ----------
        voltage : ndarray, shape (n,)
            Drive voltage (V) at the motor.
        rate : float
            Samples per second (Hz).

        """
        settings, words = self._settings, self._dialect.words
        record = np.zeros(max(len(voltage) + 1, self._dialect.shortest_record))
        record[: len(voltage)] = voltage / settings.amplifier_gain
        peak = float(np.max(np.abs(record)))
        full = max(peak, 0.5 * settings.least_peak_to_peak)
        duration = len(record) / rate
        self._values.update(
            points=len(record), rate=rate, duration=duration, frequency=1.0 / duration,
            peak_to_peak=2.0 * full,
        )  # fmt: skip
        with self._lock:
            self.instrument.tell_all(self._dialect.arrange, self._values)
            upload = fill(self._dialect.upload, self._values)
            self.instrument.tell(upload, words.encode(record / full))
            self.instrument.check_errors(upload)
            self.is_enabled = True
            self.instrument.tell_all(self._dialect.enable, self._values)

    def trigger(self, is_stopped: threading.Event) -> bool:
        """Start the record, unless it is stopped; return whether it plays."""
        with self._lock:
            if is_stopped.is_set():
                return False
            self.is_on = True
            self.instrument.tell(self._dialect.trigger)
            return True

    def ramp_down(self) -> bool:
        """Bring the voltage to zero in steps of the amplitude, switch off; return if it was on."""
        if not self.is_on:
            return False  # an upload may hold the lock; after a stop there is no trigger
        with self._lock:
            if self._is_off():
                return False  # the record came to its end meanwhile
            try:
                if self._dialect.amplitude:
                    self._step_down()
            finally:
                self._disable()
            return True

    def _is_off(self) -> bool:
        return not self.is_on

    def _step_down(self) -> None:
        settings = self._settings
        full = float(str(self._values["peak_to_peak"]))
        start = time.monotonic()
        for step in range(1, settings.ramp_steps + 1):
            size = full * (1.0 - step / settings.ramp_steps)
            values = {**self._values, "peak_to_peak": max(size, settings.least_peak_to_peak)}
            self.instrument.tell(fill(self._dialect.amplitude, values))
            due = start + settings.ramp_time * step / settings.ramp_steps
            time.sleep(max(0.0, due - time.monotonic()))

    def _disable(self) -> None:
        """Switch the output off; it counts as on if that cannot be told."""
        for template in self._dialect.disable:
            self.instrument.tell(fill(template, self._values))
        self.is_on = self.is_enabled = False

    def disable(self) -> None:
        """Switch the output off at once; at the end of a record that is 0 V already."""
        with self._lock:
            self._disable()
        self.instrument.check_errors("; ".join(self._dialect.disable))

    def make_safe(self) -> bool:
        """Bring the voltage to zero and switch off; return whether that could be told."""
        try:
            self.ramp_down()
            with self._lock:
                if self.is_enabled:
                    self._disable()
        except InstrumentError:
            return False
        return True

    def close(self) -> None:
        """Make safe and let go, as far as the connection lets."""
        self.make_safe()
        self.instrument.close()

"""What the generator's voltage does to the motor, and what comes out of the transducers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.channel import LOAD_FORCE, ROD_VELOCITY, SLIDER_VELOCITY
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.force_sensor import ForceSensor
from imotor_ros.core.motor import VirtualMotor
from imotor_ros.core.stand import StandParameters
from imotor_ros.core.vibrometer import Vibrometer

Samples = NDArray[np.float64]

WIRES = ("rod_velocity", "slider_velocity", "load_force", "voltage_monitor", "current")
"""Where an input can be connected to."""

_FINE = DigitiserParameters(bits=32)


@dataclass(frozen=True)
class Signals:
    """
    Voltages on the wires during a run.

    Attributes
    ----------
    rate : float
        Samples per second (Hz).
    start : float
        Time of the first sample after the trigger (s).
    volts : dict
        Samples (V) by wire.

    """

    rate: float
    start: float
    volts: dict[str, Samples]


class Laboratory:
    """
    A motor with its amplifier, two vibrometers and a force sensor, and wires to the instruments.

    The motor is at rest before every run. Only one run at a time.

    Parameters
    ----------
    stand : StandParameters
        Motor and transducers; their digitisers are left out, the oscilloscope has its own.
    seed : int
        Seed of what is random in the transducers.
    amplifier_gain : float
        Voltage at the motor over that of the generator.
    volts_per_unit : dict
        What a transducer makes of one SI unit (V), by wire.

    """

    def __init__(
        self,
        stand: StandParameters,
        seed: int,
        amplifier_gain: float,
        volts_per_unit: dict[str, float],
    ) -> None:
        self._stand = stand
        self._seed = seed
        self._gain = amplifier_gain
        self._factors = volts_per_unit
        self._lock = threading.Lock()
        self._changes: list[tuple[float, float]] = []
        self._started = 0.0
        self._listeners: list[Callable[[], Callable[[Signals], None] | None]] = []
        self.runs = 0
        self.peak = 0.0

    def listen(self, take_trigger: Callable[[], Callable[[Signals], None] | None]) -> None:
        """Give the trigger to an oscilloscope; what it returns gets the signals."""
        self._listeners.append(take_trigger)

    def play(self, record: Samples, rate: float, amplitude: float) -> None:
        """Put out a record, between -1 and 1, once, as it takes in real time."""
        with self._lock:
            self._changes = [(0.0, amplitude)]
            self._started = time.monotonic()
            self.runs += 1
        takers = [taker for listen in self._listeners if (taker := listen()) is not None]
        work = threading.Thread(target=self._carry_out, args=(record, rate, takers), daemon=True)
        work.start()

    def change(self, amplitude: float) -> None:
        """Change the amplitude (V) of what is being played, now."""
        with self._lock:
            self._changes.append((time.monotonic() - self._started, amplitude))

    def _carry_out(
        self, record: Samples, rate: float, takers: list[Callable[[Signals], None]]
    ) -> None:
        end = self._started + len(record) / rate
        threading.Event().wait(max(0.0, end - time.monotonic()))
        with self._lock:
            changes = list(self._changes)
        amplitude = np.zeros(len(record))
        for moment, value in changes:
            amplitude[int(moment * rate) :] = value
        drive = self._gain * amplitude * record
        self.peak = float(np.max(np.abs(drive), initial=0.0))
        signals = self._respond(drive, rate)
        for take in takers:
            take(signals)

    def _respond(self, drive: Samples, rate: float) -> Signals:
        """Return the voltages on the wires; the motor is at rest before and runs on after."""
        around = round(2e-3 * rate)
        voltage = np.concatenate([np.zeros(around), drive, np.zeros(around)])
        stand, seed = self._stand, self._seed
        parameters = replace(
            stand.motor,
            voltage_monitor=replace(stand.motor.voltage_monitor, digitiser=_FINE),
            current_monitor=replace(stand.motor.current_monitor, digitiser=_FINE),
        )
        motor = VirtualMotor(parameters, rate, seed).process(voltage)
        rod = Vibrometer(replace(stand.rod_vibrometer, digitiser=_FINE), rate, seed, ROD_VELOCITY)
        slider = Vibrometer(
            replace(stand.slider_vibrometer, digitiser=_FINE), rate, seed, SLIDER_VELOCITY
        )
        force = ForceSensor(replace(stand.force_sensor, digitiser=_FINE), rate, seed, LOAD_FORCE)
        shown = {
            "rod_velocity": rod.process(motor.rod_velocity)[0],
            "slider_velocity": slider.process(motor.slider_velocity)[0],
            "load_force": force.process(motor.load_force)[0],
            "voltage_monitor": motor.voltage_monitor,
            "current": motor.current,
        }
        volts = {wire: samples * self._factors[wire] for wire, samples in shown.items()}
        return Signals(rate, -around / rate, volts)

"""
A streaming card that is not there: one analogue output and five inputs on one clock.

Behind its connectors are an amplifier, the virtual motor and virtual instruments. Everything at the
connectors is in volts, as at a card; only who wires it knows what a volt means.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping

import numpy as np

from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    ChannelDescription,
    SampleFlag,
)
from imotor_ros.core.force_sensor import ForceSensor
from imotor_ros.core.motor import VirtualMotor
from imotor_ros.core.samples import Samples
from imotor_ros.core.stand import StandParameters
from imotor_ros.core.vibrometer import Vibrometer
from imotor_ros.errors import InstrumentError

INPUTS = (VOLTAGE, CURRENT, ROD_VELOCITY, SLIDER_VELOCITY, LOAD_FORCE)
"""What is wired to the inputs 0 to 4."""

OUTPUT_RANGE = 10.0
"""Largest voltage (V) of the card's output."""

_STEPS = 65536
_NAME = "simulated card"


class SimulatedCard:
    """
    A streaming card wired to a simulated rig.

    The output has 16 bits over +-10 V and a memory of some samples. The clock runs while there is
    something in it, and stops, the output held, when it is empty: so do cards whose clock is gated.

    Parameters
    ----------
    rig : StandParameters
        Amplifier, motor and instruments at its connectors.
    amplifier_gain : float
        Gain of the amplifier between output and stator (V/V).
    sensitivities : mapping of str to float
        What a volt at an input means, by channel (SI unit per V).
    memory : int
        Samples that the output memory holds.
    pace : float
        Speed of the clock over that of the world; 0 for as fast as it computes.
    clock : callable
        Returns the time (s) by which it is paced.

    Attributes
    ----------
    underruns : int
        How often the output memory was empty and the clock had to stop, since the start.

    """

    def __init__(
        self,
        rig: StandParameters,
        *,
        amplifier_gain: float,
        sensitivities: Mapping[str, float],
        memory: int = 100_000,
        pace: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._rig = rig
        self._gain = amplifier_gain
        self._sensitivities = dict(sensitivities)
        self._memory = memory
        self._pace = pace
        self._clock = clock
        self._queue: deque[Samples] = deque()
        self._queued = 0
        self._due = 0.0
        self._seen = clock()
        self._has_begun = False
        self._motor: VirtualMotor | None = None
        self.underruns = 0

    def start(self, sample_rate: float, seed: int) -> None:
        """Start anew at rest with a sample rate (Hz); `seed` is of what is random in this world."""
        rig = self._rig
        self._rate = sample_rate
        self._motor = VirtualMotor(rig.motor, sample_rate, seed)
        self._rod = Vibrometer(rig.rod_vibrometer, sample_rate, seed, ROD_VELOCITY)
        self._slider = Vibrometer(rig.slider_vibrometer, sample_rate, seed, SLIDER_VELOCITY)
        self._force = ForceSensor(rig.force_sensor, sample_rate, seed, LOAD_FORCE)
        self._queue.clear()
        self._queued = self.underruns = 0
        self._has_begun = False
        self._due, self._seen = 0.0, self._clock()

    def data_sheets(self) -> dict[str, ChannelDescription]:
        """Return what the data sheets of amplifier and instruments say, by channel."""
        assert self._motor is not None
        described = (
            *self._motor.channels,
            *(x.channel for x in (self._rod, self._slider, self._force)),
        )
        return {one.name: one for one in described}

    def write(self, volts: Samples) -> None:
        """
        Append samples to the output memory (V at the connector).

        Raises
        ------
        InstrumentError
            If they do not fit, or are beyond the range.

        """
        if self._queued + len(volts) > self._memory:
            raise InstrumentError(
                _NAME, "write", f"output memory of {self._memory} samples is full"
            )
        if len(volts) and not float(np.abs(volts).max()) <= OUTPUT_RANGE:
            raise InstrumentError(_NAME, "write", f"beyond +-{OUTPUT_RANGE:g} V")
        if not self._queued:
            self.underruns += self._has_begun
            self._has_begun = True
            self._due, self._seen = 0.0, self._clock()  # the clock stood
        self._queue.append(volts)
        self._queued += len(volts)

    def read(self) -> tuple[dict[str, Samples], dict[str, int]]:
        """Return what was converted since the last call: volts at the inputs, and overloads."""
        parts = []
        wanted = self._converted()
        self._queued -= wanted
        while wanted > 0:
            part = self._queue.popleft()
            if len(part) > wanted:
                self._queue.appendleft(part[wanted:])
                part = part[:wanted]
            parts.append(part)
            wanted -= len(part)
        return self._convert(np.concatenate(parts)) if parts else ({}, {})

    def _converted(self) -> int:
        """Return how many samples the clock has taken out of the memory since the last call."""
        if self._pace == 0.0:
            return self._queued
        now = self._clock()
        self._due += (now - self._seen) * self._rate * self._pace
        self._seen = now
        whole = min(math.floor(self._due), self._queued)
        self._due -= whole
        return whole

    def _convert(self, volts: Samples) -> tuple[dict[str, Samples], dict[str, int]]:
        assert self._motor is not None
        step = 2.0 * OUTPUT_RANGE / _STEPS
        put_out = self._gain * step * np.clip(np.rint(volts / step), -_STEPS // 2, _STEPS // 2 - 1)
        motor = self._motor.process(put_out)
        shown = {
            VOLTAGE: (motor.voltage_monitor, motor.voltage_monitor_flags),
            CURRENT: (motor.current, motor.current_flags),
            ROD_VELOCITY: self._rod.process(motor.rod_velocity),
            SLIDER_VELOCITY: self._slider.process(motor.slider_velocity),
            LOAD_FORCE: self._force.process(motor.load_force),
        }
        volts_in = {name: values / self._sensitivities[name] for name, (values, _) in shown.items()}
        return volts_in, {name: int(flags) for name, (_, flags) in shown.items() if flags}

    def reset(self) -> None:
        """Forget what is in the memory and put out 0 V at once."""
        self._queue.clear()
        self._queued = 0
        if self._motor is not None:
            self._motor.process(np.zeros(1))


def drive_flags(flags: Mapping[str, int]) -> int:
    """Return what of the flags of the voltage monitor is about the amplifier."""
    limits = SampleFlag.VOLTAGE_CLIPPED | SampleFlag.SLEW_LIMITED | SampleFlag.CURRENT_LIMITED
    return int(flags.get(VOLTAGE, 0) & limits)

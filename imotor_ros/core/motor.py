"""
The virtual motor: from the drive voltage to what rod and slider truly do.

::

    voltage -> amplifier -> stator -> slider on the rod (friction, load, end stops)
                  |            |
            voltage monitor  current monitor
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.amplifier import Amplifier, AmplifierParameters
from imotor_ros.core.channel import ChannelDescription, SampleFlag
from imotor_ros.core.drive_limits import DriveLimits
from imotor_ros.core.friction import FRICTION_LAWS, FrictionLaw
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.lugre import LuGreFriction, LuGreStepper
from imotor_ros.core.monitor import CurrentMonitorParameters, Monitor, VoltageMonitorParameters
from imotor_ros.core.parameters import Parameters, choice, group
from imotor_ros.core.samples import Samples, checked_sample_rate
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.stator import Stator, StatorParameters
from imotor_ros.core.stepping import SliderStepper

MOTOR_FRICTION_LAWS: Mapping[str, type[Parameters]] = {**FRICTION_LAWS, "lugre": LuGreFriction}
"""What the virtual motor knows beyond the models: a contact with a memory."""


@dataclass(frozen=True)
class MotorParameters(Parameters):
    """All constants of the motor with its amplifier; by default those of the paper's motor."""

    amplifier: AmplifierParameters = group(AmplifierParameters)
    stator: StatorParameters = group(StatorParameters)
    slider: SliderParameters = group(SliderParameters)
    friction: Parameters = choice("law", "velocity", MOTOR_FRICTION_LAWS)
    load: LoadParameters = group(LoadParameters)
    voltage_monitor: VoltageMonitorParameters = group(VoltageMonitorParameters)
    current_monitor: CurrentMonitorParameters = group(CurrentMonitorParameters)

    @property
    def drive_limits(self) -> DriveLimits:
        """What may be asked of amplifier and stator."""
        return DriveLimits(
            lowest_voltage=self.amplifier.lowest_voltage,
            highest_voltage=self.amplifier.highest_voltage,
            slew_rate=self.amplifier.slew_rate,
            current_limit=self.amplifier.current_limit,
            load_capacitance=self.stator.largest_capacitance,
        )


@dataclass(frozen=True)
class MotorResponse:
    """
    What the motor does, at the samples; arrays of shape (n,).

    Attributes
    ----------
    voltage_monitor, current : ndarray
        Voltage (V) and current (A) as the amplifier's monitors show them.
    rod_position, rod_velocity : ndarray
        True motion of the rod (m, m/s).
    slider_position, slider_velocity : ndarray
        True motion of the slider (m, m/s).
    load_force : ndarray
        True force (N) of the load on the slider, positive where it opposes forward motion.
    is_sticking : ndarray of bool
        Whether the slider sticks to the rod.
    stator_voltage, stator_current : ndarray
        True voltage (V) at the stator, and mean current (A) over the interval that ends at the
        sample.
    flags : SampleFlag
        VOLTAGE_CLIPPED, SLEW_LIMITED, CURRENT_LIMITED: what the amplifier could not follow.
    voltage_monitor_flags, current_flags : SampleFlag
        The same, and OVER_RANGE where that monitor saturates.

    """

    voltage_monitor: Samples
    current: Samples
    rod_position: Samples
    rod_velocity: Samples
    slider_position: Samples
    slider_velocity: Samples
    load_force: Samples
    is_sticking: NDArray[np.bool_]
    stator_voltage: Samples
    stator_current: Samples
    flags: SampleFlag
    voltage_monitor_flags: SampleFlag
    current_flags: SampleFlag


class VirtualMotor:
    """
    The motor with amplifier and monitors, driven by a stream of voltage.

    What rod and slider do depends on voltage and parameters alone; the seed concerns the
    monitors only. It starts at rest without voltage, the slider in the middle.

    Parameters
    ----------
    parameters : MotorParameters
        Constants.
    sample_rate : float
        Samples per second (Hz).
    seed : int
        Seed of the run.

    Raises
    ------
    BadInputError
        If the sample rate is no positive number or too low for stator or monitors, or the seed
        no whole number >= 0.

    """

    def __init__(self, parameters: MotorParameters, sample_rate: float, seed: int) -> None:
        self.parameters = parameters
        self.sample_rate = checked_sample_rate(sample_rate)
        rate = self.sample_rate
        # the amplifier has to feed what the stator takes at its largest signals
        capacitance = parameters.stator.largest_capacitance
        self._amplifier = Amplifier(parameters.amplifier, rate, load_capacitance=capacitance)
        self._stator = Stator(parameters.stator, rate)
        self._slider = _slider_stepper(parameters, rate)
        self._voltage_monitor = Monitor(parameters.voltage_monitor, rate, seed)
        self._current_monitor = Monitor(
            parameters.current_monitor, rate, seed, input_delay=self._stator.current_delay
        )

    @property
    def channels(self) -> tuple[ChannelDescription, ...]:
        """The monitors: voltage, then current."""
        return self._voltage_monitor.channel, self._current_monitor.channel

    def displacement_response(self, frequency: ArrayLike) -> Complex:
        """
        Return the rod displacement per wanted volt (m/V) at frequencies (Hz), shape (...).

        That of the sampled amplifier and the linear dynamics within their limits. Without
        hysteresis the rod does exactly this; with it, for sines where its gain is 1, but for
        its lag.
        """
        amplifier = self._amplifier.frequency_response(frequency)
        return np.asarray(amplifier * self._stator.frequency_response(frequency))

    def sine_response(self, frequency: ArrayLike, amplitude: ArrayLike) -> Complex:
        """
        Return the rod displacement per wanted volt (m/V) for sines, hysteresis included.

        Parameters
        ----------
        frequency : array_like, shape (...)
            Frequency (Hz) of the sine, and of the answer looked at.
        amplitude : array_like, shape (...)
            Wanted amplitude (V).

        """
        amplifier = self._amplifier.frequency_response(frequency)
        at_stator = np.abs(amplifier) * np.asarray(amplitude, dtype=np.float64)
        return np.asarray(amplifier * self._stator.sine_response(frequency, at_stator))

    def current_response(self, frequency: ArrayLike) -> Complex:
        """
        Return the stator current per wanted volt (A/V) at frequencies (Hz), shape (...).

        Charge of the clamped capacitance and of the moving rod, behind the sampled amplifier,
        where the hysteresis has unit gain.
        """
        frequency = np.asarray(frequency, dtype=np.float64)
        stator = self.parameters.stator
        amplifier = self._amplifier.frequency_response(frequency)
        charge = stator.clamped_capacitance + self._stator.moved_charge(frequency)
        return np.asarray(2j * np.pi * frequency * charge * amplifier)

    def process(self, voltage: ArrayLike) -> MotorResponse:
        """
        Return what the motor does during the next samples of the drive voltage (V), shape (n,).

        Raises
        ------
        BadInputError
            If a sample is not finite; the error names its index in the stream.
        SolverError
            If stick and slip change without end within one sample.

        """
        output, drive_flags = self._amplifier.process(voltage)
        rod = self._stator.process(output)
        slider = self._slider.process(rod.velocity, rod.acceleration)
        shown_voltage, voltage_flags = self._voltage_monitor.process(output)
        shown_current, current_flags = self._current_monitor.process(rod.current)
        return MotorResponse(
            voltage_monitor=shown_voltage,
            current=shown_current,
            rod_position=rod.position,
            rod_velocity=rod.velocity,
            slider_position=slider.position,
            slider_velocity=slider.velocity,
            load_force=slider.load_force,
            is_sticking=slider.is_sticking,
            stator_voltage=output,
            stator_current=rod.current,
            flags=drive_flags,
            voltage_monitor_flags=drive_flags | voltage_flags,
            current_flags=drive_flags | current_flags,
        )


def _slider_stepper(parameters: MotorParameters, rate: float) -> SliderStepper | LuGreStepper:
    """Return what moves the slider, as its friction law needs it."""
    slider, load, friction = parameters.slider, parameters.load, parameters.friction
    if isinstance(friction, LuGreFriction):
        return LuGreStepper(slider, load, friction, rate)
    return SliderStepper(slider, load, cast("FrictionLaw", friction), rate)

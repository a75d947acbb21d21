"""
The stator: a multilayer piezoelectric stack that moves the rod as one rigid body.

::

    voltage u -> hysteresis -> effective voltage w -> modes -> rod

The ceramic's hysteresis (see `hysteresis`) makes an effective voltage w of the voltage u. Modes
of the mechanical structure, driven by it side by side, move the rod by the sum of their x:

    x_i'' + 2 zeta_i w_i x_i' + w_i^2 x_i = w_i^2 g_i w       q = C u' + sum of alpha_i x_i

q is the charge. A share of the clamped capacitance C is charged by w instead of u, so that the
capacitance grows with the amplitude as the displacement does. Each mode is a piezoelectric
transducer with force factor alpha_i (N/V, or C/m) and stiffness alpha_i/g_i, the same for both,
which makes energy balance. Friction acts back on the rod by 1 N over that stiffness, some 0.04 um
of 15: neglected, as in the paper, where the rod's motion is imposed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.hysteresis import HYSTERESIS_MODELS, HysteresisModel, NoHysteresis, drag
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.parameters import Parameters, choice, parameter
from imotor_ros.core.samples import (
    Samples,
    checked_bandwidth,
    checked_sample_rate,
    checked_samples,
)

_FIT = "fitted to the linear row of table 1, amplitudes and phases"


@dataclass(frozen=True)
class StatorParameters(Parameters):
    """Constants of the stator with the rod, without slider; by default those of the paper."""

    static_gain: float = parameter(
        0.16398e-6, "displacement per effective volt at low frequency, both modes together",
        unit="m/V", low=0.0, excludes_low=True, source=_FIT,
    )  # fmt: skip
    resonance_frequency: float = parameter(
        36.21e3, "undamped resonance of the main mode", unit="Hz", low=0.0, excludes_low=True,
        source=_FIT,
    )  # fmt: skip
    damping_ratio: float = parameter(
        0.05, "damping ratio of the main mode", low=0.0, high=0.99,
        source="assumed, as glued joints have; table 1 does not show what lags as a delay does",
    )  # fmt: skip
    second_mode_share: float = parameter(
        -0.04211, "share of the second mode in the static gain; 0: there is none", low=-10.0,
        high=0.99, source=_FIT + ": the fourth harmonic moves less than one mode lets it",
    )  # fmt: skip
    second_resonance_frequency: float = parameter(
        19.89e3, "undamped resonance of the second mode", unit="Hz", low=0.0, excludes_low=True,
        source=_FIT,
    )  # fmt: skip
    second_damping_ratio: float = parameter(
        0.0165, "damping ratio of the second mode", low=0.0, high=0.99, source=_FIT
    )
    clamped_capacitance: float = parameter(
        0.7e-6, "capacitance with the rod held, for sines of unit gain of the hysteresis",
        unit="F", low=0.0, excludes_low=True,
        source="assumed: stacks of this stroke have 0.3 to 1.8 uF",
    )  # fmt: skip
    hysteretic_share: float = parameter(
        0.4, "share of the clamped capacitance that the effective voltage charges", low=0.0,
        high=1.0, source="assumed: capacitances grow by up to 70 % from small to large signals",
    )  # fmt: skip
    force_factor: float = parameter(
        4.0, "force per volt, and charge per displacement, of the main mode", unit="N/V", low=0.0,
        source="assumed: 23 N/um, and a coupling factor of 0.70",
    )  # fmt: skip
    hysteresis: Parameters = choice("model", "play", HYSTERESIS_MODELS)

    @classmethod
    def linear(cls) -> StatorParameters:
        """Return a stator of one mode without hysteresis, for which closed forms are exact."""
        return cls(
            static_gain=0.1645e-6,
            resonance_frequency=41e3,
            damping_ratio=0.02,
            second_mode_share=0.0,
            hysteresis=NoHysteresis(),
        )

    @property
    def hysteresis_model(self) -> HysteresisModel:
        """The hysteresis."""
        return cast("HysteresisModel", self.hysteresis)

    @property
    def mode_gains(self) -> tuple[float, float]:
        """Static gains g_i (m/V) of the two modes."""
        second = self.second_mode_share * self.static_gain
        return self.static_gain - second, second

    @property
    def mode_force_factors(self) -> tuple[float, float]:
        """Force factors alpha_i (N/V) of the two modes."""
        first, second = self.mode_gains
        return self.force_factor, self.force_factor * second / first

    @property
    def moved_capacitance(self) -> float:
        """Capacitance (F) that the motion of the rod adds at low frequency, at unit gain."""
        return sum(a * g for a, g in zip(self.mode_force_factors, self.mode_gains, strict=True))

    @property
    def free_capacitance(self) -> float:
        """Capacitance (F) at low frequency, rod free, where the hysteresis has unit gain."""
        return self.clamped_capacitance + self.moved_capacitance

    @property
    def largest_capacitance(self) -> float:
        """Slope (F) of the charge at low frequency once all plays are taken up."""
        return self.capacitance_at_gain(self.hysteresis_model.largest_gain)

    def capacitance_at_gain(self, gain: float) -> float:
        """Return the capacitance (F) at low frequency where the hysteresis has a real gain."""
        follows = self.hysteretic_share * self.clamped_capacitance + self.moved_capacitance
        return (1.0 - self.hysteretic_share) * self.clamped_capacitance + gain * follows

    @property
    def stiffness(self) -> float:
        """Stiffness (N/m) of either mode at the rod: force factor over gain of the main one."""
        return self.force_factor / self.mode_gains[0]

    @property
    def modes(self) -> tuple[tuple[float, float, float], ...]:
        """Static gain (m/V), resonance (Hz) and damping ratio of each mode."""
        first, second = self.mode_gains
        return (
            (first, self.resonance_frequency, self.damping_ratio),
            (second, self.second_resonance_frequency, self.second_damping_ratio),
        )

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return the displacement per effective volt (m/V) at frequencies (Hz), continuous."""
        at = np.asarray(frequency, dtype=np.float64)
        value = np.zeros(at.shape, dtype=np.complex128)
        for gain, resonance, damping in self.modes:
            ratio = at / resonance
            value = value + gain / (1.0 - ratio**2 + 2j * damping * ratio)
        return np.asarray(value)


class StatorResponse(NamedTuple):
    """
    What the stator does, at the samples; arrays of shape (n,).

    Attributes
    ----------
    position, velocity, acceleration : ndarray
        Of the rod (m, m/s, m/s^2).
    current : ndarray
        Mean current (A) over the sample interval that ends at the sample: its sum over the
        sample rate is the charge exactly. So it is half a sample late.

    """

    position: Samples
    velocity: Samples
    acceleration: Samples
    current: Samples


class Stator:
    """
    The stator, exact for an effective voltage that is linear between samples.

    Between samples the voltage is taken as linear, and so is the effective voltage: a play that
    is taken up within a sample bends it there, which is left out.

    Parameters
    ----------
    parameters : StatorParameters
        Constants.
    sample_rate : float
        Samples per second (Hz); at least twice the resonance frequencies.

    Raises
    ------
    BadInputError
        If a resonance is above half the sample rate.

    """

    def __init__(self, parameters: StatorParameters, sample_rate: float) -> None:
        self.parameters = parameters
        self.sample_rate = checked_sample_rate(sample_rate)
        self._modes = [_SampledMode(*mode, self.sample_rate) for mode in self._checked_modes()]
        rate, share = self.sample_rate, parameters.hysteretic_share
        self._constants = np.array(
            [
                parameters.clamped_capacitance * (1.0 - share) * rate,
                parameters.clamped_capacitance * share * rate,
                *(factor * rate for factor in parameters.mode_force_factors),
            ]
        )
        self._mode_constants = np.array([mode.constants for mode in self._modes])
        self._plays = parameters.hysteresis_model.numbers
        self._state = np.zeros(2 + 2 * len(self._modes))
        self._play_state = np.zeros(len(self._plays.thresholds))
        self._index = 0

    def _checked_modes(self) -> list[tuple[float, float, float]]:
        first, second = self.parameters.modes
        checked_bandwidth(first[1], self.sample_rate, where="stator.resonance_frequency")
        if second[0] == 0.0:
            # without a second mode its frequency is of no consequence: that of the first will do
            return [first, (0.0, *first[1:])]
        checked_bandwidth(second[1], self.sample_rate, where="stator.second_resonance_frequency")
        return [first, second]

    @property
    def current_delay(self) -> float:
        """Time (s) by which `StatorResponse.current` is late."""
        return 0.5 / self.sample_rate

    def process(self, voltage: ArrayLike) -> StatorResponse:
        """
        Return what the stator does during the next samples of the voltage (V), shape (n,).

        It starts at rest, with 0 V one sample before the stream and no hysteresis to remember.

        Raises
        ------
        BadInputError
            If a sample is not finite.

        """
        samples = checked_samples(voltage, where="stator voltage", first_index=self._index)
        response = StatorResponse(*(np.empty(len(samples)) for _ in range(4)))
        _move(
            samples,
            self._constants,
            self._mode_constants,
            *self._plays,
            self._state,
            self._play_state,
            *response,
        )
        self._index += len(samples)
        return response

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """
        Return the displacement per effective volt (m/V) at frequencies (Hz), as sampled.

        It differs from the continuous one by the linear interpolation, 0.1 % at 18.5 kHz and
        1 MS/s. Without hysteresis a voltage found from it is exact for the virtual motor.
        """
        turn = np.exp(2j * np.pi * np.asarray(frequency, dtype=np.float64) / self.sample_rate)
        return np.asarray(sum(mode.frequency_response(turn) for mode in self._modes))

    def moved_charge(self, frequency: ArrayLike) -> Complex:
        """Return the charge per effective volt (C/V) that the motion of the modes asks for."""
        turn = np.exp(2j * np.pi * np.asarray(frequency, dtype=np.float64) / self.sample_rate)
        factors = self.parameters.mode_force_factors
        pairs = zip(factors, self._modes, strict=True)
        return np.asarray(sum(factor * mode.frequency_response(turn) for factor, mode in pairs))

    def sine_response(self, frequency: ArrayLike, amplitude: ArrayLike) -> Complex:
        """
        Return the displacement per volt (m/V) for sines of an amplitude (V), shape (...).

        At the sine's own frequency (Hz); with hysteresis there are odd harmonics beside it.
        """
        gain = self.parameters.hysteresis_model.describing_function(amplitude)
        return np.asarray(gain * self.frequency_response(frequency))


class _SampledMode:
    """One mode of oscillation for a drive that is linear between samples."""

    def __init__(
        self, gain: float, frequency: float, damping_ratio: float, sample_rate: float
    ) -> None:
        omega = 2.0 * math.pi * frequency
        stiffness, damping = omega**2, 2.0 * damping_ratio * omega
        step = 1.0 / sample_rate
        system = np.array([[0.0, 1.0], [-stiffness, -damping]])
        drive = np.array([0.0, stiffness * gain])
        decay = 0.5 * damping
        turn = math.sqrt(stiffness - decay**2)
        # exp of a 2x2 matrix with eigenvalues -decay +- i turn
        self._transition = math.exp(-decay * step) * (
            math.cos(turn * step) * np.eye(2)
            + math.sin(turn * step) / turn * (system + decay * np.eye(2))
        )
        constant = np.linalg.solve(system, (self._transition - np.eye(2)) @ drive)
        self._new = np.linalg.solve(system, constant - step * drive) / step
        self._old = constant - self._new
        self.constants = np.array(
            [
                *self._transition.ravel(),
                *self._old,
                *self._new,
                stiffness * gain,
                stiffness,
                damping,
            ]
        )

    def frequency_response(self, turn: Complex) -> Complex:
        """Return the displacement per volt (m/V) where a sample turns the phase by `turn`."""
        (a, b), (c, d) = self._transition
        drive = [old + new * turn for old, new in zip(self._old, self._new, strict=True)]
        determinant = (turn - a) * (turn - d) - b * c
        return np.asarray(((turn - d) * drive[0] + b * drive[1]) / determinant)


@njit(
    "void(Array(float64, 1, 'C', readonly=True), float64[::1], float64[:, ::1], float64, "
    "float64[::1], float64[::1], float64[::1], float64[::1], "
    "float64[::1], float64[::1], float64[::1], float64[::1])",
    cache=True,
    error_model="numpy",
)
def _move(
    voltage: Samples,
    constants: Samples,
    modes: NDArray[np.float64],
    proportional: float,
    thresholds: Samples,
    weights: Samples,
    state: Samples,
    plays: Samples,
    position: Samples,
    velocity: Samples,
    acceleration: Samples,
    current: Samples,
) -> None:
    """Run the stator over a block of its voltage; `state` is u, w, then x and v of the modes."""
    straight, hysteretic = constants[0], constants[1]
    u, w = state[0], state[1]
    for i in range(len(voltage)):
        following = voltage[i]
        effective = drag(following, proportional, thresholds, weights, plays)
        flow = straight * (following - u) + hysteretic * (effective - w)
        position[i] = 0.0
        velocity[i] = 0.0
        acceleration[i] = 0.0
        for k in range(2):
            x, v = state[2 + 2 * k], state[3 + 2 * k]
            moved = modes[k, 0] * x + modes[k, 1] * v + modes[k, 4] * w + modes[k, 6] * effective
            v = modes[k, 2] * x + modes[k, 3] * v + modes[k, 5] * w + modes[k, 7] * effective
            flow += constants[2 + k] * (moved - x)
            state[2 + 2 * k] = moved
            state[3 + 2 * k] = v
            position[i] += moved
            velocity[i] += v
            acceleration[i] += modes[k, 8] * effective - modes[k, 9] * moved - modes[k, 10] * v
        current[i] = flow
        u = following
        w = effective
    state[0] = u
    state[1] = w

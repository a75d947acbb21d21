"""
The stator: a multilayer piezoelectric stack that moves the rod as one rigid body.

One mode, driven by the voltage u, with current i, in the usual form of a piezoelectric
transducer with force factor alpha (N/V, or C/m) and clamped capacitance C:

    x'' + 2 zeta w0 x' + w0^2 x = w0^2 g u        i = C u' + alpha x'

Below its resonance the rod follows g u; stiffness k = alpha/g and mass m = k/w0^2 are those that
make energy balance. Friction acts back on the rod by 1 N / k, some 0.04 um of 15: neglected, as
in the paper, where the rod's motion is imposed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.core.samples import (
    Samples,
    checked_bandwidth,
    checked_sample_rate,
    checked_samples,
)


@dataclass(frozen=True)
class StatorParameters(Parameters):
    """Constants of the stator with the rod, without slider."""

    static_gain: float = parameter(
        0.1645e-6, "displacement per volt at low frequency", unit="m/V", low=0.0,
        excludes_low=True,
        source="paper, table 1: displacement over linear-model voltage, 4625 to 13875 Hz",
    )  # fmt: skip
    resonance_frequency: float = parameter(
        41e3, "undamped resonance", unit="Hz", low=0.0, excludes_low=True,
        source="paper, table 1, as for static_gain; the fourth harmonic does not fit one mode",
    )  # fmt: skip
    damping_ratio: float = parameter(
        0.02, "damping ratio of the resonance", low=0.0, high=0.99,
        source="assumed; the constant phase lag in table 1 is hysteresis, not viscous damping",
    )  # fmt: skip
    clamped_capacitance: float = parameter(
        0.7e-6, "capacitance with the rod held", unit="F", low=0.0, excludes_low=True,
        source="assumed: stacks of this stroke have 0.3 to 1.8 uF",
    )  # fmt: skip
    force_factor: float = parameter(
        4.0, "force per volt, and charge per displacement", unit="N/V", low=0.0,
        source="assumed: 24 N/um, and a coupling factor of 0.70",
    )  # fmt: skip

    @property
    def free_capacitance(self) -> float:
        """Capacitance (F) at low frequency, with the rod free to move."""
        return self.clamped_capacitance + self.force_factor * self.static_gain

    @property
    def stiffness(self) -> float:
        """Stiffness (N/m) of the mode at the rod: force factor over static gain."""
        return self.force_factor / self.static_gain

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return the displacement per volt (m/V) at frequencies (Hz), in continuous time."""
        ratio = np.asarray(frequency, dtype=np.float64) / self.resonance_frequency
        return np.asarray(self.static_gain / (1.0 - ratio**2 + 2j * self.damping_ratio * ratio))


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
    The linear stator, exact for a voltage that is linear between samples.

    Parameters
    ----------
    parameters : StatorParameters
        Constants.
    sample_rate : float
        Samples per second (Hz); at least twice the resonance frequency.

    """

    def __init__(self, parameters: StatorParameters, sample_rate: float) -> None:
        self.parameters = parameters
        self.sample_rate = checked_sample_rate(sample_rate)
        checked_bandwidth(
            parameters.resonance_frequency, self.sample_rate, where="stator.resonance_frequency"
        )
        omega = 2.0 * math.pi * parameters.resonance_frequency
        self._stiffness = omega**2
        self._damping = 2.0 * parameters.damping_ratio * omega
        self._transition, self._old, self._new = self._discretised()
        self._constants = np.array(
            [
                *self._transition.ravel(),
                *self._old,
                *self._new,
                self._stiffness * parameters.static_gain,
                self._stiffness,
                self._damping,
                parameters.clamped_capacitance * self.sample_rate,
                parameters.force_factor * self.sample_rate,
            ]
        )
        self._state = np.zeros(3)
        self._index = 0

    @property
    def current_delay(self) -> float:
        """Time (s) by which `StatorResponse.current` is late."""
        return 0.5 / self.sample_rate

    def _discretised(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the transition matrix, and the weights of old and new voltage, in one sample."""
        step = 1.0 / self.sample_rate
        system = np.array([[0.0, 1.0], [-self._stiffness, -self._damping]])
        drive = np.array([0.0, self._stiffness * self.parameters.static_gain])
        decay = 0.5 * self._damping
        turn = math.sqrt(self._stiffness - decay**2)
        # exp of a 2x2 matrix with eigenvalues -decay +- i turn
        transition = math.exp(-decay * step) * (
            math.cos(turn * step) * np.eye(2)
            + math.sin(turn * step) / turn * (system + decay * np.eye(2))
        )
        constant = np.linalg.solve(system, (transition - np.eye(2)) @ drive)
        ramp = np.linalg.solve(system, constant - step * drive) / step
        return transition, constant - ramp, ramp

    def process(self, voltage: ArrayLike) -> StatorResponse:
        """
        Return what the stator does during the next samples of the voltage (V), shape (n,).

        It starts at rest, with 0 V one sample before the stream.

        Raises
        ------
        BadInputError
            If a sample is not finite.

        """
        samples = checked_samples(voltage, where="stator voltage", first_index=self._index)
        response = StatorResponse(*(np.empty(len(samples)) for _ in range(4)))
        _move(samples, self._constants, self._state, *response)
        self._index += len(samples)
        return response

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """
        Return the displacement per volt (m/V) at frequencies (Hz) of the sampled stator.

        It differs from the continuous one by the linear interpolation, 0.1 % at 18.5 kHz and
        1 MS/s: a voltage found from it is exact for the virtual motor.
        """
        turn = np.exp(2j * np.pi * np.asarray(frequency, dtype=np.float64) / self.sample_rate)
        (a, b), (c, d) = self._transition
        drive = [old + new * turn for old, new in zip(self._old, self._new, strict=True)]
        determinant = (turn - a) * (turn - d) - b * c
        return np.asarray(((turn - d) * drive[0] + b * drive[1]) / determinant)


@njit(
    "void(Array(float64, 1, 'C', readonly=True), float64[::1], float64[::1], "
    "float64[::1], float64[::1], float64[::1], float64[::1])",
    cache=True,
    error_model="numpy",
)
def _move(
    voltage: Samples,
    constants: Samples,
    state: Samples,
    position: Samples,
    velocity: Samples,
    acceleration: Samples,
    current: Samples,
) -> None:
    """Run the stator over a block of its voltage."""
    a00, a01, a10, a11 = constants[0], constants[1], constants[2], constants[3]
    old0, old1, new0, new1 = constants[4], constants[5], constants[6], constants[7]
    drive, stiffness, damping = constants[8], constants[9], constants[10]
    capacitance, force_factor = constants[11], constants[12]
    x, v, u = state[0], state[1], state[2]
    for i in range(len(voltage)):
        following = voltage[i]
        moved = a00 * x + a01 * v + old0 * u + new0 * following
        v = a10 * x + a11 * v + old1 * u + new1 * following
        current[i] = capacitance * (following - u) + force_factor * (moved - x)
        x = moved
        u = following
        position[i] = x
        velocity[i] = v
        acceleration[i] = drive * u - stiffness * x - damping * v
    state[0] = x
    state[1] = v
    state[2] = u

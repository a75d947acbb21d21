"""
The power amplifier that drives the stator: range, slew rate, current limit and bandwidth.

::

    wanted voltage -> clip to range -> first-order lag whose slope is limited -> stator voltage

With u the output, u_c the clipped wanted voltage and tau = 1/(2 pi bandwidth),

    du/dt = (u_c - u)/tau, but not beyond +-min(slew rate, current limit / load capacitance).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.core.samples import Samples, checked_sample_rate, checked_samples
from imotor_ros.errors import BadInputError


@dataclass(frozen=True)
class AmplifierParameters(Parameters):
    """Constants of the power amplifier."""

    lowest_voltage: float = parameter(
        -20.0, "lowest output voltage", unit="V", high=0.0,
        source="usual limit of low-voltage multilayer stacks",
    )  # fmt: skip
    highest_voltage: float = parameter(
        120.0, "highest output voltage", unit="V", low=0.0, excludes_low=True,
        source="usual limit of low-voltage multilayer stacks",
    )  # fmt: skip
    bandwidth: float = parameter(
        100e3, "-3 dB frequency at small signals", unit="Hz", low=0.0, excludes_low=True,
        source="assumed",
    )  # fmt: skip
    slew_rate: float = parameter(
        20e6, "largest slope of the output", unit="V/s", low=0.0, excludes_low=True,
        source="assumed",
    )  # fmt: skip
    current_limit: float = parameter(
        10.0, "largest output current", unit="A", low=0.0, excludes_low=True,
        source="assumed: n = 2, f_1 = 9250 Hz at 15 um asks for about 3 A per microfarad",
    )  # fmt: skip

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return the complex small-signal gain at frequencies (Hz), in continuous time."""
        return np.asarray(1.0 / (1.0 + 1j * np.asarray(frequency) / self.bandwidth))


class Amplifier:
    """
    The power amplifier with a capacitive load.

    Within its limits it is exact for a wanted voltage that is linear between samples; where the
    slope is limited, the instants at which a limit sets in and ends are found in closed form
    between the samples. The range clips sample by sample.

    Parameters
    ----------
    parameters : AmplifierParameters
        Constants.
    sample_rate : float
        Samples per second (Hz).
    load_capacitance : float
        Capacitance (F) that turns the current limit into a limit of the slope.

    Notes
    -----
    The load counts as a capacitor, also for a stator that moves. With the stator's free
    capacitance that is right well below its resonance; a voltage with the corners of a limited
    slope makes the stator ring, and its current then swings beyond the limit, up to twice.

    """

    def __init__(
        self, parameters: AmplifierParameters, sample_rate: float, *, load_capacitance: float
    ) -> None:
        self.parameters = parameters
        self.sample_rate = checked_sample_rate(sample_rate)
        if not load_capacitance > 0.0:
            raise BadInputError(
                "is out of bounds", where="load_capacitance", value=load_capacitance, bound="> 0 F"
            )
        current_slope = parameters.current_limit / load_capacitance
        self.largest_slope = min(parameters.slew_rate, current_slope)
        is_slew = parameters.slew_rate <= current_slope
        self._limit_flag = SampleFlag.SLEW_LIMITED if is_slew else SampleFlag.CURRENT_LIMITED
        self._constants = np.array(
            [
                parameters.lowest_voltage,
                parameters.highest_voltage,
                self.sample_rate / (2.0 * math.pi * parameters.bandwidth),
                self.largest_slope / self.sample_rate,
            ]
        )
        self._state = np.zeros(2)
        self._index = 0

    def process(self, voltage: ArrayLike) -> tuple[Samples, SampleFlag]:
        """
        Return the output voltage of the next samples of the stream.

        Parameters
        ----------
        voltage : array_like, shape (n,)
            Wanted voltage (V).

        Returns
        -------
        output : ndarray, shape (n,)
            Voltage (V) at the stator.
        flags : SampleFlag
            VOLTAGE_CLIPPED where the wanted voltage is out of range; SLEW_LIMITED or
            CURRENT_LIMITED, whichever is narrower, where the slope is limited.

        Raises
        ------
        BadInputError
            If a sample is not finite.

        """
        wanted = checked_samples(voltage, where="drive voltage", first_index=self._index)
        output = np.empty(len(wanted))
        is_clipped, is_limited = _amplify(wanted, self._constants, self._state, output)
        self._index += len(wanted)
        flags = SampleFlag.VOLTAGE_CLIPPED if is_clipped else SampleFlag(0)
        return output, flags | self._limit_flag if is_limited else flags

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """
        Return the complex gain at frequencies (Hz) of the sampled amplifier within its limits.

        It differs from the continuous one by the linear interpolation, 0.1 % at 18.5 kHz and
        1 MS/s: a voltage found from it is exact for the virtual motor.
        """
        decay, old, new = _lag_coefficients(self._constants[2])
        turn = np.exp(2j * np.pi * np.asarray(frequency, dtype=np.float64) / self.sample_rate)
        return np.asarray((old + new * turn) / (turn - decay))


@njit(cache=True, error_model="numpy")
def _lag_coefficients(tau: float) -> tuple[float, float, float]:
    """Return the weights of last output, last and new input of a lag `tau` samples long."""
    decay = math.exp(-1.0 / tau)
    rise = -math.expm1(-1.0 / tau)
    return decay, tau * rise - decay, 1.0 - tau * rise


@njit(cache=True, error_model="numpy")
def _limited_step(u: float, c: float, slope: float, tau: float, limit: float) -> float:
    """
    Return the output one sample on, where its slope hits the limit on the way.

    `u` is the output and `c` the wanted voltage at the start; the latter rises by `slope` in the
    sample. The lag's slope is (c - u)/tau, so it is limited while |c - u| > tau limit. Within
    one sample c - u is monotone: at most limited, free, limited on the other side.
    """
    edge = tau * limit
    goal = slope * tau  # what the gap tends to while free
    gap = c - u
    side = 0.0
    if gap > edge or (gap == edge and goal > edge):
        side = 1.0
    elif gap < -edge or (gap == -edge and goal < -edge):
        side = -1.0
    left = 1.0
    for _ in range(4):
        # the gap at a switch is set, not computed: rounding must not find the switch again
        if side != 0.0:
            closing = limit - side * slope
            excess = side * gap - edge
            if closing * left <= excess:
                return c - gap + side * limit * left
            span = excess / closing
            gap = side * edge
            side = 0.0
        else:
            span = left
            if abs(goal) > edge:
                side = 1.0 if goal > 0.0 else -1.0
                span = tau * math.log((goal - gap) / (goal - side * edge))
            if span >= left:
                return c + slope * left - (goal + (gap - goal) * math.exp(-left / tau))
            gap = side * edge
        c += slope * span
        left -= span
    return c - gap


@njit(
    "UniTuple(boolean, 2)(Array(float64, 1, 'C', readonly=True), float64[::1], "
    "float64[::1], float64[::1])",
    cache=True,
    error_model="numpy",
)
def _amplify(
    wanted: Samples, constants: Samples, state: Samples, output: Samples
) -> tuple[bool, bool]:
    """Run the amplifier over a block; return whether it was clipped, and limited in slope."""
    lowest, highest, tau, limit = constants[0], constants[1], constants[2], constants[3]
    decay, old, new = _lag_coefficients(tau)
    edge = tau * limit
    u, c = state[0], state[1]
    is_clipped = False
    is_limited = False
    for i in range(len(wanted)):
        following = wanted[i]
        if following > highest:
            following = highest
            is_clipped = True
        elif following < lowest:
            following = lowest
            is_clipped = True
        free = decay * u + old * c + new * following
        if abs(c - u) <= edge and abs(following - free) <= edge:
            u = free
        else:
            u = _limited_step(u, c, following - c, tau, limit)
            is_limited = True
        c = following
        output[i] = u
    state[0] = u
    state[1] = c
    return is_clipped, is_limited

"""
Hysteresis of the piezoelectric ceramic: play operators in front of the linear dynamics.

A Prandtl-Ishlinskii operator turns the voltage u into an effective voltage w,

    w = proportional u + sum of weight_i y_i,   y_i = min(max(y_i, u - r_i), u + r_i),

each y_i being dragged along by u with the play +-r_i. It does not depend on the rate of the
voltage, keeps its memory for ever, and its loops are point-symmetric. Gain and phase lag grow
with the amplitude of the voltage, as those of a ceramic do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.core.samples import Samples, checked_samples
from imotor_ros.errors import BadInputError

_SOURCE = (
    "fitted to table 1: lag from 24 to 40 V, and the voltages after iteration; loops of 2 % of the "
    "stroke at small signals, 14 % at the full range, as data sheets state"
)


class PlayNumbers(NamedTuple):
    """
    A hysteresis as numbers, for compiled code.

    Attributes
    ----------
    proportional : float
        Gain without memory.
    thresholds, weights : ndarray, shape (n,)
        Half plays r_i (V) and their weights.

    """

    proportional: float
    thresholds: NDArray[np.float64]
    weights: NDArray[np.float64]


@runtime_checkable
class HysteresisModel(Protocol):
    """Turns a voltage into an effective voltage, whatever its rate."""

    @property
    def numbers(self) -> PlayNumbers:
        """The model for compiled code."""

    @property
    def largest_gain(self) -> float:
        """Slope dw/du once all plays are taken up: that at the largest signals."""

    def describing_function(self, amplitude: ArrayLike) -> Complex:
        """Return the complex gain for sines of an amplitude (V), at the sine's frequency."""


@dataclass(frozen=True)
class NoHysteresis(Parameters):
    """A voltage that acts as it is."""

    @property
    def numbers(self) -> PlayNumbers:
        """The model for compiled code."""
        return PlayNumbers(1.0, np.empty(0), np.empty(0))

    @property
    def largest_gain(self) -> float:
        """Slope dw/du: 1."""
        return 1.0

    def describing_function(self, amplitude: ArrayLike) -> Complex:
        """Return 1, shape as `amplitude`."""
        return np.ones(np.shape(amplitude), dtype=np.complex128)


@dataclass(frozen=True)
class PlayHysteresis(Parameters):
    """
    Play operators in parallel; by default those of the paper's motor.

    The paper's weights are scaled so that the gain is 1 for sines of 40 V: the linear model holds
    for what drives the motor.
    """

    proportional: float = parameter(
        0.5611, "gain without memory, which is that at small signals", low=0.0,
        excludes_low=True, source=_SOURCE,
    )  # fmt: skip
    thresholds: tuple[float, ...] = parameter(
        (
            0.7, 0.9, 1.2, 1.6, 2.0, 2.6, 3.4, 4.4,
            5.6, 7.2, 9.4, 12.0, 16.0, 20.0, 26.0, 34.0,
        ),
        "half plays, rising", unit="V", low=0.0, excludes_low=True, source=_SOURCE,
    )  # fmt: skip
    weights: tuple[float, ...] = parameter(
        (
            0.0102, 0.0076, 0.0087, 0.0070, 0.0036, 0.0043, 0.0201, 0.0263,
            0.0246, 0.0705, 0.0768, 0.0838, 0.1079, 0.0703, 0.0690, 0.0843,
        ),
        "weight of each play", low=0.0, source=_SOURCE,
    )  # fmt: skip

    def check(self) -> None:
        """Check that every play has a weight, and that the plays rise."""
        where = f"{type(self).__name__}.thresholds"
        if len(self.thresholds) != len(self.weights):
            raise BadInputError(
                "are not as many as the weights",
                where=where,
                value=len(self.thresholds),
                bound=f"{len(self.weights)} numbers",
            )
        if any(b <= a for a, b in pairwise(self.thresholds)):
            raise BadInputError("do not rise", where=where, value=self.thresholds)

    @property
    def numbers(self) -> PlayNumbers:
        """The model for compiled code."""
        return PlayNumbers(self.proportional, np.array(self.thresholds), np.array(self.weights))

    @property
    def largest_gain(self) -> float:
        """Slope dw/du once all plays are taken up."""
        return self.proportional + sum(self.weights)

    def describing_function(self, amplitude: ArrayLike) -> Complex:
        """
        Return the complex gain for sines of an amplitude (V), shape (...).

        Fundamental of the effective voltage over that of the voltage, once the loop is closed.

        Notes
        -----
        For one play with s = r/amplitude <= 1, in closed form,

            (1/pi) (pi/2 + asin(1 - 2s) + 2 (1 - 2s) sqrt(s (1 - s))) - 4j/pi s (1 - s):

        the imaginary part is the area 4 r (amplitude - r) of the loop over pi amplitude^2.
        """
        size = np.asarray(amplitude, dtype=np.float64)
        value = np.full(size.shape, self.proportional, dtype=np.complex128)
        for threshold, weight in zip(self.thresholds, self.weights, strict=True):
            share = threshold / np.maximum(size, threshold)
            rest = 1.0 - 2.0 * share
            root = np.sqrt(share * (1.0 - share))
            real = 0.5 + (np.arcsin(rest) + 2.0 * rest * root) / np.pi
            value += weight * (real - 4j / np.pi * share * (1.0 - share))
        return value

    def loop_opening(self, amplitude: float) -> float:
        """Return opening over height of the loop that a sine of an amplitude (V) runs through."""
        reached = np.array(self.thresholds) < amplitude
        thresholds = np.array(self.thresholds)[reached]
        weights = np.array(self.weights)[reached]
        opening = 2.0 * weights @ np.minimum(thresholds, amplitude - thresholds)
        height = 2.0 * (self.proportional * amplitude + weights @ (amplitude - thresholds))
        return float(opening / height)


HYSTERESIS_MODELS: Mapping[str, type[Parameters]] = {
    "play": PlayHysteresis,
    "none": NoHysteresis,
}


class Hysteresis:
    """
    A hysteresis applied to a stream of samples; it starts at rest, without voltage.

    Parameters
    ----------
    model : HysteresisModel
        What to apply.

    """

    def __init__(self, model: HysteresisModel) -> None:
        self._numbers = model.numbers
        self._state = np.zeros(len(self._numbers.thresholds))
        self._index = 0

    def process(self, voltage: ArrayLike) -> Samples:
        """
        Return the effective voltage (V), shape (n,), of the next samples of the voltage (V).

        Raises
        ------
        BadInputError
            If a sample is not finite.

        """
        samples = checked_samples(voltage, where="voltage", first_index=self._index)
        effective = np.empty(len(samples))
        _drag_plays(samples, *self._numbers, self._state, effective)
        self._index += len(samples)
        return effective


@njit(
    "float64(float64, float64, float64[::1], float64[::1], float64[::1])",
    cache=True,
    error_model="numpy",
)
def drag(
    voltage: float, proportional: float, thresholds: Samples, weights: Samples, plays: Samples
) -> float:
    """Drag the plays (state, V) along to a voltage (V), and return the effective voltage (V)."""
    effective = proportional * voltage
    for i in range(len(thresholds)):
        play = min(max(plays[i], voltage - thresholds[i]), voltage + thresholds[i])
        plays[i] = play
        effective += weights[i] * play
    return effective


@njit(
    "void(Array(float64, 1, 'C', readonly=True), float64, float64[::1], float64[::1], "
    "float64[::1], float64[::1])",
    cache=True,
    error_model="numpy",
)
def _drag_plays(
    voltage: Samples,
    proportional: float,
    thresholds: Samples,
    weights: Samples,
    plays: Samples,
    effective: Samples,
) -> None:
    """Run the plays over a block of voltage."""
    for i in range(len(voltage)):
        effective[i] = drag(voltage[i], proportional, thresholds, weights, plays)

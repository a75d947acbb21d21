"""The digitiser: steps of one size within a range, as every channel of the stand has one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.core.samples import Samples


@dataclass(frozen=True)
class DigitiserParameters(Parameters):
    """Constants of a digitiser whose input range is the full output of its instrument."""

    bits: int = parameter(
        16, "number of bits over the whole range", unit="bit", low=4, high=32,
        source="assumed; recorders of this kind have 12 to 16 bit",
    )  # fmt: skip


class Digitiser:
    """
    Rounds samples to whole steps: mid-tread, two's complement.

    Parameters
    ----------
    parameters : DigitiserParameters
        Constants.
    full_scale : float
        Magnitude at the end of the range (unit of the samples).

    Attributes
    ----------
    resolution : float
        One step (unit of the samples): 2 `full_scale` / 2^bits.

    """

    def __init__(self, parameters: DigitiserParameters, full_scale: float) -> None:
        self.parameters = parameters
        self._half_count = 2.0 ** (parameters.bits - 1)
        self.resolution = full_scale / self._half_count

    def process(self, samples: Samples) -> tuple[Samples, SampleFlag]:
        """
        Return the rounded samples, and OVER_RANGE if one had to be clipped.

        The largest value is one step below `full_scale`, the smallest is -`full_scale`.
        """
        rounded = np.empty(len(samples))
        is_clipped = _round_to_steps(samples, self.resolution, self._half_count, rounded)
        return rounded, SampleFlag.OVER_RANGE if is_clipped else SampleFlag(0)


@njit(
    "boolean(Array(float64, 1, 'C', readonly=True), float64, float64, float64[::1])",
    cache=True,
    error_model="numpy",
)
def _round_to_steps(samples: Samples, step: float, half_count: float, rounded: Samples) -> bool:
    """Round samples to steps within the counts; return whether one was outside."""
    is_clipped = False
    for i in range(len(samples)):
        count = np.rint(samples[i] / step)
        if count > half_count - 1.0:
            count = half_count - 1.0
            is_clipped = True
        elif count < -half_count:
            count = -half_count
            is_clipped = True
        rounded[i] = count * step
    return is_clipped

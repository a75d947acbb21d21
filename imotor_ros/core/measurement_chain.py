"""
What all instruments have in common behind their transducer.

::

    clip at full scale -> noise -> filters -> gain and offset error, drift -> digitiser
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from imotor_ros.core.channel import ChannelDescription, SampleFlag
from imotor_ros.core.digitiser import Digitiser, DigitiserParameters
from imotor_ros.core.filters import StreamFilter
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.random_streams import generator
from imotor_ros.core.samples import Samples, checked_samples


@dataclass(frozen=True)
class ChainErrors:
    """
    Imperfections of a measurement chain.

    Attributes
    ----------
    noise_density : float
        One-sided density (unit per square root of Hz) of the white noise in front of the filters.
    gain_uncertainty : float
        Standard deviation of the fixed relative gain error.
    offset_uncertainty : float
        Standard deviation of the fixed offset (unit).
    drift_uncertainty : float
        Standard deviation of the fixed drift rate (unit/s).

    """

    noise_density: float = 0.0
    gain_uncertainty: float = 0.0
    offset_uncertainty: float = 0.0
    drift_uncertainty: float = 0.0


class OverlapMark:
    """
    Remembers until which sample something that happened still shows.

    A filter spreads one bad sample over those that follow, maybe into the next block.

    Parameters
    ----------
    settling : int
        Number of samples after the bad one that it still spoils.

    """

    def __init__(self, settling: int) -> None:
        self._settling = settling
        self._until = 0

    def covers(self, first: int, last_bad: int) -> bool:
        """
        Return whether a block that starts at sample `first` is spoiled.

        `last_bad` is the index in the stream of the last bad sample of the block, or negative.
        """
        if last_bad >= 0:
            self._until = max(self._until, last_bad + 1 + self._settling)
        return first < self._until


class MeasurementChain:
    """
    Conditioning and digitising of one channel.

    Parameters
    ----------
    name : str
        Channel name; also names its random streams.
    full_scale : float
        Magnitude at which the electronics saturate, and range of the digitiser (unit).
    filters : sequence of StreamFilter
        Filters in order, all at one sample rate; the low-pass comes last.
    errors : ChainErrors
        Noise and calibration errors.
    digitiser : DigitiserParameters
        Digitiser.
    seed : int
        Seed of the run. Noise is drawn sample after sample from "<name>/noise"; gain, offset and
        drift are drawn once, in this order, from "<name>/calibration".

    Attributes
    ----------
    gain, offset, drift_rate : float
        The errors drawn: factor, offset (unit), drift (unit/s). No receiver knows them.
    settling : int
        Number of samples for which a disturbance at the input still shows at the output.

    """

    def __init__(
        self,
        *,
        name: str,
        full_scale: float,
        filters: Sequence[StreamFilter],
        errors: ChainErrors,
        digitiser: DigitiserParameters,
        seed: int,
    ) -> None:
        self.name = name
        self.full_scale = full_scale
        self.errors = errors
        self.sample_rate = filters[0].sample_rate
        self._filters = tuple(filters)
        self._digitiser = Digitiser(digitiser, full_scale)
        draws = generator(seed, f"{name}/calibration").standard_normal(3)
        self.gain = 1.0 + errors.gain_uncertainty * float(draws[0])
        self.offset = errors.offset_uncertainty * float(draws[1])
        self.drift_rate = errors.drift_uncertainty * float(draws[2])
        self._noise = generator(seed, f"{name}/noise")
        # white up to half the sample rate, so that its one-sided density is the one wanted
        self._noise_deviation = errors.noise_density * math.sqrt(self.sample_rate / 2.0)
        self.settling = filters[-1].settling
        self._overload = OverlapMark(self.settling)
        self.index = 0

    def process(self, samples: ArrayLike) -> tuple[Samples, SampleFlag]:
        """
        Return the measured samples, shape (n,), of the next n true ones, and what holds for them.

        Raises
        ------
        BadInputError
            If a sample is not finite.

        """
        first = self.index
        signal, flags = self._clipped(checked_samples(samples, where=self.name, first_index=first))
        if self._noise_deviation > 0.0:
            signal += self._noise_deviation * self._noise.standard_normal(len(signal))
        for stage in self._filters:
            signal = stage.process(signal)
        signal *= self.gain
        signal += self.offset
        if self.drift_rate != 0.0:
            signal += self.drift_rate / self.sample_rate * np.arange(first, first + len(signal))
        self.index += len(signal)
        measured, over_range = self._digitiser.process(signal)
        return measured, flags | over_range

    def _clipped(self, samples: Samples) -> tuple[Samples, SampleFlag]:
        clipped = np.empty(len(samples))
        last = _clip(samples, -self.full_scale, self.full_scale, clipped)
        is_overloaded = self._overload.covers(self.index, self.index + last if last >= 0 else -1)
        return clipped, SampleFlag.OVER_RANGE if is_overloaded else SampleFlag(0)

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return the complex gain of the filters at frequencies (Hz), shape (...)."""
        value = np.ones(np.shape(frequency), dtype=np.complex128)
        for stage in self._filters:
            value = value * stage.frequency_response(frequency)
        return value

    def describe(
        self,
        *,
        quantity: str,
        unit: str,
        bandwidth: float,
        high_pass_frequency: float,
        delay: float,
        instrument: str,
        low_pass: str = "",
    ) -> ChannelDescription:
        """Return the description of the channel: `ChannelDescription` with what is known here."""
        return ChannelDescription(
            name=self.name,
            quantity=quantity,
            unit=unit,
            range=self.full_scale,
            resolution=self._digitiser.resolution,
            gain_uncertainty=self.errors.gain_uncertainty,
            offset_uncertainty=self.errors.offset_uncertainty,
            noise_density=self.errors.noise_density,
            bandwidth=bandwidth,
            high_pass_frequency=high_pass_frequency,
            delay=delay,
            instrument=instrument,
            serial=f"simulated {self.name}",
            low_pass=low_pass,
        )


@njit(
    "int64(Array(float64, 1, 'C', readonly=True), float64, float64, float64[::1])",
    cache=True,
    error_model="numpy",
)
def _clip(samples: Samples, low: float, high: float, clipped: Samples) -> int:
    """Clip samples, and return the index of the last one that was outside, or -1."""
    last = -1
    for i in range(len(samples)):
        value = samples[i]
        if value > high:
            value = high
            last = i
        elif value < low:
            value = low
            last = i
        clipped[i] = value
    return last

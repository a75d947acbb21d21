"""
The virtual laser vibrometer: velocity of a surface along its beam.

::

    velocity -> decoder (range, speckle drop-outs) -> noise -> [AC coupling] -> decoder delay
             -> third-order Bessel low-pass -> calibration error -> digitiser
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from numpy.typing import ArrayLike

from imotor_ros.core.channel import BESSEL_3, ChannelDescription, SampleFlag
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.filters import StreamFilter
from imotor_ros.core.linear_systems import Complex, bessel_low_pass, first_order_high_pass
from imotor_ros.core.measurement_chain import ChainErrors, MeasurementChain, OverlapMark
from imotor_ros.core.parameters import Parameters, group, parameter
from imotor_ros.core.random_streams import generator
from imotor_ros.core.samples import (
    Samples,
    checked_bandwidth,
    checked_sample_rate,
    checked_samples,
)

_DATA_SHEETS = "assumed, within data sheets of common velocity decoders"


@dataclass(frozen=True)
class VibrometerParameters(Parameters):
    """Constants of a laser vibrometer with its velocity decoder."""

    velocity_range: float = parameter(
        0.125, "velocity per volt of decoder output", unit="m/s/V", low=0.005, high=1.0,
        source="assumed: smallest usual range that holds the rod's peak of about 0.6 m/s",
    )  # fmt: skip
    output_range: float = parameter(
        10.0, "largest decoder output", unit="V", low=0.0, excludes_low=True, source=_DATA_SHEETS
    )
    cut_off_frequency: float = parameter(
        100e3, "-3 dB frequency of the third-order Bessel low-pass", unit="Hz", low=1e3, high=2e6,
        source=_DATA_SHEETS,
    )  # fmt: skip
    decoder_delay: float = parameter(
        4e-6, "delay of the velocity decoder", unit="s", low=0.0, high=1e-3, source=_DATA_SHEETS
    )
    high_pass_frequency: float = parameter(
        0.0, "lower -3 dB frequency; 0: DC-coupled, the only setting that shows a mean velocity",
        unit="Hz", low=0.0, source="the mean slider velocity has to be seen",
    )  # fmt: skip
    calibration_uncertainty: float = parameter(
        0.01, "standard deviation of the fixed relative gain error", low=0.0, high=0.2,
        source=_DATA_SHEETS,
    )  # fmt: skip
    offset_uncertainty: float = parameter(
        2e-4, "standard deviation of the fixed offset", unit="m/s", low=0.0,
        source="assumed: what zeroing on a surface at rest leaves",
    )  # fmt: skip
    noise_density: float = parameter(
        0.5e-6, "one-sided density of the decoder's white noise", unit="m/s/sqrt(Hz)", low=0.0,
        source=_DATA_SHEETS,
    )  # fmt: skip
    drop_out_rate: float = parameter(
        0.0, "mean number of speckle drop-outs per second of good signal", unit="1/s", low=0.0,
        source="assumed: well focused on a retro-reflecting film",
    )  # fmt: skip
    drop_out_duration: float = parameter(
        20e-6, "mean duration of a drop-out", unit="s", low=0.0, excludes_low=True,
        source="assumed",
    )  # fmt: skip
    digitiser: DigitiserParameters = group(DigitiserParameters)

    @property
    def full_scale(self) -> float:
        """Largest velocity (m/s) that the range shows."""
        return self.velocity_range * self.output_range


class Vibrometer:
    """
    A virtual laser vibrometer.

    Parameters
    ----------
    parameters : VibrometerParameters
        Constants.
    sample_rate : float
        Samples per second (Hz); at least twice the cut-off frequency.
    seed : int
        Seed of the run.
    channel : str
        Name of the channel, e.g. "rod/velocity"; also names the random streams.

    Raises
    ------
    BadInputError
        If the cut-off frequency is above half the sample rate.

    """

    def __init__(
        self, parameters: VibrometerParameters, sample_rate: float, seed: int, channel: str
    ) -> None:
        self.parameters = parameters
        rate = checked_sample_rate(sample_rate)
        cut_off = checked_bandwidth(
            parameters.cut_off_frequency, rate, where=f"{channel}: cut_off_frequency"
        )
        self._low_pass = StreamFilter(
            bessel_low_pass(cut_off), rate, delay=parameters.decoder_delay
        )
        filters = [self._low_pass]
        if parameters.high_pass_frequency > 0.0:
            coupling = first_order_high_pass(parameters.high_pass_frequency)
            filters.insert(0, StreamFilter(coupling, rate, interpolation="linear"))
        errors = ChainErrors(
            noise_density=parameters.noise_density,
            gain_uncertainty=parameters.calibration_uncertainty,
            offset_uncertainty=parameters.offset_uncertainty,
        )
        self._chain = MeasurementChain(
            name=channel,
            full_scale=parameters.full_scale,
            filters=filters,
            errors=errors,
            digitiser=parameters.digitiser,
            seed=seed,
        )
        self._drop_outs = _DropOuts(parameters, rate, self._chain.settling, seed, channel)

    @cached_property
    def channel(self) -> ChannelDescription:
        """What the samples mean; the delay is that of decoder and low-pass at low frequency."""
        return self._chain.describe(
            quantity="velocity",
            unit="m/s",
            bandwidth=self.parameters.cut_off_frequency,
            high_pass_frequency=self.parameters.high_pass_frequency,
            delay=self._low_pass.delay,
            instrument="virtual laser vibrometer",
            low_pass=BESSEL_3,
        )

    @property
    def gain(self) -> float:
        """The calibration factor drawn for this run: measured over true; no receiver knows it."""
        return self._chain.gain

    @property
    def offset(self) -> float:
        """The offset (m/s) drawn for this run; no receiver knows it."""
        return self._chain.offset

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return the nominal complex gain at frequencies (Hz), delay included, shape (...)."""
        return self._chain.frequency_response(frequency)

    def process(self, velocity: ArrayLike) -> tuple[Samples, SampleFlag]:
        """
        Return the measured velocity of the next samples of the stream.

        Parameters
        ----------
        velocity : array_like, shape (n,)
            True velocity (m/s).

        Returns
        -------
        measured : ndarray, shape (n,)
            Measured velocity (m/s), late by `channel.delay`.
        flags : SampleFlag
            OVER_RANGE while the decoder or the digitiser saturates, DROP_OUT while the decoder
            holds a value; both until the low-pass has settled again.

        Raises
        ------
        BadInputError
            If a sample is not finite.

        """
        samples = checked_samples(velocity, where=self._chain.name, first_index=self._chain.index)
        held, drop_out = self._drop_outs.process(samples)
        measured, flags = self._chain.process(held)
        return measured, flags | drop_out


class _DropOuts:
    """
    Speckle drop-outs: for a moment too little light returns, and the decoder holds its value.

    Gaps and durations are exponential; they are drawn one after the other in stream time, so
    that they do not depend on how the stream is cut into blocks.
    """

    def __init__(
        self,
        parameters: VibrometerParameters,
        sample_rate: float,
        settling: int,
        seed: int,
        name: str,
    ) -> None:
        rate = parameters.drop_out_rate
        self._mean_gap = sample_rate / rate if rate > 0.0 else math.inf
        self._mean_duration = parameters.drop_out_duration * sample_rate
        self._draws = generator(seed, f"{name}/drop_outs")
        self._mark = OverlapMark(settling)
        self._index = 0
        self._value = 0.0
        self._end = 0.0
        self._draw_next()

    def _draw_next(self) -> None:
        if math.isinf(self._mean_gap):
            self._start = self._end = math.inf
            return
        self._start = math.ceil(self._end + self._mean_gap * self._draws.standard_exponential())
        duration = self._mean_duration * self._draws.standard_exponential()
        self._end = self._start + max(1, math.ceil(duration))

    def process(self, samples: Samples) -> tuple[Samples, SampleFlag]:
        first, end = self._index, self._index + len(samples)
        last_held = -1
        if self._start < end:
            samples = samples.copy()
        while self._start < end:
            begin = max(int(self._start) - first, 0)
            stop = min(int(self._end), end) - first
            samples[begin:stop] = samples[begin - 1] if begin > 0 else self._value
            last_held = first + stop - 1
            if self._end > end:
                break
            self._draw_next()
        self._index = end
        if len(samples):
            self._value = float(samples[-1])
        is_marked = self._mark.covers(first, last_held) and len(samples) > 0
        return samples, SampleFlag.DROP_OUT if is_marked else SampleFlag(0)

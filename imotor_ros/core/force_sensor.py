"""
The virtual force sensor behind the end stops, with its charge amplifier.

::

    load force -> range -> noise -> [charge amplifier's drift: high-pass] -> sensor resonance
               -> third-order Bessel low-pass -> calibration error, offset, drift -> digitiser
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from numpy.typing import ArrayLike

from imotor_ros.core.channel import LOAD_FORCE, ChannelDescription, SampleFlag
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.filters import StreamFilter
from imotor_ros.core.linear_systems import (
    Complex,
    bessel_low_pass,
    first_order_high_pass,
    resonator,
)
from imotor_ros.core.measurement_chain import ChainErrors, MeasurementChain
from imotor_ros.core.parameters import Parameters, group, parameter
from imotor_ros.core.samples import Samples, checked_bandwidth, checked_sample_rate

_DATA_SHEETS = "assumed, within data sheets of small quartz sensors and charge amplifiers"


@dataclass(frozen=True)
class ForceSensorParameters(Parameters):
    """Constants of a force sensor with its charge amplifier."""

    force_range: float = parameter(
        5.0, "largest force", unit="N", low=0.0, excludes_low=True,
        source="assumed: mean forces are 0.2 to 1 N, impacts on the stops a few times that",
    )  # fmt: skip
    resonance_frequency: float = parameter(
        15e3, "resonance of the sensor as mounted; 0: none", unit="Hz", low=0.0,
        source=_DATA_SHEETS,
    )  # fmt: skip
    damping_ratio: float = parameter(
        0.02, "damping ratio of that resonance", low=0.0, high=0.99, source=_DATA_SHEETS
    )
    cut_off_frequency: float = parameter(
        10e3, "-3 dB frequency of the amplifier's third-order Bessel low-pass", unit="Hz",
        low=10.0, high=1e6, source=_DATA_SHEETS,
    )  # fmt: skip
    drift_time_constant: float = parameter(
        30.0, "time in which a constant force decays to 1/e; 0: never, as with strain gauges",
        unit="s", low=0.0, source=_DATA_SHEETS,
    )  # fmt: skip
    drift_rate: float = parameter(
        2e-3, "standard deviation of the fixed drift rate", unit="N/s", low=0.0,
        source=_DATA_SHEETS,
    )  # fmt: skip
    calibration_uncertainty: float = parameter(
        0.01, "standard deviation of the fixed relative gain error", low=0.0, high=0.2,
        source=_DATA_SHEETS,
    )  # fmt: skip
    offset_uncertainty: float = parameter(
        1e-3, "standard deviation of the fixed offset", unit="N", low=0.0,
        source="assumed: what the reset of the charge amplifier leaves",
    )  # fmt: skip
    noise_density: float = parameter(
        1e-5, "one-sided density of the white noise", unit="N/sqrt(Hz)", low=0.0,
        source="assumed: a threshold of 1 mN over 10 kHz",
    )  # fmt: skip
    digitiser: DigitiserParameters = group(DigitiserParameters)

    @property
    def high_pass_frequency(self) -> float:
        """Lower -3 dB frequency (Hz); 0 without drift."""
        time = self.drift_time_constant
        return 1.0 / (2.0 * math.pi * time) if time > 0.0 else 0.0


class ForceSensor:
    """
    A virtual force sensor with charge amplifier.

    Parameters
    ----------
    parameters : ForceSensorParameters
        Constants.
    sample_rate : float
        Samples per second (Hz); at least twice the highest frequency among the parameters.
    seed : int
        Seed of the run.
    channel : str
        Name of the channel; also names the random streams.

    Raises
    ------
    BadInputError
        If the cut-off frequency or the resonance is above half the sample rate.

    """

    def __init__(
        self,
        parameters: ForceSensorParameters,
        sample_rate: float,
        seed: int,
        channel: str = LOAD_FORCE,
    ) -> None:
        self.parameters = parameters
        rate = checked_sample_rate(sample_rate)
        for key in ("cut_off_frequency", "resonance_frequency"):
            checked_bandwidth(getattr(parameters, key), rate, where=f"{channel}: {key}")
        system = bessel_low_pass(parameters.cut_off_frequency)
        if parameters.resonance_frequency > 0.0:
            resonance = resonator(parameters.resonance_frequency, parameters.damping_ratio)
            system = system @ resonance
        self._low_pass = StreamFilter(system, rate)
        filters = [self._low_pass]
        if parameters.drift_time_constant > 0.0:
            leak = first_order_high_pass(parameters.high_pass_frequency)
            filters.insert(0, StreamFilter(leak, rate, interpolation="linear"))
        errors = ChainErrors(
            noise_density=parameters.noise_density,
            gain_uncertainty=parameters.calibration_uncertainty,
            offset_uncertainty=parameters.offset_uncertainty,
            drift_uncertainty=parameters.drift_rate,
        )
        self._chain = MeasurementChain(
            name=channel,
            full_scale=parameters.force_range,
            filters=filters,
            errors=errors,
            digitiser=parameters.digitiser,
            seed=seed,
        )

    @cached_property
    def channel(self) -> ChannelDescription:
        """What the samples mean; the delay is that of sensor and low-pass at low frequency."""
        return self._chain.describe(
            quantity="force",
            unit="N",
            bandwidth=self.parameters.cut_off_frequency,
            high_pass_frequency=self.parameters.high_pass_frequency,
            delay=self._low_pass.delay,
            instrument="virtual force sensor",
        )

    @property
    def gain(self) -> float:
        """The calibration factor drawn for this run: measured over true; no receiver knows it."""
        return self._chain.gain

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return the nominal complex gain at frequencies (Hz), delay included, shape (...)."""
        return self._chain.frequency_response(frequency)

    def process(self, force: ArrayLike) -> tuple[Samples, SampleFlag]:
        """
        Return the measured force of the next samples of the stream.

        Parameters
        ----------
        force : array_like, shape (n,)
            True load force (N).

        Returns
        -------
        measured : ndarray, shape (n,)
            Measured force (N), late by `channel.delay`.
        flags : SampleFlag
            OVER_RANGE while amplifier or digitiser saturates, until the filters have settled.

        Raises
        ------
        BadInputError
            If a sample is not finite.

        """
        return self._chain.process(force)

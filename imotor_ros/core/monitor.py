"""
The amplifier's monitor outputs: voltage and current of the stator, as digitised.

::

    quantity -> noise -> first-order low-pass -> calibration error, offset -> digitiser
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from numpy.typing import ArrayLike

from imotor_ros.core.channel import (
    CURRENT,
    FIRST_ORDER,
    VOLTAGE,
    ChannelDescription,
    SampleFlag,
)
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.filters import StreamFilter
from imotor_ros.core.linear_systems import Complex, first_order_low_pass
from imotor_ros.core.measurement_chain import ChainErrors, MeasurementChain
from imotor_ros.core.parameters import Parameters, group, parameter
from imotor_ros.core.samples import Samples, checked_bandwidth, checked_sample_rate

_ASSUMED = "assumed, as usual for amplifier monitors"


@dataclass(frozen=True)
class VoltageMonitorParameters(Parameters):
    """Constants of the voltage monitor."""

    range: float = parameter(
        200.0, "largest voltage", unit="V", low=0.0, excludes_low=True, source=_ASSUMED
    )
    cut_off_frequency: float = parameter(
        100e3, "-3 dB frequency", unit="Hz", low=100.0, high=2e6, source=_ASSUMED
    )
    calibration_uncertainty: float = parameter(
        0.005, "standard deviation of the fixed relative gain error", low=0.0, high=0.2,
        source=_ASSUMED,
    )  # fmt: skip
    offset_uncertainty: float = parameter(
        0.02, "standard deviation of the fixed offset", unit="V", low=0.0, source=_ASSUMED
    )
    noise_density: float = parameter(
        1e-5, "one-sided density of the white noise", unit="V/sqrt(Hz)", low=0.0, source=_ASSUMED
    )
    digitiser: DigitiserParameters = group(DigitiserParameters)


@dataclass(frozen=True)
class CurrentMonitorParameters(Parameters):
    """Constants of the current monitor."""

    range: float = parameter(
        10.0, "largest current", unit="A", low=0.0, excludes_low=True, source=_ASSUMED
    )
    cut_off_frequency: float = parameter(
        100e3, "-3 dB frequency", unit="Hz", low=100.0, high=2e6, source=_ASSUMED
    )
    calibration_uncertainty: float = parameter(
        0.01, "standard deviation of the fixed relative gain error", low=0.0, high=0.2,
        source=_ASSUMED,
    )  # fmt: skip
    offset_uncertainty: float = parameter(
        0.002, "standard deviation of the fixed offset", unit="A", low=0.0, source=_ASSUMED
    )
    noise_density: float = parameter(
        1e-6, "one-sided density of the white noise", unit="A/sqrt(Hz)", low=0.0, source=_ASSUMED
    )
    digitiser: DigitiserParameters = group(DigitiserParameters)


class Monitor:
    """
    One monitor output of the amplifier.

    Parameters
    ----------
    parameters : VoltageMonitorParameters or CurrentMonitorParameters
        Constants; they decide what is measured.
    sample_rate : float
        Samples per second (Hz); at least twice the cut-off frequency.
    seed : int
        Seed of the run.
    input_delay : float
        Time (s) by which the samples given to `process` are late themselves.

    Raises
    ------
    BadInputError
        If the cut-off frequency is above half the sample rate.

    """

    def __init__(
        self,
        parameters: VoltageMonitorParameters | CurrentMonitorParameters,
        sample_rate: float,
        seed: int,
        *,
        input_delay: float = 0.0,
    ) -> None:
        self.parameters = parameters
        self._input_delay = input_delay
        rate = checked_sample_rate(sample_rate)
        is_voltage = isinstance(parameters, VoltageMonitorParameters)
        name = VOLTAGE if is_voltage else CURRENT
        cut_off = checked_bandwidth(
            parameters.cut_off_frequency, rate, where=f"{name}: cut_off_frequency"
        )
        self._low_pass = StreamFilter(first_order_low_pass(cut_off), rate)
        self._quantity, self._unit = ("voltage", "V") if is_voltage else ("current", "A")
        self._chain = MeasurementChain(
            name=name,
            full_scale=parameters.range,
            filters=[self._low_pass],
            errors=ChainErrors(
                noise_density=parameters.noise_density,
                gain_uncertainty=parameters.calibration_uncertainty,
                offset_uncertainty=parameters.offset_uncertainty,
            ),
            digitiser=parameters.digitiser,
            seed=seed,
        )

    @cached_property
    def channel(self) -> ChannelDescription:
        """What the samples mean; the delay counts from the quantity at the stator."""
        return self._chain.describe(
            quantity=self._quantity,
            unit=self._unit,
            bandwidth=self.parameters.cut_off_frequency,
            high_pass_frequency=0.0,
            delay=self._input_delay + self._low_pass.delay,
            instrument=f"virtual amplifier, {self._quantity} monitor",
            low_pass=FIRST_ORDER,
        )

    @property
    def gain(self) -> float:
        """The calibration factor drawn for this run: measured over true; no receiver knows it."""
        return self._chain.gain

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return the nominal complex gain at frequencies (Hz), delay included, shape (...)."""
        return self._chain.frequency_response(frequency)

    def process(self, samples: ArrayLike) -> tuple[Samples, SampleFlag]:
        """
        Return the measured samples, shape (n,), of the next n true ones (V or A).

        The second value is OVER_RANGE where amplifier or digitiser saturates.

        Raises
        ------
        BadInputError
            If a sample is not finite.

        """
        return self._chain.process(samples)

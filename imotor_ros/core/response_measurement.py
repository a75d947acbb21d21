"""
Measuring the frequency response of the stator: section 3 and figure 5.

With hysteresis a response depends on the signal. Either method finds the linear response nearest
to what the motor does under its own signal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imotor_ros.core.channel import VOLTAGE
from imotor_ros.core.drive_setting import DriveSetting
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.core.response import MeasuredResponse
from imotor_ros.core.response_by_multisine import MULTISINE, Multisine, measure_multisine
from imotor_ros.core.response_by_steps import STEPPED_SINE, measure_steps
from imotor_ros.core.trial import Procedure
from imotor_ros.errors import BadInputError


@dataclass(frozen=True)
class ResponseParameters(Parameters):
    """How a frequency response is measured."""

    method: str = parameter(
        STEPPED_SINE, "signal that is used", options=(STEPPED_SINE, MULTISINE), source="section 3"
    )
    amplitude: float = parameter(
        0.0, "amplitude of the sine, peak of the multisine; 0: 0.6 of what the range leaves about "
        "the offset", unit="V", low=0.0, high=1e3,
        source="table 1: the first harmonic has 37 V",
    )  # fmt: skip
    lowest_frequency: float = parameter(
        1000.0, "lowest frequency", unit="Hz", low=1.0, source="figure 5: a decade below 20 kHz"
    )
    highest_frequency: float = parameter(
        20e3, "highest frequency", unit="Hz", low=1.0, source="above the 18.5 kHz of figure 12"
    )
    points: int = parameter(
        40, "number of frequencies, evenly spaced on a logarithmic scale", low=2, high=2000,
        source="assumed",
    )  # fmt: skip
    settling_time: float = parameter(
        5e-3, "time left out after each change", unit="s", low=0.0, high=10.0,
        source="assumed: ten time constants of the weakest damped mode",
    )  # fmt: skip
    measuring_time: float = parameter(
        10e-3, "least time measured at each frequency", unit="s", low=0.0, excludes_low=True,
        high=10.0, source="assumed: noise of 0.05 % at 1 kHz",
    )  # fmt: skip
    period: float = parameter(
        16e-3, "period of the multisine", unit="s", low=1e-4, high=10.0, source="assumed"
    )
    realisations: int = parameter(
        8, "number of multisines with phases of their own", low=2, high=1000, source="assumed"
    )

    def check(self) -> None:
        """Check that the frequencies rise."""
        if self.highest_frequency <= self.lowest_frequency:
            raise BadInputError(
                "is not above the lowest frequency",
                where=f"{type(self).__name__}.highest_frequency",
                value=self.highest_frequency,
                bound=f"> {self.lowest_frequency:g} Hz",
            )


def measure_response(
    setting: DriveSetting, parameters: ResponseParameters
) -> Procedure[MeasuredResponse]:
    """
    Return the procedure that measures the admittance of rod velocity over measured voltage.

    Parameters
    ----------
    setting : DriveSetting
        How trials are driven.
    parameters : ResponseParameters
        What to measure.

    Returns
    -------
    Procedure
        Its trials need the channels "rod/velocity" and "drive/voltage_monitor".

    Raises
    ------
    DriveLimitError
        If the amplitude is more than the limits allow.
    BadInputError
        If the vibrometer is over range, or a number makes no sense.

    """
    if parameters.highest_frequency > 0.1 * setting.sample_rate:
        raise BadInputError(
            "is too high for the sample rate",
            where="highest_frequency",
            value=parameters.highest_frequency,
            bound=f"<= {0.1 * setting.sample_rate:g} Hz",
        )
    frequencies = np.geomspace(
        parameters.lowest_frequency, parameters.highest_frequency, parameters.points
    )
    rounded = tuple(float(f"{frequency:.6g}") for frequency in frequencies)
    times = parameters.settling_time, parameters.measuring_time
    if parameters.method == MULTISINE:
        amplitude = setting.amplitude(parameters.amplitude)
        multisine = Multisine(
            setting, rounded, amplitude, parameters.period, *times, parameters.realisations
        )
        return (yield from measure_multisine(multisine))
    steps = yield from measure_steps(
        setting,
        rounded,
        parameters.amplitude,
        settling_time=times[0],
        measuring_time=times[1],
        reference=VOLTAGE,
    )
    return steps.large

"""When a corrected excitation is good enough."""

from __future__ import annotations

import math
from dataclasses import dataclass

from imotor_ros.core.parameters import Parameters, parameter


@dataclass(frozen=True)
class CorrectionParameters(Parameters):
    """How the voltage for a motion is found."""

    amplitude_tolerance: float = parameter(
        0.01, "largest relative error of an amplitude", low=1e-6, high=1.0, source="section 6"
    )
    phase_tolerance: float = parameter(
        math.radians(1.0), "largest error of a phase", unit="rad", low=1e-6, high=3.0,
        source="section 6",
    )  # fmt: skip
    cycle_limit: int = parameter(
        6, "most corrections before the motion counts as out of reach", low=0, high=100,
        source="section 6: typically one is sufficient",
    )  # fmt: skip
    suppressed_harmonics: int = parameter(
        8, "further harmonics that hysteresis makes and the correction brings to rest", low=0,
        high=64, source="assumed; the paper corrects none",
    )  # fmt: skip
    suppression_limit: float = parameter(
        60e3, "highest frequency of such a harmonic; a tenth of the sample rate at most", unit="Hz",
        low=0.0, high=1e6, source="assumed: what amplifier and vibrometer manage",
    )  # fmt: skip
    suppression_tolerance: float = parameter(
        0.05, "largest velocity of such a harmonic over that of the largest wanted one", low=1e-4,
        high=10.0, source="assumed",
    )  # fmt: skip
    response_amplitude: float = parameter(
        0.0, "amplitude of the sines that measure the response; 0: 0.6 of what the range leaves",
        unit="V", low=0.0, high=1e3, source="table 1: the first harmonic has 37 V",
    )  # fmt: skip
    settling_time: float = parameter(
        8e-3, "time left out after each change; three periods at least", unit="s", low=0.0,
        high=10.0, source="assumed: ten time constants of the weakest damped mode",
    )  # fmt: skip
    measuring_time: float = parameter(
        20e-3, "least time measured", unit="s", low=0.0, excludes_low=True, high=10.0,
        source="assumed: noise of 0.1 % of the smallest harmonic of figure 12",
    )  # fmt: skip

"""One point of a campaign: signal, drive and stand, as one parameter object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from imotor_ros.core.correction_parameters import CorrectionParameters
from imotor_ros.core.evaluator import EvaluatorParameters
from imotor_ros.core.identification.stepped_sine import SteppedSineParameters
from imotor_ros.core.parameters import Parameters, choice, group, parameter
from imotor_ros.core.signals import (
    HarmonicMotion,
    classic_sawtooth,
    parabolic_sawtooth,
    sine,
)
from imotor_ros.core.stand import StandParameters
from imotor_ros.errors import BadInputError


@dataclass(frozen=True)
class SignalParameters(Parameters):
    """The wanted periodic motion of the rod."""

    shape: str = parameter(
        "parabolic_sawtooth",
        "ideal signal whose first harmonics are taken",
        options=("parabolic_sawtooth", "classic_sawtooth", "sine"),
        source="section 2, figures 1 and 2",
    )
    harmonics: int = parameter(2, "number of harmonics", low=1, high=64, source="section 6")
    maximum_frequency: float = parameter(
        9250.0, "frequency of the highest harmonic", unit="Hz", low=1.0, high=200e3
    )
    stroke: float = parameter(
        15e-6, "peak-to-peak displacement", unit="m", low=0.0, excludes_low=True, high=1e-3
    )

    @property
    def motion(self) -> HarmonicMotion:
        """The motion of the rod."""
        if self.shape == "sine":
            return sine(0.5 * self.stroke, self.maximum_frequency)
        make = parabolic_sawtooth if self.shape == "parabolic_sawtooth" else classic_sawtooth
        return make(self.harmonics, self.stroke, maximum_frequency=self.maximum_frequency)


@dataclass(frozen=True)
class DriveParameters(Parameters):
    """How the drive voltage starts, lasts and stops."""

    offset: float = parameter(
        50.0, "voltage about which the harmonics swing", unit="V", low=-1e3, high=1e3
    )
    bias_time: float = parameter(
        5e-3, "time taken to reach the offset and to leave it", unit="s", low=0.0, high=60.0
    )
    ramp_periods: float = parameter(
        1.0, "length of the amplitude ramps, in periods of the fundamental", low=0.0, high=1e6
    )
    hold_time: float = parameter(
        0.25, "length of the steady drive", unit="s", low=0.0, excludes_low=True, high=3600.0
    )


DRIVE_KINDS: Mapping[str, type[Parameters]] = {
    "steady": DriveParameters,
    "stepped_sine": SteppedSineParameters,
}
"""How a run is driven: by the point's signal, or by a sine of stepped amplitude instead of it."""


@dataclass(frozen=True)
class PointParameters(Parameters):
    """All that one run depends on: together with the version of the code, it repeats the run."""

    seed: int = parameter(1, "seed of all that is random in the run", low=0, high=2**63 - 1)
    report_interval: float = parameter(
        0.05, "stream time between provisional indicators, 0 for none", unit="s", low=0.0, high=3600
    )
    signal: SignalParameters = group(SignalParameters)
    drive: Parameters = choice("kind", "steady", DRIVE_KINDS)
    excitation: str = parameter(
        "corrected",
        "whether the voltage of the measured linear model is corrected by the measured motion",
        options=("corrected", "linear"),
        source="section 6",
    )
    correction: CorrectionParameters = group(CorrectionParameters)
    stand: StandParameters = group(StandParameters)
    evaluator: EvaluatorParameters = group(EvaluatorParameters)

    def check(self) -> None:
        """Refuse a signal that the sample rate cannot hold."""
        highest, rate = self.signal.maximum_frequency, self.stand.sample_rate
        if highest >= 0.5 * rate:
            raise BadInputError(
                "is too high for the sample rate",
                where="signal.maximum_frequency",
                value=highest,
                bound=f"< {0.5 * rate:g} Hz, half of stand.sample_rate",
            )

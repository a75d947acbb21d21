"""
From the wanted rod motion to the voltage, as section 6 of the paper does it.

First the response at the harmonics is measured and the wanted motion passed through its inverse:
the voltage of the linear model. Hysteresis spoils what comes of it; so the rod velocity is
measured while that voltage is played, and the voltage changed by what is missing, over and over
until amplitudes and phases are right. The first change uses the measured response alone; later
ones also what the changes before have done (Broyden's method).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from imotor_ros.core.correction_parameters import CorrectionParameters
from imotor_ros.core.correction_search import Broyden, MotionErrors, Search
from imotor_ros.core.drive_limits import DriveLimits
from imotor_ros.core.drive_setting import DriveSetting
from imotor_ros.core.excitation import Excitation
from imotor_ros.core.response_by_steps import measure_steps
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.trial import Procedure, Trial
from imotor_ros.errors import BadInputError, ExcitationError

__all__ = ["CorrectionParameters", "Excitation", "ExcitationRequest", "correct_excitation"]


@dataclass(frozen=True)
class ExcitationRequest:
    """
    A motion for which a voltage is wanted.

    Attributes
    ----------
    run_id : str
        Name of the search; those of its trials begin with it.
    epoch : int
        Time of sample 0 of every trial (ns since 1970).
    sample_rate : float
        Samples per second (Hz).
    motion : HarmonicMotion
        Wanted displacement of the rod, with the cycles of the drive.
    offset : float
        Voltage (V) about which the harmonics swing.
    bias_time : float
        Time (s) taken to reach the offset and to leave it.
    ramp_periods : float
        Length of the amplitude ramps, in periods of the fundamental.
    is_corrected : bool
        Whether to correct the voltage of the linear model, or only to try it.
    parameters : CorrectionParameters
        When to be content.

    Raises
    ------
    BadInputError
        If a number makes no sense, or the motion is too fast for the sample rate.

    """

    run_id: str
    epoch: int
    sample_rate: float
    motion: HarmonicMotion
    offset: float
    bias_time: float
    ramp_periods: float = 1.0
    is_corrected: bool = True
    parameters: CorrectionParameters = field(default_factory=CorrectionParameters)

    def __post_init__(self) -> None:
        """Check the numbers: a request may come from outside, by a message."""
        highest = self.motion.max_frequency
        for name, is_good, bound in (
            ("sample_rate", self.sample_rate > 2.0 * highest, f"> {2.0 * highest:g} Hz"),
            ("offset", True, "a number of V"),
            ("bias_time", 0.0 <= self.bias_time <= 60.0, ">= 0 and <= 60 s"),
            ("ramp_periods", 0.0 <= self.ramp_periods <= 1e6, ">= 0 and <= 1e6"),
        ):
            value = getattr(self, name)
            if not (is_good and math.isfinite(value)):
                raise BadInputError(
                    "cannot be used", where=f"{self.run_id}: {name}", value=value, bound=bound
                )

    def procedure(self, limits: DriveLimits) -> Procedure[Excitation]:
        """Return the procedure that finds the voltage within limits; see `correct_excitation`."""
        setting = DriveSetting(
            self.run_id, self.epoch, self.sample_rate, self.offset, self.bias_time, limits
        )
        return correct_excitation(
            setting,
            self.motion,
            self.parameters,
            ramp_periods=self.ramp_periods,
            is_corrected=self.is_corrected,
        )


def correct_excitation(
    setting: DriveSetting,
    motion: HarmonicMotion,
    parameters: CorrectionParameters,
    *,
    ramp_periods: float = 1.0,
    is_corrected: bool = True,
) -> Procedure[Excitation]:
    """
    Return the procedure that finds the voltage for a motion.

    Parameters
    ----------
    setting : DriveSetting
        How trials are driven.
    motion : HarmonicMotion
        Wanted displacement of the rod, with the cycles of the drive.
    parameters : CorrectionParameters
        When to be content.
    ramp_periods : float
        Length of the amplitude ramps, in periods of the fundamental.
    is_corrected : bool
        Whether to correct the voltage of the linear model, or only to try it.

    Returns
    -------
    Procedure
        Its trials need the channel "rod/velocity".

    Raises
    ------
    DriveLimitError
        If the motion needs more than motor, amplifier or vibrometer allow.
    BadInputError
        If the response at a harmonic cannot be measured.
    ExcitationError
        If the errors do not become small enough.

    """
    search = Search(setting, motion, parameters, ramp_periods, is_corrected)
    response = yield from measure_steps(
        setting,
        [k * motion.fundamental_frequency for k in range(1, search.count + 1)],
        parameters.response_amplitude,
        settling_time=parameters.settling_time,
        measuring_time=parameters.measuring_time,
    )
    search.check_velocity(response.velocity_range)
    gains = search.gains(response)
    voltage = search.linear_voltage(gains)
    steps = Broyden(gains)
    found: list[MotionErrors] = []
    for cycle in range(parameters.cycle_limit + 1):
        last = found[-1].largest if found else (math.nan, math.nan)
        stage = f"cycle {cycle}" if cycle else "linear model"
        recording = yield Trial(search.program(f"cycle-{cycle}", voltage), stage, cycle, *last)
        moved = search.measure(recording)
        found.append(search.errors(moved))
        is_last = cycle == parameters.cycle_limit
        if not is_corrected or search.is_content(found[-1], is_last=is_last):
            return search.result(gains, voltage, found)
        voltage = steps.next_voltage(voltage, moved.phasors, search.wanted)
    raise ExcitationError(search.failure(found[-1]))

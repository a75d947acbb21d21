"""What the identification tells: steps, laws, break-away force, calibration, warnings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from imotor_ros.core.friction import FRICTION_LAWS, FrictionLaw
from imotor_ros.core.identification.break_away import BreakAway
from imotor_ros.core.identification.fits import Estimate, FrictionFit
from imotor_ros.core.identification.stepped_sine import DriveStep
from imotor_ros.core.identification.steps import StepMeasurement
from imotor_ros.errors import BadInputError


@dataclass(frozen=True)
class StepResult:
    """
    What came of one step.

    Attributes
    ----------
    step : DriveStep
        The step.
    measurement : StepMeasurement or None
        What it tells.
    regime : str
        "sticks", "both" or "slides"; empty without a measurement.
    is_fitted : bool
        Whether a law was fitted to it.
    reason : str
        Why there is no measurement, or why it slides above the threshold and was not fitted.
    is_bad : bool
        Whether its samples are clipped, dropped or missing.

    """

    step: DriveStep
    measurement: StepMeasurement | None = None
    regime: str = ""
    is_fitted: bool = False
    reason: str = ""
    is_bad: bool = False


@dataclass(frozen=True)
class Calibration:
    """
    What wrong calibrations of the two heads do to the chosen law.

    Attributes
    ----------
    gain_uncertainties : mapping of str to float
        Relative standard uncertainty by channel.
    sensitivities : mapping of str to mapping of str to float
        Relative change of each parameter over the relative change of each channel's gain.
    uncertainties : mapping of str to float
        Standard uncertainty of each parameter (its unit) that follows.
    head_ratio, head_phase : float
        First harmonic of the slider's velocity over that of the rod's where the slider sticks,
        amplitude and phase (rad); 1 and 0 for heads that agree.
    head_uncertainty : float
        Standard deviation of both, by noise; NaN if no step sticks.

    """

    gain_uncertainties: Mapping[str, float]
    sensitivities: Mapping[str, Mapping[str, float]]
    uncertainties: Mapping[str, float]
    head_ratio: float
    head_phase: float
    head_uncertainty: float


@dataclass(frozen=True)
class Identification:
    """
    All that a run tells of the friction contact.

    Attributes
    ----------
    frequency, mass : float
        Of the drive (Hz), of the slider (kg).
    steps : tuple of StepResult
        Every step.
    fits : mapping of str to FrictionFit
        Every law; empty if `reason` is not.
    chosen : str
        The law that describes the run best.
    threshold : float
        Smallest mean relative speed of a step that was fitted (m/s), as set.
    sliding_from : float
        Mean relative speed (m/s) from which on every step slides all the time; NaN if none does.
    hysteresis : Estimate or None
        Sliding force on the falling branch less that on the rising one (N).
    break_away : BreakAway
        From the transition between sticking and sliding.
    calibration : Calibration or None
        What wrong calibrations do.
    warnings : tuple of str
        What is to be known of the result.
    reason : str
        Why there is no law; empty if there is one.

    """

    frequency: float
    mass: float
    steps: tuple[StepResult, ...]
    fits: Mapping[str, FrictionFit]
    chosen: str
    threshold: float
    sliding_from: float
    hysteresis: Estimate | None
    break_away: BreakAway | None
    calibration: Calibration | None
    warnings: tuple[str, ...] = ()
    reason: str = ""

    @property
    def fit(self) -> FrictionFit:
        """
        The chosen law.

        Raises
        ------
        BadInputError
            If there is none.

        """
        if self.reason:
            raise BadInputError(self.reason, where="friction identification")
        return self.fits[self.chosen]

    @property
    def friction(self) -> FrictionLaw:
        """The chosen law with its break-away force, for the virtual motor and the models."""
        mapping = {k: v for k, v in self.friction_mapping().items() if k != "law"}
        law = FRICTION_LAWS[self.chosen].from_mapping(mapping)
        assert isinstance(law, FrictionLaw)
        return law

    def friction_mapping(self) -> dict[str, Any]:
        """
        Return the friction group of a motor's YAML file: the law, its parameters.

        The break-away force is 0, which means the sliding force at zero speed as in the paper,
        unless the transition clearly shows more.
        """
        fit, more = self.fit, self.break_away
        values: dict[str, Any] = {"law": fit.law}
        for name, one in fit.estimates.items():
            if name != "zero_speed_force":
                values[name] = _rounded(one.value)
        values["break_away_force"] = 0.0
        zero = fit.estimates["zero_speed_force"]
        if more and more.is_clear and more.force and more.force.low > max(zero.high, zero.value):
            values["break_away_force"] = _rounded(more.force.value)
        return values

    def to_mapping(self) -> dict[str, Any]:
        """Return all of it as plain JSON; what does not exist is null, and its reason beside it."""
        more = self.break_away
        return {
            "frequency": self.frequency,
            "mass": self.mass,
            "chosen": self.chosen or None,
            "reason": self.reason,
            "friction": None if self.reason else self.friction_mapping(),
            "threshold": self.threshold,
            "sliding_from": _or_none(self.sliding_from),
            "laws": {law: _fit_mapping(fit) for law, fit in self.fits.items()},
            "hysteresis": None if self.hysteresis is None else self.hysteresis.to_mapping(),
            "break_away": None if more is None else _break_away_mapping(more, self.paper_force),
            "calibration": _finite(asdict(self.calibration)) if self.calibration else None,
            "warnings": list(self.warnings),
            "steps": [_step_mapping(one, self.mass) for one in self.steps],
        }

    @property
    def paper_force(self) -> Estimate | None:
        """Break-away force (N) by the paper's assumption: the chosen law at zero speed."""
        return self.fits[self.chosen].estimates["zero_speed_force"] if self.chosen else None


def _fit_mapping(fit: FrictionFit) -> dict[str, Any]:
    return {
        "estimates": {name: one.to_mapping() for name, one in fit.estimates.items()},
        "scatter": fit.scatter,
        "information": fit.information,
        "remark": fit.remark,
    }


def _break_away_mapping(more: BreakAway, paper_force: Estimate | None) -> dict[str, Any]:
    return {
        "force": None if more.force is None else more.force.to_mapping(),
        "zero_speed_force": None if paper_force is None else paper_force.to_mapping(),
        "sliding_force": _or_none(more.sliding_force),
        "highest_sticking": _or_none(more.highest_sticking),
        "lowest_slipping": _or_none(more.lowest_slipping),
        "steps": more.steps,
        "distortion": _or_none(more.distortion),
        "reason": more.reason,
        "remark": more.remark,
    }


def _step_mapping(result: StepResult, mass: float) -> dict[str, Any]:
    values: dict[str, Any] = {
        "number": result.step.number,
        "branch": result.step.branch,
        "start": result.step.start,
        "end": result.step.end,
        "regime": result.regime or None,
        "is_fitted": result.is_fitted,
        "reason": result.reason,
    }
    one = result.measurement
    if one is None:
        return values
    values["dynamic_friction_force"] = mass * one.mean_acceleration
    values["dynamic_friction_force_noise"] = mass * one.mean_acceleration_noise
    values.update({name: getattr(one, name) for name in _STEP_NUMBERS})
    values["odd_harmonics"] = list(one.odd_harmonics)
    return dict(_finite(values))


_STEP_NUMBERS = (
    "periods",
    "rod_amplitude",
    "mean_relative_speed",
    "mean_slider_speed",
    "phase",
    "amplitude_ratio",
    "phase_noise",
    "excess_harmonic",
    "crossing_margin",
    "closest_approach",
    "rising_share",
    "drift",
    "misfit",
)


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _finite(values: Any) -> Any:
    """Return the same with None in place of numbers that do not exist."""
    if isinstance(values, Mapping):
        return {key: _finite(value) for key, value in values.items()}
    return _or_none(values) if isinstance(values, float) else values


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")

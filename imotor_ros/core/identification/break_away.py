"""
The break-away force, from the transition between sticking and sliding.

Not a measured acceleration of the slider, but how fast its motion departs from the rod's as
the amplitude rises tells how much force the contact held. Between the steps that stick and those
that slide all the time, the mean relative speed is compared with that of a slider that breaks
away at F_b and then slides at F_d, driven by the rod motion that was measured; the two forces are
fitted. If F_b is found to be F_d, the paper's assumption, sliding force at zero speed, stands.

The force scales with the rod's acceleration, so with the calibration of the rod's head. What the
two heads disagree by where the slider sticks is taken out of the slider's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core import closed_form
from imotor_ros.core.friction import VelocityDependentFriction
from imotor_ros.core.identification.corners import TURN
from imotor_ros.core.identification.fits import Estimate
from imotor_ros.core.identification.regime import (
    BOTH,
    SLIDES,
    STICKS,
    Agreement,
    stick_tolerance,
)
from imotor_ros.core.identification.steps import StepMeasurement
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import SliderParameters

Array = NDArray[np.float64]

_FEWEST_STEPS = 4
_PERIODS = 25
_GRID = TURN * np.arange(1024) / 1024.0
_SIGNIFICANT = 4.0

# The relative speeds that a fit may be off by, over their noise, before the model is not believed;
# and what is always allowed for, as a share of them.
_CLEAR_MISFIT = 5.0
_MODEL_SHARE = 5e-3

# Shape of the rod's motion up to which breaking loose for a moment would be seen.
_CLEAR_DISTORTION = 1.25


@dataclass(frozen=True)
class BreakAway:
    """
    What the transition tells.

    Attributes
    ----------
    force : Estimate or None
        Break-away force (N).
    sliding_force : float
        Sliding force at low speed (N) that goes with it; NaN without.
    highest_sticking, lowest_slipping : float
        Force (N) that the contact held in the last step that sticks, at least, and force that was
        too much in the first step that does not; NaN where there is none.
    steps : int
        Number of steps fitted.
    distortion : float
        Greatest rod acceleration in the first step that slips, over that of its first harmonic.
    reason : str
        Why there is no force; empty if there is.
    remark : str
        What is to be known of the force; empty if nothing.

    """

    force: Estimate | None
    sliding_force: float
    highest_sticking: float
    lowest_slipping: float
    steps: int
    distortion: float = math.nan
    reason: str = ""
    remark: str = ""

    @property
    def is_clear(self) -> bool:
        """Whether a break-away force above the sliding force would have been seen."""
        return self.force is not None and not self.remark


@dataclass(frozen=True)
class Transition:
    """
    The steps among which the transition lies, and what is known beside them.

    Attributes
    ----------
    measurements : sequence of StepMeasurement
        The steps.
    regimes : sequence of str
        Whether the slider sticks, slides or both.
    agreement : Agreement
        How the heads agree where it sticks.
    frequency, mass : float
        Of the drive (Hz), of the slider (kg).
    slope : float
        Rise of the sliding force with speed (N s/m).

    """

    measurements: Sequence[StepMeasurement]
    regimes: Sequence[str]
    agreement: Agreement
    frequency: float
    mass: float
    slope: float

    def of(self, *regimes: str) -> list[StepMeasurement]:
        """Return the steps of some regimes."""
        pairs = zip(self.measurements, self.regimes, strict=True)
        return [one for one, regime in pairs if regime in regimes]


def estimate_break_away(transition: Transition, confidence: float = 0.95) -> BreakAway:
    """Return the break-away force, or why there is none."""
    sticking, moving = transition.of(STICKS), transition.of(BOTH, SLIDES)
    steps = transition.of(BOTH)
    found = _bracket(sticking, moving, transition)
    reason = _reason(sticking, moving, steps)
    if reason:
        return replace(found, reason=reason)
    fit = _fit(steps, transition, found.lowest_slipping)
    if fit.misfit > _CLEAR_MISFIT:
        return replace(
            found,
            reason="between sticking and sliding the slider does not move as one that breaks "
            f"away at one force and slides at another: {fit.misfit:.0f} times the noise apart",
        )
    remark = ""
    if found.distortion > _CLEAR_DISTORTION:
        remark = (
            f"the rod's acceleration peaks {found.distortion:.1f} times as high as that of its "
            "first harmonic: a break-away force above the sliding force would not be seen"
        )
    return replace(
        found, force=fit.interval(confidence), sliding_force=fit.sliding_force, remark=remark
    )


def _bracket(
    sticking: Sequence[StepMeasurement], moving: Sequence[StepMeasurement], transition: Transition
) -> BreakAway:
    """Return the forces on both sides of the transition, without one between."""
    below = max((_held(one, transition) for one in sticking), default=math.nan)
    above, distortion = math.nan, math.nan
    if moving:
        first = min(moving, key=lambda one: _greatest_force(one, transition))
        above = _greatest_force(first, transition)
        omega = TURN * transition.frequency
        distortion = above / (transition.mass * omega**2 * first.rod_amplitude)
    return BreakAway(None, math.nan, below, above, len(transition.of(BOTH)), distortion)


def _reason(
    sticking: Sequence[StepMeasurement],
    moving: Sequence[StepMeasurement],
    between: Sequence[StepMeasurement],
) -> str:
    if not sticking:
        return "no step sticks: the transition lies below the lowest amplitude"
    if not moving:
        return "no step slides: the transition lies above the highest amplitude"
    if len(between) < _FEWEST_STEPS:
        return (
            f"only {len(between)} steps between sticking and sliding, at least {_FEWEST_STEPS} "
            "are needed: take smaller steps"
        )
    return ""


def rod_motion(measurement: StepMeasurement, frequency: float) -> HarmonicMotion:
    """Return the measured rod displacement, of harmonics that are more than noise."""
    rod = measurement.rod
    orders = np.arange(1, rod.phasors.size + 1)
    is_clear = np.abs(rod.phasors) > _SIGNIFICANT * rod.noise
    is_clear[0] = True
    count = int(np.flatnonzero(is_clear)[-1]) + 1
    # v = Re V exp(i k theta) belongs to x = |X| sin(k theta + psi), psi = arg(i X)
    displacement = np.where(is_clear, rod.phasors, 0.0) / (1j * TURN * frequency * orders)
    amplitudes, phases = np.abs(displacement), np.angle(1j * displacement)
    return HarmonicMotion(frequency, tuple(amplitudes[:count]), tuple(phases[:count]))


def _greatest_force(measurement: StepMeasurement, transition: Transition) -> float:
    """Return the greatest force (N) that a slider would need to follow the rod of a step."""
    motion = rod_motion(measurement, transition.frequency)
    time = _GRID / (TURN * transition.frequency)
    return transition.mass * float(np.abs(motion.acceleration(time)).max())


def _held(measurement: StepMeasurement, transition: Transition) -> float:
    """
    Return the force (N) that a step which sticks shows to be held, at least.

    A slip too small to be seen may have begun: above the break-away amplitude A_0 the relative
    motion grows as 2 (A / A_0 - 1)^2, as a share of the rod's.
    """
    beyond = 1.0 + math.sqrt(0.5 * stick_tolerance(measurement))
    return _greatest_force(measurement, transition) / beyond


@dataclass(frozen=True)
class _Fit:
    """Forces found, with the covariance of break-away force and its excess over sliding."""

    force: float
    excess: float
    deviation: float
    misfit: float
    freedom: int

    @property
    def sliding_force(self) -> float:
        return self.force - self.excess

    def interval(self, confidence: float) -> Estimate:
        from scipy.special import stdtrit

        reach = self.deviation * float(stdtrit(self.freedom, 0.5 + 0.5 * confidence))
        return Estimate(self.force, self.force - reach, self.force + reach)


def _fit(steps: Sequence[StepMeasurement], transition: Transition, start: float) -> _Fit:
    from scipy.optimize import least_squares

    gain = 1.0 / transition.agreement.ratio
    wanted = np.array([float(one.relative_speeds(gain).mean()) for one in steps])
    noise = np.hypot([one.rod.noise for one in steps], _MODEL_SHARE * wanted)
    motions = [rod_motion(one, transition.frequency) for one in steps]

    def misfits(forces: Array) -> Array:
        force, excess = float(forces[0]), float(forces[1])
        found = [_relative_speed(motion, force, excess, transition) for motion in motions]
        return np.asarray((np.array(found) - wanted) / noise)

    bounds = ([1e-6 * start, 0.0], [np.inf, np.inf])
    tries = [
        least_squares(misfits, [start, share * start], bounds=bounds, x_scale=start, diff_step=1e-4)
        for share in (0.02, 0.3)
    ]
    best = min(tries, key=lambda one: float(one.cost))
    freedom = len(steps) - 2
    misfit = math.sqrt(2.0 * float(best.cost) / freedom)
    # an excess that is 0 cannot get smaller: the force alone is left to be found
    free = best.jac if best.x[1] > 1e-3 * best.x[0] else best.jac[:, :1]
    covariance = np.linalg.pinv(free.T @ free) * max(misfit, 1.0) ** 2
    force, excess = (float(x) for x in best.x)
    return _Fit(force, excess, math.sqrt(float(covariance[0, 0])), misfit, freedom)


def _relative_speed(
    motion: HarmonicMotion, force: float, excess: float, transition: Transition
) -> float:
    """Return the mean relative speed (m/s) of a slider that breaks away at `force`."""
    sliding = max(force - excess, 1e-3 * force)
    law = VelocityDependentFriction(
        sliding_force=sliding,
        slope=max(transition.slope, 0.0),
        break_away_force=max(force, sliding),
    )
    slider = SliderParameters(mass=transition.mass)
    table = closed_form.simulate(motion, slider, law, periods=_PERIODS)
    return float(table.mean_relative_speed[-1])

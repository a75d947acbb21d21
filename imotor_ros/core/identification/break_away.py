"""
The break-away force, from the transition between sticking and sliding.

Not a measured acceleration of the slider, but how fast its motion departs from the rod's as
the amplitude rises tells how much force the contact held. Between the steps that stick and those
that slide all the time, the first odd harmonics of the relative velocity are compared with those
of a slider that breaks away at F_b and then slides at F_d, driven by the rod motion that was
measured; the two forces are fitted. Unless F_b is clearly above F_d, one force is fitted for both:
the paper's assumption, sliding force at zero speed, stands.

The force scales with the rod's acceleration, so with the calibration of the rod's head. What the
two heads disagree by where the slider sticks is taken out of the slider's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

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
Complex = NDArray[np.complex128]

_FEWEST_STEPS = 4
_PERIODS = 25
_GRID = TURN * np.arange(1024) / 1024.0
_TURNS = np.arange(512) / 512.0
_ORDERS = np.array([1, 3, 5])
_SIGNIFICANT = 4.0

# What a fit may be off by, over the noise, before the model is not believed; what is always
# allowed for, as a share of the relative motion; and the fall of chi square, over that per step,
# by which a break-away force above the sliding force is clear.
_CLEAR_MISFIT = 5.0
_MODEL_SHARE = 5e-3
_CLEAR_GAIN = 12.0

# What the rod's ripple leaves open of the force, as a share, where two forces are fitted: then the
# step closest to the transition decides, which any ripple moves. Found from known contacts.
_OPEN_SHARE = 5e-3

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
    is_clear = np.abs(measurement.rod.phasors) > _SIGNIFICANT * measurement.rod.noise
    return _motion(measurement, frequency, is_clear.astype(np.float64))


def _likely_motion(measurement: StepMeasurement, frequency: float) -> HarmonicMotion:
    """
    Return the rod displacement as it most likely is: each harmonic less the noise in its power.

    Whether ripple is left out or noise taken for ripple, the force would come out wrong by some
    tenths of a per cent.
    """
    rod = measurement.rod
    share = 1.0 - 2.0 * (rod.noise / np.maximum(np.abs(rod.phasors), rod.noise)) ** 2
    return _motion(measurement, frequency, np.maximum(share, 0.0))


def _motion(measurement: StepMeasurement, frequency: float, shares: Array) -> HarmonicMotion:
    """Return the rod displacement made of shares of its harmonics; all of the first."""
    phasors = np.where(np.arange(shares.size) > 0, shares, 1.0) * measurement.rod.phasors
    count = int(np.flatnonzero(phasors)[-1]) + 1
    # v = Re V exp(i k theta) belongs to x = |X| sin(k theta + psi), psi = arg(i X)
    orders = np.arange(1, phasors.size + 1)
    displacement = phasors / (1j * TURN * frequency * orders)
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

    That of the rod's first harmonic: for the moments in which higher ones add to it, the slider
    may slip and not be seen to. Nor is the beginning: above the break-away amplitude A_0 the
    relative motion grows as 2 (A / A_0 - 1)^2, as a share of the rod's.
    """
    beyond = 1.0 + math.sqrt(0.5 * stick_tolerance(measurement))
    acceleration = (TURN * transition.frequency) ** 2 * measurement.rod_amplitude
    return transition.mass * acceleration / beyond


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
    """
    Fit break-away force and excess; the excess only where it explains clearly more than none.

    Without that choice both forces would share the noise, and neither be known.
    """
    from scipy.optimize import least_squares

    motions = [_likely_motion(one, transition.frequency) for one in steps]
    wanted = np.array([_departure(one, transition.agreement) for one in steps])
    noise = np.hypot(
        [[math.hypot(one.rod.noise, one.slider_harmonics.noise)] for one in steps],
        _MODEL_SHARE * np.linalg.norm(wanted, axis=1, keepdims=True),
    )

    def misfits(forces: Array) -> Array:
        excess = float(forces[1]) if forces.size > 1 else 0.0
        found = [_predict_departure(one, float(forces[0]), excess, transition) for one in motions]
        left = (np.array(found) - wanted) / noise
        return np.concatenate([left.real.ravel(), left.imag.ravel()])

    def solve(*first: float) -> Any:
        return least_squares(
            misfits, first, bounds=(0.0, np.inf), x_scale=start, diff_step=1e-4, xtol=1e-6
        )

    best = alone = solve(0.95 * start)
    if _misfit(alone) > 1.0:
        force = float(alone.x[0])
        both = min((solve(force, share * force) for share in (0.02, 0.3)), key=lambda one: one.cost)
        # the steps are independent, not what each one shows
        per_step = 2.0 * float(both.cost) / (len(steps) - 2)
        limit = _CLEAR_GAIN * max(per_step, both.fun.size / len(steps))
        best = both if 2.0 * float(alone.cost - both.cost) > limit else alone
    excess = float(best.x[1]) if best.x.size > 1 else 0.0
    freedom = len(steps) - best.x.size
    return _Fit(float(best.x[0]), excess, _deviation(best, len(steps)), _misfit(best), freedom)


def _deviation(solution: Any, steps: int) -> float:
    """
    Return the standard deviation of the force (N), from how the steps disagree.

    What the rod's ripple does to a step it does to all harmonics of it, so that the steps are
    independent, but not their harmonics. Where few of them agree by chance, it is their noise.
    """
    parts = (solution.jac * solution.fun[:, None]).reshape(2, steps, -1, solution.x.size)
    scores = parts.sum(axis=(0, 2))
    inverse = np.linalg.pinv(solution.jac.T @ solution.jac)
    covariance = inverse @ (scores.T @ scores) @ inverse * steps / (steps - solution.x.size)
    alone = float(inverse[0, 0]) * max(_misfit(solution), 1.0) ** 2
    least = _OPEN_SHARE * float(solution.x[0]) if solution.x.size > 1 else 0.0
    return max(math.sqrt(max(float(covariance[0, 0]), alone)), least)


def _misfit(solution: Any) -> float:
    return math.sqrt(2.0 * float(solution.cost) / (solution.fun.size - solution.x.size))


def _departure(measurement: StepMeasurement, agreement: Agreement) -> Complex:
    """Return by how much the slider's harmonics 1, 3, 5 differ from the rod's (m/s)."""
    slider = measurement.slider_harmonics.seen_as(1.0 / agreement.ratio)
    return np.asarray(slider.phasors[_ORDERS - 1] - measurement.rod.phasors[_ORDERS - 1])


def _predict_departure(
    motion: HarmonicMotion, force: float, excess: float, transition: Transition
) -> Complex:
    """Return the same (m/s) of a slider that breaks away at `force`."""
    sliding = max(force - excess, 1e-3 * force)
    law = VelocityDependentFriction(
        sliding_force=sliding,
        slope=max(transition.slope, 0.0),
        break_away_force=max(force, sliding),
    )
    slider = SliderParameters(mass=transition.mass)
    table = closed_form.simulate(motion, slider, law, periods=_PERIODS, record=True)
    assert table.trajectory is not None
    found = table.trajectory.sample((_PERIODS - 1 + _TURNS) * motion.period)
    spectrum = np.fft.rfft(found.velocity - found.rod_velocity)
    return np.asarray(2.0 * spectrum[_ORDERS] / _TURNS.size)

"""
The error that the low-pass leaves in forces under a Stribeck law, found and taken off.

The force peak of such a law at low speed is passed in some microseconds, which the harmonics below
half the bandwidth resolve in part only: forces come out up to 0.5 % low. So a fitted law is made
to predict the slider velocity, the prediction is evaluated as the measurement was, and the
difference to the law's own mean force is taken off the measured forces: the law is then fitted
again, until it stays. A law whose excess decays within less speed than the harmonics resolve has
a rival that decays more slowly and explains the forces as well. Both are followed; where they
tie, the intervals hold both, and a remark tells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from imotor_ros.core.friction import FrictionLaw, StribeckFriction
from imotor_ros.core.identification.fits import (
    STRIBECK,
    Bootstrap,
    Estimate,
    FrictionFit,
    SlidingSteps,
    fit_law,
)
from imotor_ros.core.identification.prediction import predict_slider
from imotor_ros.core.identification.steps import StepMeasurement, fit_waveform
from imotor_ros.core.phases import trigonometric_value
from imotor_ros.errors import BadInputError, SolverError

_POINTS = 2048
_ROUNDS = 3

# Decay velocities (m/s) of the rival that is tried beside the law fitted first: the first one that
# is not its own, by half an octave at least.
_RIVAL_DECAYS = (5e-3, 15e-3)

# Two laws tie while the information criterion does not part them by more; and are the same law
# while their decay velocities are within a quarter.
_TIE = 6.0
_SAME_DECAY = 1.25


def estimation_error(
    measurement: StepMeasurement, friction: FrictionLaw, mass: float, frequency: float
) -> float:
    """
    Return by how much the force of a step is estimated too large (N) if a law is true.

    Parameters
    ----------
    measurement : StepMeasurement
        The step.
    friction : FrictionLaw
        The law.
    mass, frequency : float
        Of the slider (kg), of the drive (Hz).

    Raises
    ------
    SolverError
        If the solver cannot go on.

    """
    rod = measurement.rod
    phase = 2.0 * np.pi * np.arange(_POINTS) / _POINTS
    velocity = predict_slider(measurement, friction, mass, frequency, phase)
    count = measurement.slider_harmonics.phasors.size
    spectrum = 2.0 * np.fft.rfft(velocity)[1 : count + 1] / _POINTS
    slider = replace(rod, mean=0.0, phasors=spectrum, drift=0j)
    found = mass * frequency * fit_waveform(rod, slider).total_variation
    speeds = np.abs(trigonometric_value(rod.phasors, phase) - velocity)
    return found - float(friction.force(speeds).mean())


def correct_stribeck(
    measurements: Sequence[StepMeasurement],
    steps: SlidingSteps,
    fit: FrictionFit,
    bootstrap: Bootstrap,
    mass: float,
    frequency: float,
) -> FrictionFit:
    """
    Return the fit of the law with a Stribeck part, corrected for the low-pass.

    Parameters
    ----------
    measurements : sequence of StepMeasurement
        The steps that were fitted.
    steps : SlidingSteps
        Their speeds and forces.
    fit : FrictionFit
        The fit to those.
    bootstrap : Bootstrap
        How intervals are found.
    mass, frequency : float
        Of the slider (kg), of the drive (Hz).

    """

    def follow(law: FrictionLaw) -> FrictionFit:
        single = replace(bootstrap, draws=2)
        for count in range(_ROUNDS):
            errors = [estimation_error(one, law, mass, frequency) for one in measurements]
            corrected = SlidingSteps(steps.speeds, steps.forces - np.array(errors))
            resampling = bootstrap if count == _ROUNDS - 1 else single
            found = fit_law(STRIBECK, corrected, resampling)
            law = found.friction
        return found

    first = fit.friction
    assert isinstance(first, StribeckFriction)
    found = []
    for start in (first, _rival(first)):
        # what cannot be solved, or is no law any more, is no rival
        with suppress(SolverError, BadInputError):
            found.append(follow(start))
    if not found:
        return replace(fit, remark="not corrected for the low-pass: the law cannot be solved")
    best, *others = sorted(found, key=lambda one: one.information)
    is_tie = bool(others) and others[0].information <= best.information + _TIE
    return _united(best, others[0]) if is_tie else best


def _rival(law: StribeckFriction) -> StribeckFriction:
    """Return a law whose excess decays at another speed, with the same area under it."""
    own = law.decay_velocity
    decay = next(one for one in _RIVAL_DECAYS if abs(math.log(one / own)) > 0.5 * math.log(2.0))
    excess = (law.static_force - law.sliding_force) * own / decay
    return law.replace(decay_velocity=decay, static_force=law.sliding_force + excess)


def _united(best: FrictionFit, other: FrictionFit) -> FrictionFit:
    """Return the better fit with intervals that hold those of both."""
    estimates = {
        name: Estimate(
            one.value,
            min(one.low, other.estimates[name].low),
            max(one.high, other.estimates[name].high),
        )
        for name, one in best.estimates.items()
    }
    decays = [fit.estimates["decay_velocity"].value for fit in (best, other)]
    remark = best.remark
    if abs(math.log(decays[0] / decays[1])) > math.log(_SAME_DECAY):
        remark = (
            f"the excess may decay at {1e3 * decays[0]:.2g} or at {1e3 * decays[1]:.2g} mm/s: both "
            "fit alike"
        )
    return replace(best, estimates=estimates, remark=remark)

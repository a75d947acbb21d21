"""
Does the slider stick, slide, or both: told from what was measured, step by step.

Sticking
    Rod and slider move alike. Two heads never agree quite, so that "alike" means the same
    ratio of their first harmonics as in the other steps that stick, and no third harmonic that
    the rod has not.
Sliding all the time
    Where the relative velocity changes sign, the rod's acceleration exceeds the one that friction
    gives the slider (`StepMeasurement.crossing_margin`): it cannot keep up, and slides on. Nor
    does a distorted rod motion come back to the slider without clearly overtaking it.
Both
    Anything between.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

from imotor_ros.core.identification.steps import HeadComparison, StepMeasurement

STICKS = "sticks"
BOTH = "both"
SLIDES = "slides"

# A relative motion below this share of the rod's is not told from sticking, however low the
# noise; and how many standard deviations count as more than noise.
_LEAST_SHARE = 2e-3
_SIGNIFICANT = 4.0

# Half a jump is known to some 3 % on the paper's stand.
_CLEAR_MARGIN = 1.1
_CLEAR_APPROACH = 2.0


@dataclass(frozen=True)
class Agreement:
    """
    How the two heads see a slider that sticks.

    Attributes
    ----------
    ratio : complex
        First harmonic of the slider's velocity over that of the rod's; 1 for perfect heads.
    uncertainty : float
        Its standard deviation by noise.
    steps : int
        Number of steps it rests on; 0 if none sticks, and the ratio is taken as 1.

    """

    ratio: complex
    uncertainty: float
    steps: int


def find_agreement(measurements: Sequence[HeadComparison]) -> Agreement:
    """Return what the steps that stick have in common."""
    chosen = [one for one in measurements if one.excess_harmonic <= stick_tolerance(one)]
    while chosen:
        weights = [one.phase_noise**-2 for one in chosen]
        ratios = [_ratio(one) for one in chosen]
        mean = sum(w * r for w, r in zip(weights, ratios, strict=True)) / sum(weights)
        agreement = Agreement(mean, sum(weights) ** -0.5, len(chosen))
        worst = max(chosen, key=lambda one: _distance(one, agreement) / stick_tolerance(one))
        if _distance(worst, agreement) <= stick_tolerance(worst):
            return agreement
        # a step that slides moves the mean: it is left out, and all others are judged again
        chosen.remove(worst)
    return Agreement(1.0 + 0.0j, 0.0, 0)


def classify(measurement: StepMeasurement, agreement: Agreement) -> str:
    """Return whether the slider "sticks", "slides" all the time, or does "both"."""
    limit = stick_tolerance(measurement)
    if measurement.excess_harmonic <= limit and _distance(measurement, agreement) <= limit:
        return STICKS
    slides_on = measurement.crossing_margin >= _CLEAR_MARGIN
    return SLIDES if slides_on and measurement.closest_approach >= _CLEAR_APPROACH else BOTH


def _ratio(measurement: HeadComparison) -> complex:
    return cmath.rect(measurement.amplitude_ratio, -measurement.phase)


def _distance(measurement: HeadComparison, agreement: Agreement) -> float:
    """Return the relative motion of rod and slider, over the motion (first harmonics)."""
    return abs(_ratio(measurement) / agreement.ratio - 1.0)


def stick_tolerance(measurement: HeadComparison) -> float:
    """Return the relative motion, as a share of the rod's, that is not told from sticking."""
    return math.hypot(_LEAST_SHARE, _SIGNIFICANT * measurement.phase_noise)

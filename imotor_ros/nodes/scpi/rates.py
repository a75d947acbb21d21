"""Which sample rate an oscilloscope takes for a run, and what reading between its samples costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imotor_ros.core.alignment import AFTER, BEFORE, POINTS
from imotor_ros.errors import BadInputError

MARGIN = max(AFTER, BEFORE) + 8
"""Samples taken before and after a run: what the interpolation needs, and the trigger's jitter."""


@dataclass(frozen=True)
class RatePlan:
    """
    How an oscilloscope samples a run.

    Attributes
    ----------
    rate : float
        Its samples per second (Hz).
    before, points : int
        Samples in front of the trigger, and samples of the whole record.
    error_bound : float
        Largest error of a sine of the highest frequency read between samples, over its amplitude.

    """

    rate: float
    before: int
    points: int
    error_bound: float


def interpolation_error(frequency: float, rate: float) -> float:
    """
    Return the largest relative error of a sine read between samples.

    Parameters
    ----------
    frequency : float
        Frequency of the sine (Hz).
    rate : float
        Samples per second (Hz).

    Notes
    -----
    The interpolation is that of `core.alignment`, exact at the samples and worst halfway
    between them, where this is the error itself; at half the sample rate it is 1.

    Examples
    --------
    >>> interpolation_error(18.5e3, 1e6) < 1e-14
    True
    >>> 1e-5 < interpolation_error(200e3, 1e6) < 5e-5
    True

    """
    turns = frequency / rate
    if turns >= 0.5:
        return 1.0
    place = np.arange(POINTS) - BEFORE - 0.5
    weights = [
        math.prod(-other / (one - other) for other in place if other != one) for one in place
    ]
    return abs(1.0 - float(np.dot(weights, np.cos(2.0 * math.pi * turns * place))))


def plan_rate(
    *,
    length: int,
    sample_rate: float,
    delay: float,
    rates: Sequence[float],
    memory: int,
    highest_frequency: float,
    tolerance: float,
    where: str,
) -> RatePlan:
    """
    Return how an oscilloscope samples a run.

    It takes the rate of the run if it has it, else the lowest one above, else the highest one
    below, as far as its memory lasts; and refuses if samples between its own would be wrong.

    Parameters
    ----------
    length : int
        Samples of the run.
    sample_rate : float
        Samples per second of the run (Hz).
    delay : float
        Time from the trigger to sample 0 of the run (s).
    rates : sequence of float
        Rates that the oscilloscope has (Hz).
    memory : int
        Samples that it holds for each input.
    highest_frequency : float
        Highest frequency that has to be right (Hz).
    tolerance : float
        Largest relative error of a sine of that frequency.
    where : str
        Name of the oscilloscope, for errors.

    Raises
    ------
    BadInputError
        If no rate does.

    """
    plans = [_plan(rate, length / sample_rate, delay, highest_frequency) for rate in rates]
    fitting = [plan for plan in plans if plan.points <= memory]
    if not fitting:
        least = min(plan.points for plan in plans)
        raise BadInputError(
            f"the run of {length} samples ({length / sample_rate:g} s) does not fit its memory",
            where=f"{where}: memory", value=memory,
            bound=f">= {least} samples, at its lowest rate of {min(rates):g} Hz",
        )  # fmt: skip
    above = [plan for plan in fitting if plan.rate >= sample_rate]
    below = [plan for plan in fitting if plan.rate < sample_rate]
    chosen = min(above, key=_rate) if above else max(below, key=_rate)
    if chosen.error_bound > tolerance:
        raise BadInputError(
            f"a run of {length / sample_rate:g} s leaves a rate of {chosen.rate:g} Hz for the "
            f"memory of {memory} samples; {highest_frequency:g} Hz read between them is wrong by",
            where=f"{where}: sample_rates", value=float(f"{chosen.error_bound:.2g}"),
            bound=f"<= {tolerance:g}",
        )  # fmt: skip
    return chosen


def _rate(plan: RatePlan) -> float:
    return plan.rate


def _plan(rate: float, duration: float, delay: float, highest_frequency: float) -> RatePlan:
    before = MARGIN + max(0, math.ceil(-delay * rate))
    after = MARGIN + math.ceil((duration + max(delay, 0.0)) * rate)
    error = interpolation_error(highest_frequency, rate)
    return RatePlan(rate, before, before + after, error)

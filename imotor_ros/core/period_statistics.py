"""How sure the mean over periods is: scatter of values that come one per drive period."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MEDIAN_TO_DEVIATION = 1.4826
"""From the median of absolute values to the standard deviation of a normal distribution."""

_NEIGHBOURS = 5
_SPIKE = 8.0

SIGNIFICANT = 3.0
"""Multiples of its standard uncertainty from which on a difference counts as one."""


def student_factor(freedom: float) -> float:
    """
    Return by how much a standard error grows so that twice it covers 95.45 %.

    Student's t at the two-sided 95.45 % point over 2, for `freedom` degrees of freedom (>= 1),
    by the Cornish-Fisher expansion in 1 / freedom; exact to 2 % from 2 degrees on.
    """
    z, v = 2.0, max(freedom, 1.0)
    terms = (
        z,
        (z**3 + z) / (4.0 * v),
        (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / (96.0 * v**2),
        (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / (384.0 * v**3),
    )
    return sum(terms) / z


def standard_error(values: Array) -> float:
    """
    Return the standard error of the mean of successive values, which may be correlated.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Period means, or any value per period, in order.

    Returns
    -------
    float
        In the unit of the values; infinite for fewer than two of them.

    Notes
    -----
    The autocorrelations are added up to the first that is not positive, at most over a quarter
    of the values; they make n values count as fewer. What few values leave open widens the
    result by `student_factor`.

    """
    n = values.size
    if n < 2:
        return math.inf
    rest = values - np.mean(values)
    variance = float(np.mean(rest * rest))
    if variance == 0.0:
        return 0.0
    factor = 1.0
    for lag in range(1, min(n // 4, 100) + 1):
        correlation = float(np.sum(rest[lag:] * rest[:-lag])) / (n * variance)
        if correlation <= 0.0:
            break
        factor += 2.0 * correlation
    effective = max(n / factor, 2.0)
    return math.sqrt(variance / (effective - 1.0)) * student_factor(effective - 1.0)


def noise_of(values: Array) -> float:
    """
    Return the standard deviation of single values about a slow course.

    From the median of the absolute differences of neighbours: neither a trend nor a few
    outliers matter.
    """
    if values.size < 2:
        return 0.0
    differences = np.abs(np.diff(values))
    return float(np.median(differences)) * MEDIAN_TO_DEVIATION / math.sqrt(2.0)


def without_spikes(values: Array) -> Array:
    """
    Return values with those that stand far out of their neighbourhood replaced by its median.

    The neighbourhood are five values; far is eight standard deviations of the noise.
    """
    if values.size < _NEIGHBOURS:
        return values
    half = _NEIGHBOURS // 2
    windows = np.lib.stride_tricks.sliding_window_view(values, _NEIGHBOURS)
    medians = values.copy()
    medians[half:-half] = np.median(windows, axis=1)
    is_spike = np.abs(values - medians) > _SPIKE * noise_of(values)
    return np.where(is_spike, medians, values)

"""
Compiled search of the exponential regression over the drive periods of a solution.

The means of a solution's periods count alike and are equally spaced, and from some period on they
are the same number. So exp(-t / tau) is a geometric sequence, whose sums are known, and only the
periods before that need be gone through.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit("float64(float64, float64)", cache=True, error_model="numpy")
def _geometric(rate: float, count: float) -> float:
    """Return the sum of exp(-rate j) for j from 0 to count - 1."""
    return math.expm1(-rate * count) / math.expm1(-rate)


@njit("UniTuple(float64, 3)(float64, float64[::1], int64)", cache=True, error_model="numpy")
def project(rate: float, above: Array, count: int) -> tuple[float, float, float]:
    """
    Return cost, asymptote and amplitude for one time constant.

    Parameters
    ----------
    rate : float
        Step over time constant.
    above : ndarray, shape (m,)
        The values before they stay the same, as differences from what they are then.
    count : int
        Number of all values.

    Returns
    -------
    tuple of float
        Sum of the squared residuals, asymptote (also as a difference), amplitude at the first.

    """
    ratio, m = math.exp(-rate), above.size
    mean_e = _geometric(rate, count) / count
    product, mean_y, e = 0.0, 0.0, 1.0
    for j in range(m):
        mean_y += above[j]
        product += above[j] * (e - mean_e)
        e *= ratio
    mean_y /= count
    spread = _geometric(2.0 * rate, count) - count * mean_e * mean_e
    amplitude = product / spread if spread > 0.0 else 0.0
    asymptote = mean_y - amplitude * mean_e
    cost, e = 0.0, 1.0
    for j in range(m):
        rest = above[j] - asymptote - amplitude * e
        cost += rest * rest
        e *= ratio
    if count > m:
        tail = amplitude * math.exp(-rate * m)
        cost += (count - m) * asymptote * asymptote
        cost += 2.0 * asymptote * tail * _geometric(rate, count - m)
        cost += tail * tail * _geometric(2.0 * rate, count - m)
    return cost, asymptote, amplitude


@njit("Tuple((float64, boolean))(float64[::1], float64[::1], int64)", cache=True,
      error_model="numpy")  # fmt: skip
def search(grid: Array, above: Array, count: int) -> tuple[float, bool]:
    """Return step over time constant of the best fit, and whether it is at an end of the grid."""
    best, least = 0, math.inf
    for i in range(grid.size):
        cost = project(grid[i], above, count)[0]
        if cost < least:
            best, least = i, cost
    # golden section over the logarithm
    share = (math.sqrt(5.0) - 1.0) / 2.0
    a, b = math.log(grid[max(best - 1, 0)]), math.log(grid[min(best + 1, grid.size - 1)])
    c, d = b - share * (b - a), a + share * (b - a)
    cost_c = project(math.exp(c), above, count)[0]
    cost_d = project(math.exp(d), above, count)[0]
    while abs(b - a) > 1e-8:
        if cost_c < cost_d:
            b, d, cost_d = d, c, cost_c
            c = b - share * (b - a)
            cost_c = project(math.exp(c), above, count)[0]
        else:
            a, c, cost_c = c, d, cost_d
            d = a + share * (b - a)
            cost_d = project(math.exp(d), above, count)[0]
    return math.exp(0.5 * (a + b)), best in (0, grid.size - 1)


@njit("float64[:, ::1](float64, float64, int64)", cache=True, error_model="numpy")
def normal_matrix(rate: float, amplitude: float, count: int) -> Array:
    """
    Return the sums of products of the derivatives by asymptote, time constant and amplitude.

    Time in steps, the first value half a step after 0; the amplitude is that at time 0.
    """
    sums = np.zeros((3, 3))
    row = np.ones(3)
    ratio, e, t = math.exp(-rate), math.exp(-0.5 * rate), 0.5
    for _ in range(count):
        row[1], row[2] = amplitude * e * t * rate * rate, e
        for i in range(3):
            for k in range(3):
                sums[i, k] += row[i] * row[k]
        e *= ratio
        t += 1.0
    return sums

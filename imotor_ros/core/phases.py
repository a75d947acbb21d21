"""Phases of the period at which the rod's acceleration has a given value."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]


def trigonometric_value(coefficients: Spectrum, theta: ArrayLike) -> Array:
    """Return Re sum of c_k exp(i k theta), k = 1 ... n, at the phases (rad), shape as `theta`."""
    phases = np.asarray(theta, dtype=np.float64)
    return np.asarray(_values(coefficients, phases.ravel()).reshape(phases.shape))


def monotone_nodes(coefficients: Spectrum) -> Array:
    """
    Return phases in [0, 2 pi] between which a trigonometric polynomial is monotone.

    Parameters
    ----------
    coefficients : ndarray of complex, shape (n,)
        The polynomial is p(theta) = Re sum of c_k exp(i k theta).

    Notes
    -----
    Between its extremes p is monotone, and between those of its derivative so is the derivative:
    each bracket holds one root at most. The chain begins at the fourth derivative with a grid
    of 32 points per shortest wave. What a grid could still miss there, two extremes within 1/32
    of a wave, changes p by less than 1e-7 of its amplitude.

    """
    n = coefficients.size
    nodes = 2.0 * np.pi * np.arange(32 * n + 1) / (32 * n)
    ik = 1j * np.arange(1, n + 1)
    for order in (4, 3, 2, 1):
        nodes = np.union1d(nodes, _roots(coefficients * ik**order, 0.0, nodes))
    return nodes


def level_phases(
    coefficients: Spectrum, level: float, nodes: Array
) -> tuple[Array, NDArray[np.int64]]:
    """
    Return where a trigonometric polynomial crosses a level, and on which side it is in between.

    Parameters
    ----------
    coefficients : ndarray of complex, shape (n,)
        The polynomial is p(theta) = Re sum of c_k exp(i k theta).
    level : float
        The level.
    nodes : ndarray
        From `monotone_nodes`.

    Returns
    -------
    phases : ndarray, shape (m + 2,)
        0, the crossings in (0, 2 pi) rising, and 2 pi.
    sides : ndarray of int, shape (m + 1,)
        +1 where p is above the level between two of the phases, else -1.

    """
    roots = _roots(coefficients, level, nodes)
    roots = roots[(roots > 0.0) & (roots < 2.0 * np.pi)]
    phases = np.concatenate([[0.0], roots, [2.0 * np.pi]])
    middle = 0.5 * (phases[1:] + phases[:-1])
    sides = np.where(trigonometric_value(coefficients, middle) > level, 1, -1)
    # Two crossings closer than rounding leave no room for the other side between them.
    is_change = np.concatenate([[True], sides[1:] != sides[:-1], [True]])
    return phases[is_change], sides[is_change[:-1]].astype(np.int64)


@njit(cache=True, error_model="numpy")
def _value_and_slope(coefficients: Spectrum, theta: float) -> tuple[float, float]:
    """Return the polynomial and its derivative at one phase."""
    turn = complex(math.cos(theta), math.sin(theta))
    power, value, slope = turn, 0.0, 0.0
    for i in range(coefficients.size):
        term = coefficients[i] * power
        value += term.real
        slope -= (i + 1) * term.imag
        power *= turn
    return value, slope


@njit(cache=True, error_model="numpy")
def _values(coefficients: Spectrum, theta: Array) -> Array:
    values = np.empty(theta.size)
    for i in range(theta.size):
        values[i] = _value_and_slope(coefficients, theta[i])[0]
    return values


@njit(cache=True, error_model="numpy")
def _roots(coefficients: Spectrum, level: float, nodes: Array) -> Array:
    """Return one root in each interval between nodes at whose ends p has different signs."""
    roots, count = np.empty(nodes.size), 0
    after = _value_and_slope(coefficients, nodes[0])[0] > level
    for i in range(nodes.size - 1):
        before = after
        after = _value_and_slope(coefficients, nodes[i + 1])[0] > level
        if before == after:
            continue
        low, high = nodes[i], nodes[i + 1]
        theta = 0.5 * (low + high)
        for _ in range(100):
            value, slope = _value_and_slope(coefficients, theta)
            if (value > level) == before:
                low = theta
            else:
                high = theta
            following = theta - (value - level) / slope
            if not (low <= following <= high):
                following = 0.5 * (low + high)
            has_settled = abs(following - theta) <= 2e-16 * max(theta, 1.0)
            theta = following
            if has_settled:
                break
        roots[count] = theta
        count += 1
    return roots[:count]

"""Phases of the period at which the rod's acceleration has a given value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def trigonometric_value(coefficients: NDArray[np.complex128], theta: Array) -> Array:
    """Return Re sum of c_k exp(i k theta), k = 1 ... n, at the phases (rad)."""
    k = np.arange(1, coefficients.size + 1)
    return np.asarray((np.exp(1j * np.multiply.outer(theta, k)) @ coefficients).real)


def monotone_nodes(coefficients: NDArray[np.complex128]) -> Array:
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
    coefficients: NDArray[np.complex128], level: float, nodes: Array
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


def _roots(coefficients: NDArray[np.complex128], level: float, nodes: Array) -> Array:
    """Return one root in each interval between nodes at whose ends p has different signs."""
    values = trigonometric_value(coefficients, nodes) - level
    index = np.flatnonzero((values[1:] > 0.0) != (values[:-1] > 0.0))
    low, high = nodes[index], nodes[index + 1]
    sign_low = np.where(values[index] > 0.0, 1.0, -1.0)
    rates = coefficients * 1j * np.arange(1, coefficients.size + 1)
    theta = 0.5 * (low + high)
    for _ in range(80):
        if not theta.size:
            break
        value = trigonometric_value(coefficients, theta) - level
        on_low_side = np.where(value > 0.0, 1.0, -1.0) == sign_low
        low, high = np.where(on_low_side, theta, low), np.where(on_low_side, high, theta)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = theta - value / trigonometric_value(rates, theta)
        is_inside = (newton >= low) & (newton <= high)
        following = np.where(is_inside, newton, 0.5 * (low + high))
        has_settled = np.abs(following - theta) <= 4e-16 * np.maximum(theta, 1.0)
        theta = following
        if has_settled.all():
            break
    return theta

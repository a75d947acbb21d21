"""
First roots of polynomials on an interval, none missed: compiled code for the event search.

A polynomial is an array of its coefficients, lowest power first. In the Bernstein basis of an
interval the number of sign changes of the coefficients bounds the number of roots inside, and
differs from it by an even number (Descartes' rule): none means no root, one means exactly one.
Otherwise the interval is halved.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAXIMUM_DEGREE = 30
_DEPTH = 60
_WIDTH = MAXIMUM_DEGREE + 3


def root_workspace() -> Array:
    """
    Return the memory that the functions of this module ask for: scratch rows, then tables.

    For each degree n the table holds, in row i and column j >= i, C(j, i) / C(n, i): the share
    that coefficient i, times length^i, has in Bernstein coefficient j.
    """
    return _first_workspace().copy()


@functools.cache
def _first_workspace() -> Array:
    work = np.zeros((_DEPTH + 2 + (MAXIMUM_DEGREE + 1) ** 2, _WIDTH))
    for n in range(1, MAXIMUM_DEGREE + 1):
        for i in range(n + 1):
            row = work[_DEPTH + 2 + n * (MAXIMUM_DEGREE + 1) + i]
            row[i : n + 1] = [math.comb(j, i) / math.comb(n, i) for j in range(i, n + 1)]
    return work


@njit(cache=True, error_model="numpy")
def evaluate(c: Array, degree: int, t: float) -> float:
    """Return the polynomial at t."""
    # Rising powers: two short chains of operations, where Horner's is one long one.
    total, power = c[0], t
    for i in range(1, degree + 1):
        total += c[i] * power
        power *= t
    return float(total)


@njit(cache=True, error_model="numpy")
def integral(c: Array, shares: Array, degree: int, t: float) -> float:
    """Return the integral of the polynomial from 0 to t; `shares` holds 1, 1/2, 1/3, ..."""
    total, power = 0.0, t
    for i in range(degree + 1):
        total += c[i] * shares[i] * power
        power *= t
    return float(total)


@njit(cache=True, error_model="numpy")
def slope(c: Array, degree: int, t: float) -> float:
    """Return the derivative of the polynomial at t."""
    total = 0.0
    for i in range(degree, 0, -1):
        total = total * t + i * c[i]
    return float(total)


@njit(cache=True, error_model="numpy")
def _polish(
    c: Array, first: int, degree: int, low: float, high: float, sign_low: float, t: float
) -> float:
    """Halley's method inside a bracket that holds exactly one root; halving where it strays."""
    enough = 1e-16 * high
    for _ in range(100):
        value, rate, bend = c[degree], 0.0, 0.0
        for i in range(degree - 1, first - 1, -1):
            bend = bend * t + rate
            rate = rate * t + value
            value = value * t + c[i]
        if value == 0.0:
            return t
        if (value > 0.0) == (sign_low > 0.0):
            low = t
        else:
            high = t
        # `bend` is half the second derivative. Near an extreme the method would creep: halve.
        share = value * bend
        following = low
        if abs(share) < 0.5 * rate * rate:
            following = t - value * rate / (rate * rate - share)
        if not (low < following < high):
            following = 0.5 * (low + high)
            if not (low < following < high):
                return t
        elif abs(following - t) <= enough + 1e-15 * t:
            return float(following)
        t = following
    return t


@njit(cache=True, error_model="numpy")
def _sign_changes(b: Array, degree: int) -> int:
    changes, previous = 0, 0.0
    for i in range(degree + 1):
        if b[i] != 0.0:
            if b[i] * previous < 0.0:
                changes += 1
            previous = 1.0 if b[i] > 0.0 else -1.0
    return changes


@njit(cache=True, error_model="numpy")
def first_root(c: Array, first: int, degree: int, length: float, work: Array) -> float:
    """
    Return the first root in (0, length] of sum of c[first + i] t^i, or infinity.

    Parameters
    ----------
    c : ndarray
        Coefficients; the first `first` of them are left out, which takes out known roots at 0.
    first, degree : int
        Range of the coefficients, inclusive.
    length : float
        End of the interval.
    work : ndarray
        From `root_workspace`.

    """
    bound, power = 0.0, length
    for i in range(first + 1, degree + 1):
        bound += abs(c[i]) * power
        power *= length
    if abs(c[first]) > bound:
        return math.inf
    n = degree - first
    if n == 0:
        return math.inf
    b = work[0]
    for j in range(n + 1):
        b[j] = c[first]
    power, table = length, _DEPTH + 2 + n * (MAXIMUM_DEGREE + 1)
    for i in range(1, n + 1):
        scaled, row = c[first + i] * power, work[table + i]
        power *= length
        for j in range(i, n + 1):
            b[j] += scaled * row[j]
    # Rows of `work` are a stack of intervals, the leftmost on top; the last two entries of a
    # row are its ends.
    work[0, n + 1], work[0, n + 2] = 0.0, 1.0
    top = 0
    while top >= 0:
        b = work[top]
        low, high = b[n + 1], b[n + 2]
        if b[0] == 0.0 and low > 0.0:
            return float(low * length)
        changes = _sign_changes(b, n)
        if changes == 1:
            if b[n] == 0.0:
                changes = 2
            else:
                k = 1
                while (b[k] > 0.0) == (b[0] > 0.0):
                    k += 1
                # Where the control polygon crosses zero is close to the root.
                start = (k - b[k] / (b[k] - b[k - 1])) / n
                start = (low + (high - low) * start) * length
                return float(_polish(c, first, degree, low * length, high * length, -b[n], start))
        if changes == 0:
            if b[n] == 0.0 and high == 1.0 and low < 1.0 and b[0] != 0.0:
                return length
            top -= 1
            continue
        middle = 0.5 * (low + high)
        if top == _DEPTH or high - low < 1e-14:
            return float(middle * length)
        left = work[top + 1]
        for i in range(n + 1):
            left[i] = b[i]
        # de Casteljau: `left` runs down to the point itself, its first entries are kept.
        for k in range(1, n + 1):
            for j in range(n, k - 1, -1):
                left[j] = 0.5 * (left[j] + left[j - 1])
        # After the loops left[j] holds the Bernstein coefficients of the left half, and the
        # right half follows from the same triangle, run from the other end.
        for k in range(1, n + 1):
            for j in range(n - k + 1):
                b[j] = 0.5 * (b[j] + b[j + 1])
        b[n + 1], b[n + 2] = middle, high
        left[n + 1], left[n + 2] = low, middle
        top += 1
    return math.inf


@njit(cache=True, error_model="numpy")
def first_crossing(
    c: Array, first: int, degree: int, sign: int, length: float, work: Array
) -> float:
    """
    Return where in [0, length] the polynomial first leaves the sign it should have, or infinity.

    Leading coefficients that are exactly zero are known roots at 0; if the first other one has
    the wrong sign, the answer is 0.
    """
    while first < degree and c[first] == 0.0:
        first += 1
    if c[first] * sign < 0.0:
        return 0.0
    return float(first_root(c, first, degree, length, work))

"""
Alignment of channels: samples at times between samples, and the delay of a channel taken out.

The instruments of a stand lag the quantities by different times; at 18.5 kHz, 5 us are 33
degrees. The lag is taken out by reading the samples at later, in general fractional, positions.
Between samples the signal is the Lagrange polynomial through the 16 nearest ones. For a
harmonic signal its error relative to the amplitude is largest halfway between samples, where it
is (f / f_s)^16 times 1.8e7 to leading order. At 1 MS/s:

=========  =======
18.5 kHz   below 1e-14
100 kHz    below 2e-9
200 kHz    below 5e-5
250 kHz    below 2e-3
=========  =======

No motor signal comes near the last two; they say how the noise is passed on.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.samples import checked_samples
from imotor_ros.errors import BadInputError

Samples = NDArray[np.float64]

POINTS = 16
"""Number of samples the interpolating polynomial goes through."""

BEFORE = POINTS // 2 - 1
"""Samples needed before the whole part of a position."""

AFTER = POINTS // 2
"""Samples needed after the whole part of a position."""

# Barycentric weights of equally spaced nodes: binomial coefficients of alternating sign.
_WEIGHTS = np.array([(-1.0) ** k * math.comb(POINTS - 1, k) for k in range(POINTS)])


@njit(
    types.void(types.float64[::1], types.float64, types.float64, types.int64, types.float64[::1]),
    cache=True,
    error_model="numpy",
)
def read_grid(samples: Samples, start: float, step: float, first: int, values: Samples) -> None:
    """
    Read samples at equally spaced fractional positions (kernel; nothing is checked).

    Parameters
    ----------
    samples : ndarray, shape (n,)
        The samples.
    start, step : float
        Position 0, and distance of positions (samples).
    first : int
        Number of the first position wanted.
    values : ndarray, shape (m,)
        Receives the values at start + i step, i = first ... first + m - 1. Each of these
        positions p must have `BEFORE` samples before and `AFTER` samples after floor(p).

    """
    for i in range(values.size):
        position = start + (first + i) * step
        whole = math.floor(position)
        fraction = position - whole
        if fraction == 0.0:
            values[i] = samples[whole]
            continue
        above = 0.0
        below = 0.0
        for k in range(POINTS):
            weight = _WEIGHTS[k] / (fraction + (BEFORE - k))
            above += weight * samples[whole - BEFORE + k]
            below += weight
        values[i] = above / below


def interpolate(samples: ArrayLike, start: float, step: float, count: int) -> Samples:
    """
    Return the signal at equally spaced fractional positions.

    Parameters
    ----------
    samples : array_like, shape (n,)
        Samples of a signal, those at positions 0 ... n - 1.
    start : float
        First position (samples).
    step : float
        Distance of positions (samples), > 0.
    count : int
        Number of positions.

    Returns
    -------
    ndarray, shape (count,)
        Values, in the unit of the samples. A position less than `BEFORE` samples from the start
        or `AFTER` samples from the end has too few neighbours: NaN.

    Raises
    ------
    BadInputError
        If the samples are not finite or not one-dimensional, or the step is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> samples = np.sin(0.3 * np.arange(40))
    >>> value = interpolate(samples, 20.25, 1.0, 1)[0]
    >>> bool(abs(value - np.sin(0.3 * 20.25)) < 1e-12)
    True

    """
    signal = checked_samples(samples, where="samples")
    if not (math.isfinite(start) and math.isfinite(step) and step > 0.0):
        raise BadInputError(
            "is out of bounds", where="start, step", value=(start, step), bound="step > 0"
        )
    values = np.full(count, np.nan)
    positions = start + np.arange(count) * step
    whole = np.floor(positions)
    has_support = (whole >= BEFORE) & (whole + AFTER < signal.size)
    inside = np.flatnonzero(has_support)
    if inside.size:
        first, end = int(inside[0]), int(inside[-1]) + 1
        read_grid(signal, start, step, first, values[first:end])
    return values


def compensate_delay(samples: ArrayLike, delay: float, sample_rate: float) -> Samples:
    """
    Return samples with the delay of their channel taken out.

    Parameters
    ----------
    samples : array_like, shape (n,)
        Samples as the instrument gives them; sample i shows the quantity at i / rate - delay.
    delay : float
        Delay of the channel (s), see `ChannelDescription`.
    sample_rate : float
        Samples per second (Hz).

    Returns
    -------
    ndarray, shape (n,)
        The quantity at the times i / rate; NaN at the ends, where the stream does not reach far
        enough for the interpolation.

    """
    count = np.size(samples)
    return interpolate(samples, delay * sample_rate, 1.0, count)

"""Checks that every stage which processes a stream makes on what it is given."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.errors import BadInputError

Samples = NDArray[np.float64]


def checked_samples(samples: ArrayLike, *, where: str, first_index: int = 0) -> Samples:
    """
    Return samples as a contiguous array of finite numbers.

    Parameters
    ----------
    samples : array_like, shape (n,)
        A block of a stream; n may be 0.
    where : str
        Name of the stream, for errors.
    first_index : int
        Index in the stream of the first sample, for errors.

    Raises
    ------
    BadInputError
        If `samples` is not one-dimensional, or holds NaN or infinity; the error names the
        index in the stream of the first such sample.

    """
    array = np.ascontiguousarray(samples, dtype=np.float64)
    if np.ndim(samples) != 1:
        raise BadInputError(
            "has the wrong shape", where=where, value=np.shape(samples), bound="(n,)"
        )
    is_finite = np.isfinite(array)
    if not is_finite.all():
        bad = int(np.argmin(is_finite))
        raise BadInputError(
            "is not finite",
            where=f"{where}, sample {first_index + bad}",
            value=float(array[bad]),
            bound="a finite number",
        )
    return array


def checked_sample_rate(sample_rate: float) -> float:
    """
    Return the sample rate (Hz) as a float.

    Raises
    ------
    BadInputError
        If it is not a finite number above zero.

    """
    if not (math.isfinite(sample_rate) and sample_rate > 0.0):
        raise BadInputError(
            "is out of bounds", where="sample_rate", value=sample_rate, bound="> 0 Hz"
        )
    return float(sample_rate)


def checked_bandwidth(frequency: float, sample_rate: float, *, where: str) -> float:
    """
    Return a frequency (Hz) that samples at `sample_rate` (Hz) can show.

    Raises
    ------
    BadInputError
        If it is above half the sample rate.

    """
    if frequency > 0.5 * sample_rate:
        raise BadInputError(
            "is above half the sample rate",
            where=where,
            value=frequency,
            bound=f"<= {0.5 * sample_rate:g} Hz",
        )
    return frequency

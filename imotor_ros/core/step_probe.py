"""Whether the steps of a channel's samples are those of its digitiser: a wrong unit shows there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]

PROBED = 20_000
"""Samples that are looked at."""

_FEWEST = 1_000
"""Changes from sample to sample without which nothing can be said."""

_FACTOR = 10.0
"""A step may differ from the declared one by so much: units differ by more."""


class StepProbe:
    """
    Looks at the steps of some samples of a channel.

    Noise and slope make changes of few steps and of many; the smallest are one step. A channel
    without declared resolution is not looked at.

    Parameters
    ----------
    resolution : float
        Smallest step (unit of the channel), as declared; 0 if unknown.
    span : tuple of int
        First sample that is looked at, and the one after the last.

    """

    def __init__(self, resolution: float, span: tuple[int, int]) -> None:
        self._resolution = resolution
        self._first, self._end = span if resolution > 0.0 else (0, 0)
        self._samples: Samples = np.empty(0)
        self._defect: str | None = None

    def add(self, first: int, block: Samples) -> None:
        """Take the samples from `first` on, which follow those before."""
        begin, end = max(first, self._first), min(first + block.size, self._end)
        if begin < end:
            part = block[begin - first : end - first]
            self._samples = np.concatenate([self._samples, part])

    def defect(self, name: str, unit: str, reached: int) -> str:
        """Return what contradicts the resolution; nothing before all samples have come."""
        if self._end == 0 or reached < self._end or self._samples.size < self._end - self._first:
            return ""
        if self._defect is None:
            self._defect = self._contradiction(name, unit)
        return self._defect

    def _contradiction(self, name: str, unit: str) -> str:
        changes = np.abs(np.diff(self._samples))
        changes = changes[changes > 0.0]
        if changes.size < _FEWEST:
            return ""
        # a rounding error in a few is no step; but the smallest of many changes is one or two
        least, few = float(np.min(changes)), float(np.percentile(changes, 1.0))
        if least > _FACTOR * self._resolution:
            step = least
        elif few < self._resolution / _FACTOR:
            step = few
        else:
            return ""
        return (
            f"the samples of {name} change by steps of {step:.2g} {unit}, but the channel declares "
            f"{self._resolution:.2g} {unit}: wrong unit or factor"
        )

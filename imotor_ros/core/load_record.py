"""The load force of a run: offset, preload and slow decay sorted out."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.channel import LOAD_FORCE
from imotor_ros.core.contact import Baseline, find_baseline
from imotor_ros.core.period_statistics import SIGNIFICANT, standard_error
from imotor_ros.core.run_view import RunView

Array = NDArray[np.float64]

# A high-pass may take away this share of a constant force over the run, and no more.
_MOST_DECAY = 0.5

# How well the time constant of a charge amplifier is known (relative).
_DECAY_UNCERTAINTY = 0.2

# Force before the drive, over the uncertainty of the offset, from which on it is a load.
_PRELOAD = 5.0


class LoadRecord:
    """
    The period means of the load force.

    Parameters
    ----------
    view : RunView
        The run.

    """

    def __init__(self, view: RunView) -> None:
        self._view = view

    @cached_property
    def reason(self) -> str:
        """Why the force cannot be used; empty if it can."""
        view = self._view
        reason = view.missing(LOAD_FORCE) or self.baseline.reason
        if reason:
            return reason
        if self._decay_rate * view.until / view.program.sample_rate > _MOST_DECAY:
            return (
                f"a constant force decays during the run: {LOAD_FORCE} has a lower cut-off "
                f"frequency of {view.channel(LOAD_FORCE).high_pass_frequency:.3g} Hz"
            )
        return ""

    @cached_property
    def baseline(self) -> Baseline:
        """The force before the drive starts."""
        return find_baseline(self._view.start(LOAD_FORCE), self._view.grid.period)

    @cached_property
    def changes(self) -> Array:
        """
        Mean force of each period, what was there before the drive taken off; shape (rows,).

        Decay is made up for: a high-pass of time constant tau turns F into y, with
        F = y + integral of y dt / tau.
        """
        return self._without_decay(self._view.means(LOAD_FORCE) - self.baseline.offset)

    @cached_property
    def threshold(self) -> float:
        """Smallest change (N) that counts as contact."""
        channel, parameters = self._view.channel(LOAD_FORCE), self._view.parameters
        largest = float(np.max(np.abs(self.changes), initial=0.0))
        scale = channel.range if 0.0 < channel.range < math.inf else largest
        return max(
            parameters.contact_noise_factor * self.baseline.noise,
            parameters.contact_share * scale,
            3.0 * channel.resolution,
        )

    @cached_property
    def is_preloaded(self) -> bool:
        """Whether the force before the drive is more than the channel's offset can be."""
        doubt = self._view.channel(LOAD_FORCE).offset_uncertainty
        limit = _PRELOAD * math.hypot(doubt, self.baseline.uncertainty)
        return doubt > 0.0 and abs(self.baseline.offset) > limit

    def mean(self, first: int, end: int) -> tuple[float, float]:
        """Return the mean force (N) over periods `first` ... `end` - 1 and its uncertainty (N)."""
        channel, rows = self._view.channel(LOAD_FORCE), slice(first, end)
        values = self.changes[rows]
        shown = self._view.means(LOAD_FORCE)[rows] - self.baseline.offset
        if self.is_preloaded:
            values = values + self._preload[rows]
            shown = shown + self.baseline.offset
            self._view.warn(
                f"{LOAD_FORCE} shows {self.baseline.offset:.3g} N before the drive starts, too "
                "much for an offset: taken as load"
            )
        mean = float(np.mean(values))
        parts = (
            standard_error(values),
            self.baseline.uncertainty,
            channel.offset_uncertainty,
            channel.gain_uncertainty * mean,
            _DECAY_UNCERTAINTY * (mean - float(np.mean(shown))),
        )
        return mean, math.hypot(*parts)

    def drift(self, first: int, end: int) -> float:
        """Return how far the force has drifted in periods without load, if significantly (N)."""
        before = self.changes[first : max(end, first)]
        if before.size < self._view.parameters.minimum_periods:
            return 0.0
        drift = abs(float(np.mean(before)))
        error = math.hypot(standard_error(before), self.baseline.uncertainty)
        return drift if drift > SIGNIFICANT * error else 0.0

    @property
    def _preload(self) -> Array:
        """What was there before the drive, as it would have shown without decay."""
        view, offset = self._view, self.baseline.offset
        before = self._decay_rate * view.grid.origin / view.program.sample_rate * offset
        return before + self._without_decay(np.full(view.rows, offset))

    @property
    def _decay_rate(self) -> float:
        return 2.0 * math.pi * self._view.channel(LOAD_FORCE).high_pass_frequency

    def _without_decay(self, force: Array) -> Array:
        share = self._decay_rate * self._view.period
        return np.asarray(force + share * (np.cumsum(force) - 0.5 * force))

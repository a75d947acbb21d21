"""
Friction laws fitted to the steps in which the slider slides all the time.

In such a step the mean absolute acceleration times the mass is the mean of the sliding force over
the period. For a constant force and for a line that is the law at the mean speed, as equations
(8) and (9) of the paper have it; for a curved law it is not. So every law is
averaged over the speeds that the step really had,

    F_i = force + slope mean(w_i) + excess mean(exp(-(w_i / v_s)^2)),

which is linear in all but v_s. Slope and excess are 0 at least, as the laws want.

Intervals come from a bootstrap over the steps: it needs no assumption on the noise, and widens
where a law does not fit. They hold noise and misfit only; what a wrong calibration does is
another matter, the same in all steps (see `identification.Calibration`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.friction import (
    CoulombFriction,
    FrictionLaw,
    StribeckFriction,
    VelocityDependentFriction,
)
from imotor_ros.core.random_streams import generator

Array = NDArray[np.float64]

COULOMB = "coulomb"
VELOCITY = "velocity"
STRIBECK = "stribeck"

FEWEST_STEPS = 6
"""Steps below which nothing is fitted."""

_DECAY_COUNT = 120
_EXPONENT = 2  # a Gaussian and an exponential decay are not told apart
_LEAST_DECAY = 5e-4
_CLOSE = 2.0  # difference of the criterion below which the simpler law is taken


@dataclass(frozen=True)
class Estimate:
    """
    A number found, with its interval.

    Attributes
    ----------
    value : float
        Best value.
    low, high : float
        Ends of the confidence interval.

    """

    value: float
    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Return whether the interval holds a value."""
        return self.low <= value <= self.high

    def to_mapping(self) -> dict[str, float]:
        """Return it as plain JSON."""
        return {"value": self.value, "low": self.low, "high": self.high}


@dataclass(frozen=True)
class SlidingSteps:
    """
    The points of figure 9 that a law is fitted to.

    Attributes
    ----------
    speeds : ndarray, shape (n, points)
        |v_R - v_S| (m/s) over the period of each step.
    forces : ndarray, shape (n,)
        Mean sliding force (N) of each step.

    """

    speeds: Array
    forces: Array

    @property
    def mean_speeds(self) -> Array:
        """Mean |v_R - v_S| (m/s) of each step, shape (n,)."""
        return np.asarray(self.speeds.mean(axis=1))

    def selected(self, indices: NDArray[np.int64]) -> SlidingSteps:
        """Return some of the steps."""
        return SlidingSteps(self.speeds[indices], self.forces[indices])


@dataclass(frozen=True)
class FrictionFit:
    """
    One law, fitted.

    Attributes
    ----------
    law : str
        "coulomb", "velocity" or "stribeck".
    estimates : mapping of str to Estimate
        Parameters by the names that the law has, and "zero_speed_force".
    residuals : ndarray, shape (n,)
        Measured less fitted force of each step (N).
    information : float
        Bayesian information criterion: the lower, the better the law.
    remark : str
        What is to be known of it; empty if nothing.

    """

    law: str
    estimates: Mapping[str, Estimate]
    residuals: Array
    information: float
    remark: str = ""

    @property
    def scatter(self) -> float:
        """Standard deviation of the residuals (N)."""
        return math.sqrt(float(np.mean(self.residuals**2)))

    @property
    def friction(self) -> FrictionLaw:
        """The law, ready for the models; its break-away force is that at zero speed."""
        values = {name: one.value for name, one in self.estimates.items()}
        force = values["sliding_force"]
        if self.law == COULOMB:
            return CoulombFriction(sliding_force=force)
        if self.law == VELOCITY:
            return VelocityDependentFriction(sliding_force=force, slope=values["slope"])
        return StribeckFriction(
            sliding_force=force,
            static_force=values["static_force"],
            slope=values["slope"],
            decay_velocity=values["decay_velocity"],
            exponent=_EXPONENT,
        )


@dataclass(frozen=True)
class Bootstrap:
    """
    How intervals are found.

    Attributes
    ----------
    draws : int
        Number of resamplings of the steps.
    confidence : float
        Share of the intervals that are to hold the truth.
    seed : int
        Seed of the resampling.

    """

    draws: int = 2000
    confidence: float = 0.95
    seed: int = 1

    def counts(self, steps: int) -> Array:
        """Return how often each step is drawn, shape (draws, steps)."""
        draws = generator(self.seed, "identification/bootstrap")
        share = np.full(steps, 1.0 / steps)
        return draws.multinomial(steps, share, size=self.draws).astype(np.float64)

    def estimate(self, value: float, drawn: Array, freedom: int, steps: int) -> Estimate:
        """
        Return a value with its interval.

        The percentiles of the draws about the value, widened for the parameters that were
        fitted: resampled residuals are too small by sqrt(freedom / steps), and so few steps ask
        for Student's t in place of the normal distribution.
        """
        from scipy.special import ndtri, stdtrit

        tail = 0.5 * (1.0 - self.confidence)
        wider = math.sqrt(steps / freedom) * float(stdtrit(freedom, tail) / ndtri(tail))
        low, high = (float(q) - value for q in np.quantile(drawn, [tail, 1.0 - tail]))
        return Estimate(value, value + wider * low, value + wider * high)


def fit_laws(steps: SlidingSteps, bootstrap: Bootstrap) -> dict[str, FrictionFit]:
    """
    Fit every law.

    Parameters
    ----------
    steps : SlidingSteps
        At least `FEWEST_STEPS`.
    bootstrap : Bootstrap
        How to find intervals.

    Returns
    -------
    dict
        Fits by law: constant, line, and with a Stribeck part.

    """
    return {law: fit_law(law, steps, bootstrap) for law in (COULOMB, VELOCITY, STRIBECK)}


def fit_law(law: str, steps: SlidingSteps, bootstrap: Bootstrap) -> FrictionFit:
    """Fit one law, "coulomb", "velocity" or "stribeck"; see `fit_laws`."""
    counts = bootstrap.counts(steps.forces.size)
    if law == STRIBECK:
        return _fit_stribeck(steps, bootstrap, counts)
    return _fit_straight(law, steps, bootstrap, counts)


def choose(fits: Mapping[str, FrictionFit]) -> FrictionFit:
    """
    Return the simplest fit whose information criterion is within 2 of the lowest.

    A line that falls with the speed is no friction law, and does not count.
    """
    ranked = [fits[law] for law in (COULOMB, VELOCITY, STRIBECK) if law in fits]
    laws = [
        fit for fit in ranked if "slope" not in fit.estimates or fit.estimates["slope"].value >= 0
    ]
    lowest = min(fit.information for fit in laws)
    return next(fit for fit in laws if fit.information <= lowest + _CLOSE)


def _information(residuals: Array, parameters: int) -> float:
    """Return the Bayesian information criterion for residuals of unknown size."""
    n = residuals.size
    mean_square = max(float(np.mean(residuals**2)), 1e-24)
    # the size of the residuals is a parameter too
    return n * math.log(mean_square) + (parameters + 1) * math.log(n)


def _fit_straight(
    law: str, steps: SlidingSteps, bootstrap: Bootstrap, counts: Array
) -> FrictionFit:
    speeds, forces = steps.mean_speeds, steps.forces
    columns = [np.ones_like(speeds)] + ([speeds] if law == VELOCITY else [])
    matrix = np.column_stack(columns)
    found = _solve(matrix, forces, np.ones((1, forces.size)))[0]
    drawn = _solve(matrix, forces, counts)
    names = ("sliding_force", "slope")[: found.size]
    freedom = forces.size - found.size
    estimates = {
        name: bootstrap.estimate(float(found[i]), drawn[:, i], freedom, forces.size)
        for i, name in enumerate(names)
    }
    estimates["zero_speed_force"] = estimates["sliding_force"]
    residuals = forces - matrix @ found
    remark = ""
    if law == VELOCITY and found[1] < 0.0:
        remark = "the force falls with the relative speed: a line is no law for that"
    return FrictionFit(law, estimates, residuals, _information(residuals, found.size), remark)


def _solve(matrix: Array, forces: Array, counts: Array) -> Array:
    """Return least-squares parameters for each row of counts, shape (draws, parameters)."""
    size = matrix.shape[1]
    products = (matrix[:, :, None] * matrix[:, None, :]).reshape(len(matrix), size * size)
    gram = (counts @ products).reshape(-1, size, size)
    right = counts @ (matrix * forces[:, None])
    # a draw may by chance hold one and the same step only
    gram += 1e-12 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(size)
    return np.asarray(np.linalg.solve(gram, right[..., None])[..., 0])


# ---- the law with a Stribeck part -------------------------------------------------------------


@dataclass(frozen=True)
class _StribeckGrid:
    """Decay velocities (m/s), and mean(exp(-(w / v_s)^2)) of every step for each of them."""

    decays: Array
    columns: Array  # shape (decays, steps)


def _grid_for(steps: SlidingSteps) -> _StribeckGrid:
    # an excess that decays slower than that is a bent line
    slowest = max(float(steps.mean_speeds.max()), 4.0 * _LEAST_DECAY)
    decays = np.geomspace(_LEAST_DECAY, slowest, _DECAY_COUNT)
    return _StribeckGrid(decays, np.array([_decayed(steps.speeds, decay) for decay in decays]))


def _decayed(speeds: Array, decay: float) -> Array:
    return np.asarray(np.exp(-((speeds / decay) ** _EXPONENT)).mean(axis=1))


def _fit_stribeck(steps: SlidingSteps, bootstrap: Bootstrap, counts: Array) -> FrictionFit:
    grid = _grid_for(steps)
    found = _best(steps, grid, np.ones((1, steps.forces.size)))[0]
    drawn = _best(steps, grid, counts)
    n, freedom = steps.forces.size, steps.forces.size - 4
    columns = {
        "sliding_force": (found[0], drawn[:, 0]),
        "slope": (found[1], drawn[:, 1]),
        "static_force": (found[0] + found[2], drawn[:, 0] + drawn[:, 2]),
        "decay_velocity": (found[3], drawn[:, 3]),
    }
    estimates = {
        name: _not_below_zero(bootstrap.estimate(float(value), values, max(freedom, 1), n))
        for name, (value, values) in columns.items()
    }
    estimates["zero_speed_force"] = estimates["static_force"]
    decayed = _decayed(steps.speeds, float(found[3]))
    fitted = found[0] + found[1] * steps.mean_speeds + found[2] * decayed
    residuals = steps.forces - fitted
    return FrictionFit(STRIBECK, estimates, residuals, _information(residuals, 4), _remark(found))


def _not_below_zero(estimate: Estimate) -> Estimate:
    return replace(estimate, low=max(estimate.low, 0.0))


def _remark(found: Array) -> str:
    if found[2] <= 0.0:
        return "no excess at low speed is found: the law is a line"
    if found[3] <= 1.01 * _LEAST_DECAY:
        return "the excess decays too fast to be told from its height: only their product counts"
    return ""


def _best(steps: SlidingSteps, grid: _StribeckGrid, counts: Array) -> Array:
    """
    Return force, slope, excess and decay velocity for each row of counts.

    For each decay the three linear parameters follow from one small system; where slope or
    excess would be negative, it is 0 and the others are solved again.
    """
    best = np.full(len(counts), np.inf)
    found = np.zeros((len(counts), 4))
    total = counts @ steps.forces**2
    for decay, column in zip(grid.decays, grid.columns, strict=True):
        matrix = np.column_stack([np.ones_like(column), steps.mean_speeds, column])
        linear, square = _not_negative(matrix, steps.forces, counts, total)
        is_better = square < best * (1.0 - 1e-12)
        best[is_better] = square[is_better]
        found[is_better, :3], found[is_better, 3] = linear[is_better], decay
    return found


def _not_negative(matrix: Array, forces: Array, counts: Array, total: Array) -> tuple[Array, Array]:
    """Return the best parameters with the second and third at 0 or above, and the residual."""
    best = np.full(len(counts), np.inf)
    chosen = np.zeros((len(counts), 3))
    for kept in ((0, 1, 2), (0, 1), (0, 2), (0,)):
        columns = matrix[:, kept]
        part = _solve(columns, forces, counts)
        square = total - np.sum(part * (counts @ (columns * forces[:, None])), axis=1)
        is_valid = (part[:, 0] > 0.0) & np.all(part[:, 1:] >= 0.0, axis=1) & (square < best)
        best[is_valid] = square[is_valid]
        chosen[is_valid] = 0.0
        for place, index in enumerate(kept):
            chosen[is_valid, index] = part[is_valid, place]
    return chosen, best


def mean_difference(first: Array, second: Array, confidence: float = 0.95) -> Estimate:
    """Return the mean of the first values less that of the second, with its interval (Welch)."""
    from scipy.special import stdtrit

    squares = [float(part.var(ddof=1)) / part.size for part in (first, second)]
    total = sum(squares)
    freedom = (
        total**2
        / sum(
            square**2 / (part.size - 1)
            for square, part in zip(squares, (first, second), strict=True)
        )
        if total > 0.0
        else 1.0
    )
    mean = float(first.mean() - second.mean())
    reach = math.sqrt(total) * float(stdtrit(freedom, 0.5 + 0.5 * confidence))
    return Estimate(mean, mean - reach, mean + reach)

"""
Exponential regression of the period-mean velocity, and the start-up time read from it.

Section 6 of the paper: the start-up time t_0.99, after which the motor has 99 % of its steady
velocity, comes from an exponential regression function; where the velocity falls instead, it is
t_1.01. The evaluator and the simulation use the functions of this module alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.regression_kernels import normal_matrix, project, search
from imotor_ros.errors import BadInputError

Array = NDArray[np.float64]

TOLERANCE = 0.01
"""Distance from the steady velocity, relative, that counts as steady: t_0.99 and t_1.01."""

_UNRESOLVED = 2
"""Number of points off the steady value that are too few for an exponential."""


@dataclass(frozen=True)
class ExponentialFit:
    """
    The curve asymptote + amplitude exp(-t / time_constant) through points.

    Attributes
    ----------
    asymptote, time_constant, amplitude : float
        The parameters, in the units of the values and times; NaN without a fit.
    covariance : ndarray, shape (3, 3)
        Covariance of (asymptote, time_constant, amplitude); NaN where it is not determined.
    residual : float
        Root mean square of the residuals.
    reason : str
        Why the curve is not to be trusted; empty if it is.

    """

    asymptote: float
    time_constant: float
    amplitude: float
    covariance: Array
    residual: float
    reason: str = ""

    @property
    def is_valid(self) -> bool:
        """True if all three parameters are determined by the points."""
        return not self.reason

    def value(self, time: ArrayLike) -> Array:
        """Return the curve at the times, shape as `time`."""
        decay = np.exp(-np.asarray(time, dtype=np.float64) / self.time_constant)
        return np.asarray(self.asymptote + self.amplitude * decay)


@dataclass(frozen=True)
class StartUp:
    """
    Start-up time of a run.

    Attributes
    ----------
    value : float
        The time (s) t_0.99 or t_1.01; NaN where there is none.
    uncertainty : float
        Its standard uncertainty (s); NaN where it is not determined.
    is_bound : bool
        True if the first periods were steady already: `value` is an upper bound, the end of the
        first steady period.
    reason : str
        Why there is no value; empty if there is one.
    fit : ExponentialFit
        The regression.

    """

    value: float
    uncertainty: float
    is_bound: bool
    reason: str
    fit: ExponentialFit


def fit_exponential(
    times: ArrayLike, values: ArrayLike, uncertainties: ArrayLike | None = None
) -> ExponentialFit:
    """
    Fit asymptote + amplitude exp(-t / time_constant) by least squares.

    Parameters
    ----------
    times, values : array_like, shape (n,)
        The points, times rising.
    uncertainties : array_like, shape (n,), optional
        Standard uncertainties of the values, > 0. Without them all count alike, and the
        covariance is scaled by the residuals.

    Returns
    -------
    ExponentialFit
        With a reason where the points do not determine the curve.

    Raises
    ------
    BadInputError
        If shapes differ, a number is not finite, or the times do not rise.

    Notes
    -----
    Asymptote and amplitude are linear: for each time constant they are solved for, and what is
    left is a search over one variable, which needs no starting values and cannot stray.

    """
    t, y, weight = _points(times, values, uncertainties)
    if t.size < 4:
        return _no_fit("fewer than four points")
    grid = _grid(float(np.min(np.diff(t))), t[-1] - t[0])
    costs = np.array([_project(tau, t, y, weight)[0] for tau in grid])
    best = int(np.argmin(costs))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    tau = _minimise(low, high, t, y, weight)
    cost, asymptote, start = _project(tau, t, y, weight)
    # From here on the amplitude counts from time 0, whatever the first time is.
    amplitude = start * math.exp(min(t[0] / tau, 700.0))
    covariance = _covariance(t, tau, amplitude, weight)
    if uncertainties is None:
        covariance = covariance * (cost / max(t.size - 3, 1))
    residual = math.sqrt(float(np.mean((asymptote + start * np.exp(-(t - t[0]) / tau) - y) ** 2)))
    return ExponentialFit(
        asymptote, tau, amplitude, covariance, residual,
        _reason(t, tau, asymptote, start, covariance, best in (0, grid.size - 1)),
    )  # fmt: skip


def fit_period_means(means: ArrayLike, period: float) -> ExponentialFit:
    """
    Fit asymptote + amplitude exp(-t / time_constant) to the means of the drive periods since rest.

    The same regression as `fit_exponential` with points of equal weight at (j + 1/2) periods,
    many times faster: it makes use of their spacing, and of a motor that has become steady.

    Parameters
    ----------
    means : array_like, shape (n,)
        Mean of each period.
    period : float
        Drive period (s).

    Raises
    ------
    BadInputError
        If a number is not finite, or the period not positive.

    """
    t, y, _ = _points((np.arange(np.size(means)) + 0.5) * period, means, None)
    if t.size < 4:
        return _no_fit("fewer than four points")
    differs = np.flatnonzero(y != y[-1])
    settled = int(differs[-1]) + 1 if differs.size else 0
    above = y[:settled] - y[-1]
    rate, is_at_edge = search(_rate_grid(t.size), above, t.size)
    cost, difference, start = project(rate, above, t.size)
    asymptote, tau = float(y[-1] + difference), period / rate
    amplitude = start * math.exp(0.5 * rate)
    # derivatives by the time constant are per step
    steps = np.array([1.0, period, 1.0])
    covariance = _inverse(normal_matrix(rate, amplitude, t.size)) * np.outer(steps, steps)
    covariance = covariance * (cost / max(t.size - 3, 1))
    return ExponentialFit(
        asymptote, tau, amplitude, covariance, math.sqrt(cost / t.size),
        _reason(t, tau, asymptote, start, covariance, is_at_edge),
    )  # fmt: skip


def start_up_time(
    period_means: ArrayLike, period: float, uncertainties: ArrayLike | None = None
) -> StartUp:
    """
    Return the start-up time from the mean velocities of the drive periods since rest.

    Parameters
    ----------
    period_means : array_like, shape (n,)
        Mean slider velocity (m/s) of periods 0, 1, ...; that of period j counts at its middle,
        (j + 1/2) periods.
    period : float
        Drive period (s).
    uncertainties : array_like, shape (n,), optional
        Standard uncertainties of the means (m/s).

    Returns
    -------
    StartUp
        The time at which the regression enters 1 % of its asymptote. Where the mean of the
        first period is within 1 % already, or the one after the start is, the points cannot show
        an exponential: the value is the end of that period, and `is_bound` is set.

    Raises
    ------
    BadInputError
        See `fit_exponential`.

    """
    means = np.asarray(period_means, dtype=np.float64)
    if uncertainties is None:
        fit = fit_period_means(means, period)
    else:
        fit = fit_exponential((np.arange(means.size) + 0.5) * period, means, uncertainties)
    steady = float(np.mean(means[-max(means.size // 4, 1) :])) if means.size else math.nan
    if means.size < 4 or steady == 0.0:
        return StartUp(math.nan, math.nan, False, fit.reason or "the motor does not move", fit)
    is_away = np.abs(means - steady) > TOLERANCE * abs(steady)
    first_steady = int(np.flatnonzero(is_away)[-1]) + 1 if is_away.any() else 0
    if first_steady == 0 or (first_steady <= _UNRESOLVED and not fit.is_valid):
        return StartUp((first_steady + 1) * period, math.nan, True, "", fit)
    if not fit.is_valid:
        return StartUp(math.nan, math.nan, False, fit.reason, fit)
    ratio = abs(fit.amplitude) / (TOLERANCE * abs(fit.asymptote))
    time = fit.time_constant * math.log(max(ratio, 1.0))
    a, tau, b = fit.asymptote, fit.time_constant, fit.amplitude
    gradient = np.array([-tau / a, math.log(max(ratio, 1.0)), tau / b])
    variance = float(gradient @ fit.covariance @ gradient)
    return StartUp(time, math.sqrt(variance) if variance >= 0.0 else math.nan, False, "", fit)


def _points(
    times: ArrayLike, values: ArrayLike, uncertainties: ArrayLike | None
) -> tuple[Array, Array, Array]:
    t = np.atleast_1d(np.asarray(times, dtype=np.float64))
    y = np.atleast_1d(np.asarray(values, dtype=np.float64))
    sd = np.ones_like(y) if uncertainties is None else np.asarray(uncertainties, dtype=np.float64)
    if t.ndim != 1 or t.shape != y.shape or sd.shape != y.shape:
        raise BadInputError(
            "have different shapes", where="times, values, uncertainties",
            value=(t.shape, y.shape, sd.shape),
        )  # fmt: skip
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(y)) and np.all(np.isfinite(sd))):
        raise BadInputError("hold a number that is not finite", where="points of the regression")
    if np.any(np.diff(t) <= 0.0) or np.any(sd <= 0.0):
        raise BadInputError("must rise, and uncertainties be positive", where="times")
    return t, y, 1.0 / sd**2


def _grid(step: float, span: float) -> Array:
    """Return the time constants among which the search begins."""
    return np.geomspace(0.05 * step, 30.0 * span, 160)


@lru_cache(maxsize=8)
def _rate_grid(count: int) -> Array:
    """Return step over time constant where the search over `count` equal steps begins."""
    return np.asarray(1.0 / _grid(1.0, count - 1.0))


def _project(tau: float, t: Array, y: Array, weight: Array) -> tuple[float, float, float]:
    """Return cost, asymptote and amplitude (at the first time) for one time constant."""
    basis = np.exp(-(t - t[0]) / tau)
    total = weight.sum()
    mean_e, mean_y = (weight @ basis) / total, (weight @ y) / total
    e, d = basis - mean_e, y - mean_y
    spread = float(weight @ (e * e))
    amplitude = float(weight @ (e * d)) / spread if spread > 0.0 else 0.0
    rest = d - amplitude * e
    return float(weight @ (rest * rest)), float(mean_y - amplitude * mean_e), amplitude


def _minimise(low: float, high: float, t: Array, y: Array, weight: Array) -> float:
    """Golden section search over the logarithm of the time constant."""
    share = (math.sqrt(5.0) - 1.0) / 2.0
    a, b = math.log(low), math.log(high)
    c, d = b - share * (b - a), a + share * (b - a)
    cost_c = _project(math.exp(c), t, y, weight)[0]
    cost_d = _project(math.exp(d), t, y, weight)[0]
    while b - a > 1e-8:
        if cost_c < cost_d:
            b, d, cost_d = d, c, cost_c
            c = b - share * (b - a)
            cost_c = _project(math.exp(c), t, y, weight)[0]
        else:
            a, c, cost_c = c, d, cost_d
            d = a + share * (b - a)
            cost_d = _project(math.exp(d), t, y, weight)[0]
    return math.exp(0.5 * (a + b))


def _covariance(t: Array, tau: float, amplitude: float, weight: Array) -> Array:
    basis = np.exp(-t / tau)
    jacobian = np.stack([np.ones_like(t), amplitude * basis * t / tau**2, basis], axis=1)
    return _inverse(jacobian.T @ (weight[:, None] * jacobian))


def _inverse(normal: Array) -> Array:
    """Return the inverse of a normal matrix, whose rows may differ widely in size."""
    scale = np.sqrt(np.diag(normal))
    if not np.all(scale > 0.0):
        return np.full((3, 3), np.nan)
    try:
        inverse = np.linalg.inv(normal / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        return np.full((3, 3), np.nan)
    return np.asarray(inverse / np.outer(scale, scale))


def _reason(
    t: Array, tau: float, asymptote: float, start: float, covariance: Array, is_at_edge: bool
) -> str:
    if start == 0.0 or asymptote == 0.0 or is_at_edge or not np.all(np.isfinite(covariance)):
        return "the points show no exponential"
    if tau > 0.5 * (t[-1] - t[0]):
        return "the record ends before the steady state"
    if math.sqrt(max(covariance[1, 1], 0.0)) > tau:
        return "the time constant is lost in the noise"
    return ""


def _no_fit(reason: str) -> ExponentialFit:
    nan = math.nan
    return ExponentialFit(nan, nan, nan, np.full((3, 3), np.nan), nan, reason)

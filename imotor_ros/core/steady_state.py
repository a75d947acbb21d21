"""
Steady state of a sequence of period means: where it begins, whether it is one, how sure its mean.

Used for the slider velocity during the free run and for the load force after contact. Only the
measured means are looked at; their noise is estimated from them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.period_statistics import (
    SIGNIFICANT,
    noise_of,
    standard_error,
    student_factor,
)
from imotor_ros.core.regression import TOLERANCE, ExponentialFit, fit_exponential

Array = NDArray[np.float64]

# Periods that enter the regression one by one; later ones are averaged in growing groups.
_SINGLE_PERIODS = 64
_GROUPS_PER_OCTAVE = 24

# What an exponential must gain in chi square over a constant: by chance less than once in 1000.
_SIGNIFICANT_GAIN = 16.0

# A second regression leaves out so much of the beginning (time constants): what it finds else
# tells how far the start-up is from an exponential.
_LEFT_OUT = 0.5
_FEWEST_TO_FIT = 8

# Fewest values whose neighbours' differences tell noise from wandering.
_ENOUGH_TO_TELL_NOISE = 10


@dataclass(frozen=True)
class Settling:
    """
    The exponential through period means, and whether it says more than a constant.

    Attributes
    ----------
    fit : ExponentialFit
        The regression; the covariance is scaled up where the curve does not fit the means.
    is_significant : bool
        True if the exponential is more than noise.
    noise : float
        Standard deviation of single period means.
    late_fit : ExponentialFit or None
        The regression without the beginning; None with too few values for one.

    """

    fit: ExponentialFit
    is_significant: bool
    noise: float
    late_fit: ExponentialFit | None = None

    def remainder(self, time: float) -> float:
        """Return how far the curve is from its asymptote at a time (s)."""
        return abs(self.fit.amplitude) * math.exp(-time / self.fit.time_constant)


def fit_settling(times: Array, values: Array) -> Settling:
    """
    Fit an exponential to period means.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Middles of the periods (s), equally spaced.
    values : ndarray, shape (n,)
        The means.

    """
    noise = noise_of(values[values.size // 2 :])
    starts = _group_starts(values.size)
    counts = np.diff(np.append(starts, values.size))
    t = np.add.reduceat(times, starts) / counts
    y = np.add.reduceat(values, starts) / counts
    floor = 1e-9 * float(np.max(np.abs(values))) + 1e-300
    deviations = max(noise, floor) / np.sqrt(counts)
    fit = fit_exponential(t, y, deviations)
    if not math.isfinite(fit.time_constant):
        return Settling(fit, False, noise)
    weights = 1.0 / deviations**2
    mean = float(np.sum(weights * y) / np.sum(weights))
    flat = float(np.sum(weights * (y - mean) ** 2))
    bent = float(np.sum(weights * (y - fit.asymptote - _decay(fit, t)) ** 2))
    scale = max(1.0, bent / max(t.size - 3, 1))
    is_significant = flat - bent > _SIGNIFICANT_GAIN * scale
    late = int(np.searchsorted(t, t[0] + _LEFT_OUT * fit.time_constant))
    late_fit = None
    if is_significant and t.size - late >= _FEWEST_TO_FIT:
        late_fit = _scaled(fit_exponential(t[late:], y[late:], deviations[late:]), scale)
    return Settling(_scaled(fit, scale), is_significant, noise, late_fit)


def _decay(fit: ExponentialFit, times: Array) -> Array:
    return np.asarray(fit.amplitude * np.exp(-times / fit.time_constant))


def _scaled(fit: ExponentialFit, scale: float) -> ExponentialFit:
    """Return a fit with its covariance scaled up to what the curve misses."""
    return ExponentialFit(
        fit.asymptote, fit.time_constant, fit.amplitude, fit.covariance * scale, fit.residual,
        fit.reason,
    )  # fmt: skip


def _group_starts(count: int) -> NDArray[np.int64]:
    """Return where groups of periods start: one by one at first, then ever longer groups."""
    starts = list(range(min(count, _SINGLE_PERIODS)))
    position = _SINGLE_PERIODS
    while position < count:
        starts.append(position)
        position += max(1, round(position / _GROUPS_PER_OCTAVE))
    return np.array(starts, dtype=np.int64)


@dataclass(frozen=True)
class SteadyState:
    """
    The steady part of a sequence of period means.

    Attributes
    ----------
    first, end : int
        First value of the steady part, and the one after its last.
    drift : float
        Standard uncertainty of the mean from what may be left of the settling.
    reason : str
        Why there is no steady part; empty if there is one.
    settling : Settling or None
        The regression; None with too few values for one.

    """

    first: int
    end: int
    drift: float
    reason: str
    settling: Settling | None


def find_steady_state(
    times: Array,
    values: Array,
    *,
    minimum: int,
    level: float,
    bound: float,
    scatter: float,
    what: str,
) -> SteadyState:
    """
    Find the steady part of a sequence of period means.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Middles of the periods (s), equally spaced.
    values : ndarray, shape (n,)
        The means.
    minimum : int
        Number of values that a steady part must have.
    level : float
        The steady part begins where the fitted exponential is this near its asymptote (relative).
    bound : float
        Largest change within the steady part (relative) that is tolerated where it is
        significant.
    scatter : float
        Largest standard error of the mean (relative) that is tolerated where noise from value to
        value does not explain it.
    what : str
        Name of the quantity, for the reason, e.g. "the velocity".

    Notes
    -----
    Where no exponential stands out of the noise, the part to leave out is the one that minimises
    the marginal standard error (MSER) of the rest, at most half.

    """
    n = values.size
    if n < minimum:
        return SteadyState(0, n, math.nan, f"{what} is unknown: {_too_few(n, minimum)}", None)
    settling = fit_settling(times, values)
    fit = settling.fit
    is_fitted = settling.is_significant and fit.is_valid
    if is_fitted:
        first = _settled_from(settling, times, level)
    else:
        first = _least_marginal_error(values)
    if n - first < minimum:
        late = first * (times[1] - times[0]) * 1e3
        return SteadyState(
            first, n, math.nan,
            f"{what} has not settled: it comes within {level:.1%} of its steady value "
            f"{late:.3g} ms after the first whole period; {_too_few(max(n - first, 0), minimum)}",
            settling,
        )  # fmt: skip
    drift, reason = _check_trend(values[first:], bound, what)
    if settling.is_significant and not reason:
        left, reason = _check_settling(settling, times[first:], values[first:], bound, what)
        drift = math.hypot(drift, left)
    reason = reason or _check_scatter(values[first:], scatter, what)
    return SteadyState(first, n, drift, reason, settling)


def _too_few(count: int, minimum: int) -> str:
    return f"only {count} whole drive periods are left, at least {minimum} are needed"


def _settled_from(settling: Settling, times: Array, level: float) -> int:
    """Return the first period in which what is left of the exponential does not matter."""
    fit = settling.fit
    # no need to be far below what the noise leaves uncertain in the mean
    enough = max(level * abs(fit.asymptote), 0.2 * settling.noise / math.sqrt(times.size))
    ratio = abs(fit.amplitude) / enough
    time = fit.time_constant * math.log(ratio) if ratio > 1.0 else 0.0
    return int(np.searchsorted(times, time))


def _check_settling(
    settling: Settling, times: Array, values: Array, bound: float, what: str
) -> tuple[float, str]:
    """Return the uncertainty due to the rest of an exponential, and a reason if it is too much."""
    if settling.fit.is_valid:
        return _mean_remainder(settling, times[0], times[-1]), ""
    # The asymptote is not known, but how the curve changes within the record is.
    change = settling.remainder(times[0]) - settling.remainder(times[-1])
    mean = abs(float(np.mean(values)))
    if change > bound * mean:
        return math.nan, (
            f"{what} has not settled: it still changes by {_share(change, mean)} over "
            f"{values.size} periods (bound {bound:.2%})"
        )
    return change, ""


def _share(change: float, mean: float) -> str:
    return f"{change / mean:+.2%}" if mean > 0.0 else f"{change:+.3g}"


def _check_scatter(values: Array, bound: float, what: str) -> str:
    """Return a reason if the values wander too much for their mean to mean anything."""
    mean, error = abs(float(np.mean(values))), standard_error(values)
    if error <= bound * mean or mean <= SIGNIFICANT * error:
        return ""
    noise = noise_of(values) / math.sqrt(values.size) * student_factor(values.size - 1)
    # few values cannot tell noise from wandering
    if values.size >= _ENOUGH_TO_TELL_NOISE and error <= 2.0 * noise:
        return ""
    return (
        f"{what} is not steady: over {values.size} periods the standard error of its mean is "
        f"{error / mean:.2%} (bound {bound:.2%})"
    )


def _mean_remainder(settling: Settling, start: float, end: float) -> float:
    tau = settling.fit.time_constant
    if end <= start:
        return settling.remainder(start)
    return (settling.remainder(start) - settling.remainder(end)) * tau / (end - start)


def _least_marginal_error(values: Array) -> int:
    """Return how many values to leave out so that the rest's mean has the least MSER."""
    n = values.size
    rest = values - np.mean(values[n // 2 :])
    counts = np.arange(n, 0, -1)
    sums = np.cumsum(rest[::-1])[::-1]
    squares = np.cumsum((rest * rest)[::-1])[::-1]
    errors = (squares - sums * sums / counts) / counts.astype(np.float64) ** 2
    return int(np.argmin(errors[: n // 2 + 1]))


def _check_trend(values: Array, bound: float, what: str) -> tuple[float, str]:
    """Return the uncertainty due to a trend within the bound, and a reason if it is beyond."""
    half = values.size // 2
    early, late = values[:half], values[half:]
    change = float(np.mean(late) - np.mean(early))
    error = math.hypot(standard_error(early), standard_error(late))
    mean = abs(float(np.mean(values)))
    if abs(change) <= SIGNIFICANT * error:
        return 0.0, ""
    if abs(change) > bound * mean:
        return math.nan, (
            f"{what} has not settled: from the first to the second half of {values.size} "
            f"periods its mean changes by {_share(change, mean)} (bound {bound:.2%})"
        )
    return abs(change), ""


def start_up_time(
    settling: Settling, first_time: float, offset_uncertainty: float
) -> tuple[float, float, str]:
    """
    Return the start-up time, its standard uncertainty, and a reason if there is none.

    Parameters
    ----------
    settling : Settling
        The regression of the period-mean velocity, times from the start of the drive.
    first_time : float
        Middle of the first period that entered it (s).
    offset_uncertainty : float
        Standard uncertainty of the velocity's offset (m/s), which shifts the asymptote.

    Notes
    -----
    The time t_0.99 or, where the velocity falls, t_1.01: when the regression comes within 1 %
    of its asymptote. A start-up is an exponential only where the force on the slider falls
    linearly with its velocity; elsewhere the time depends on which periods are fitted, and by how
    much enters the uncertainty.

    """
    reason = _start_up_reason(settling)
    if reason:
        return math.nan, math.nan, reason
    fit = settling.fit
    time, variance = _time_to_settle(fit)
    uncertainty = math.hypot(
        math.sqrt(variance), offset_uncertainty * fit.time_constant / fit.asymptote
    )
    late = settling.late_fit
    if late is not None and late.is_valid and late.amplitude * fit.amplitude > 0.0:
        late_time, late_variance = _time_to_settle(late)
        # with fewer values it scatters more: that part of the difference is noise
        excess = (late_time - time) ** 2 - max(late_variance - variance, 0.0)
        uncertainty = math.hypot(uncertainty, math.sqrt(max(excess, 0.0)))
    if time < first_time:
        reason = (
            f"the first whole period at full drive is steady already: it takes less than "
            f"{first_time * 1e3:.3g} ms"
        )
    elif uncertainty > time:
        reason = (
            f"the start-up time is lost in the noise: {time * 1e3:.3g} ms with a standard "
            f"uncertainty of {uncertainty * 1e3:.3g} ms"
        )
    return (math.nan, math.nan, reason) if reason else (time, uncertainty, "")


def _time_to_settle(fit: ExponentialFit) -> tuple[float, float]:
    """Return when a curve comes within 1 % of its asymptote (s), and the variance of that."""
    a, tau, b = fit.asymptote, fit.time_constant, fit.amplitude
    ratio = max(abs(b) / (TOLERANCE * abs(a)), 1e-300)
    time = tau * math.log(ratio)
    gradient = np.array([-tau / a, math.log(ratio), tau / b])
    return time, max(float(gradient @ fit.covariance @ gradient), 0.0)


def _start_up_reason(settling: Settling) -> str:
    if not settling.is_significant:
        return f"no start-up stands out of the noise of the period means ({settling.noise:.2g} m/s)"
    return settling.fit.reason

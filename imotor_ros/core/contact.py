"""
Contact of the slider with an end stop or spring, found from measured signals.

The load force tells of it first; the slider's period-mean velocity, which then drops, confirms
it, and serves alone where there is no force sensor. Forces are taken as means over whole drive
periods: what the stator shakes into the sensor vanishes in them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.period_statistics import SIGNIFICANT, noise_of, standard_error

Array = NDArray[np.float64]

# Parts the last three quarters of the bias are cut into at least: the first quarter is left to
# the filters of the instrument.
_FEWEST_PARTS = 16
_FEWEST_SAMPLES = 4

# Periods averaged where a single one is too noisy to tell how fast the slider is.
_SMOOTHING = 5

# A slider slower than this share of its best velocity has been stopped; one that keeps more
# than the second share has not been hindered.
_STOPPED = 0.3
_UNHINDERED = 0.9


@dataclass(frozen=True)
class Baseline:
    """
    The force channel before the drive starts.

    Attributes
    ----------
    offset, uncertainty : float
        Mean, and its standard error (N).
    noise : float
        Standard deviation of a mean over one drive period (N), rather too large than too small.
    reason : str
        Why there is none; empty if there is one.

    """

    offset: float = math.nan
    uncertainty: float = math.nan
    noise: float = math.nan
    reason: str = ""


def find_baseline(samples: Array, period: float) -> Baseline:
    """
    Return offset and noise of the force from the samples of the bias.

    Parameters
    ----------
    samples : ndarray, shape (n,)
        Force (N) from the start of the run to the start of the drive.
    period : float
        Length of a drive period (samples).

    """
    rest = samples[samples.size // 4 :]
    length = math.floor(min(period / 4.0, rest.size / _FEWEST_PARTS))
    if length < _FEWEST_SAMPLES:
        return Baseline(
            reason=f"the offset of the force is unknown: only {samples.size} samples before the "
            f"drive starts, at least {_FEWEST_PARTS * _FEWEST_SAMPLES * 4 // 3} are needed"
        )
    count = rest.size // length
    means = rest[rest.size - count * length :].reshape(count, length).mean(axis=1)
    # a part is shorter than a period, so its mean is at least as noisy
    return Baseline(float(np.mean(means)), standard_error(means), noise_of(means))


@dataclass(frozen=True)
class ContactCriteria:
    """
    What counts as contact.

    Attributes
    ----------
    threshold : float
        Smallest mean load force of a period (N) that counts; NaN without a force.
    persistence : int
        Number of successive periods for which it must hold.
    first : int
        First period at full drive.

    """

    threshold: float
    persistence: int
    first: int


@dataclass(frozen=True)
class Contact:
    """
    When the slider was first hindered.

    Attributes
    ----------
    row : int or None
        First period with contact; None if there was none.
    is_seen_by_force : bool
        True if the load force shows it.
    warning : str
        Disagreement of force and velocity; empty if there is none.

    """

    row: int | None
    is_seen_by_force: bool = False
    warning: str = ""


def find_contact(velocity: Array | None, force: Array | None, criteria: ContactCriteria) -> Contact:
    """
    Find the first period in which the slider is hindered.

    Parameters
    ----------
    velocity : ndarray, shape (n,), or None
        Mean slider velocity of each period (m/s).
    force : ndarray, shape (n,), or None
        Mean load force of each period (N), offset taken off.
    criteria : ContactCriteria
        What counts.

    """
    stopped = None if velocity is None else _stopped_from(velocity, criteria)
    loaded = None if force is None else _loaded_from(force, criteria)
    if loaded is None:
        if stopped is None or force is None:
            return Contact(stopped)
        return Contact(
            stopped,
            warning=f"the slider stops in period {stopped}, but no load force is seen",
        )
    if velocity is None or stopped is not None:
        return Contact(min(loaded, loaded if stopped is None else stopped), True)
    if _is_unhindered(velocity, loaded, criteria):
        return Contact(
            None,
            warning=f"a load force above {criteria.threshold:.2g} N is seen from period {loaded} "
            "on, but the slider does not slow down: not taken as contact",
        )
    return Contact(loaded, True)


def _loaded_from(force: Array, criteria: ContactCriteria) -> int | None:
    return _first_persistent(np.abs(force) > criteria.threshold, criteria.persistence)


def _first_persistent(holds: NDArray[np.bool_], persistence: int) -> int | None:
    """Return the first index from which on `holds` is true so many times in a row."""
    if holds.size < persistence:
        return None
    sums = np.cumsum(np.concatenate(([0], holds.astype(np.int64))))
    found = np.flatnonzero(sums[persistence:] - sums[:-persistence] == persistence)
    return int(found[0]) if found.size else None


def _smooth(values: Array) -> Array:
    sums = np.cumsum(np.concatenate(([0.0], values)))
    return np.asarray((sums[_SMOOTHING:] - sums[:-_SMOOTHING]) / _SMOOTHING)


def _stopped_from(velocity: Array, criteria: ContactCriteria) -> int | None:
    """Return the period from which on the slider, once fast, is slowed down to a stop."""
    free = velocity[criteria.first :]
    if free.size < 2 * _SMOOTHING:
        return None
    smooth = _smooth(free)
    best = int(np.argmax(np.abs(smooth)))
    speed = abs(float(smooth[best]))
    noise = noise_of(free)
    if speed <= 2.0 * SIGNIFICANT * noise / math.sqrt(_SMOOTHING):
        return None
    along = free * math.copysign(1.0, float(smooth[best]))
    low = _first_persistent(_smooth(along)[best:] < _STOPPED * speed, criteria.persistence)
    if low is None:
        return None
    # back from where the smoothed velocity is low to the last period that was not slowed
    end = best + low + _SMOOTHING - 1
    usual = float(np.median(along[: max(best + low, 1)]))
    limit = usual - max((1.0 - _UNHINDERED) * abs(usual), 4.0 * noise)
    while end > 0 and along[end - 1] < limit:
        end -= 1
    return criteria.first + end


def _is_unhindered(velocity: Array, loaded: int, criteria: ContactCriteria) -> bool:
    """Return whether the slider stays as fast as before although a force is seen."""
    after = velocity[loaded:]
    before = velocity[criteria.first : loaded]
    if after.size < 2 * _SMOOTHING:
        return False
    late = float(np.mean(after[-_SMOOTHING:]))
    error = noise_of(velocity[criteria.first :]) / math.sqrt(_SMOOTHING)
    if before.size < _SMOOTHING:
        return abs(late) > 2.0 * SIGNIFICANT * error
    usual = float(np.median(before))
    is_moving = abs(usual) > 2.0 * SIGNIFICANT * error
    return is_moving and late * math.copysign(1.0, usual) > _UNHINDERED * abs(usual)

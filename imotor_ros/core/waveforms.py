"""
Mean waveforms over one drive period, and what is read from them.

Noise is averaged over all periods before anything that is not linear is done (an extremum, a
magnitude, a power). What bias is left is avoided by halves: one half of the periods says where
an extremum lies, or which sign a velocity has, and the other half, whose noise is independent,
says how large it is there. That errs to the low side, for extrema; the value from one and the
same mean waveform errs to the high side. The two differ by what the noise leaves open, and that
enters the uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.channel import BESSEL_3, FIRST_ORDER
from imotor_ros.core.period_statistics import MEDIAN_TO_DEVIATION
from imotor_ros.core.periods import add_alternating, project_rows, square_deviations

Array = NDArray[np.float64]
Rows = NDArray[np.float64]
Selection = NDArray[np.int64]

FINER = 8
"""Points of the finer grid per point, for extrema and changes of sign."""

# Highest frequency, relative to the sample rate, at which samples say anything of a signal.
_USABLE_BAND = 0.4

# Harmonics up to this multiple of a channel's bandwidth are kept; what is above is noise.
_KEPT_BAND = 3.0

# A corner seen through a third-order Bessel low-pass of bandwidth B loses 0.0525/B times its
# change of slope; a smooth extremum less. The second difference over +-0.5/B at the corner is
# 0.395/B times the change of slope: the loss is at most 0.133 of it.
_CORNER_REACH = 0.5
_CORNER_LOSS = 0.133

# Second differences over this reach and twice as far tell a corner, of which the second is 2.3
# times the first, from a smooth extremum, of which it is 4 times the first: with these weights they
# give the loss of a symmetric corner and that of a parabola, through the low-pass and the
# harmonics that are kept.
_LOSS_WEIGHTS = {BESSEL_3: (0.2660, -0.0587), FIRST_ORDER: (0.2565, -0.0515)}

# Share of a period beyond which the reach says nothing of one extremum alone.
_FARTHEST_REACH = 0.125

# Standard uncertainty of the loss, relative: a corner with slopes of 7 to 3 loses 5 % less than
# the weights say, one of 9 to 1 up to 50 %, a sine of period 8/B 20 %.
_LOSS_DOUBT = 0.3

# Standard deviation of a value that lies anywhere between zero and a bound, from zero.
ONE_SIDED = 1.0 / math.sqrt(3.0)

# Weight of the crossed value of the peak-to-peak value, relative to the direct one. Over triangles
# and sines, with and without low-pass, of 13 to 400 periods' worth of noise, this leaves a bias of
# -0.6 to 0.8 deviations of the mean waveform's noise; the direct value has 0.03 to 3.2.
_CROSSED = 2.0

# A period whose distance from the mean waveform stands out by this many deviations is spoiled.
_SPOILED = 8.0


def count_harmonics(frequency: float, sample_rate: float, bandwidth: float, points: int) -> int:
    """
    Return how many harmonics of the drive a channel can show.

    Parameters
    ----------
    frequency, sample_rate : float
        Fundamental frequency and sample rate (Hz).
    bandwidth : float
        Upper -3 dB frequency (Hz) of the channel; 0 if unknown.
    points : int
        Points per period.

    """
    highest = _USABLE_BAND * sample_rate
    if bandwidth > 0.0:
        highest = min(highest, _KEPT_BAND * bandwidth)
    return max(1, min(math.floor(highest / frequency), points // 2 - 1))


def refine(waveform: Array, harmonics: int) -> Array:
    """Return a waveform of so many harmonics on a finer grid, shape (8 points,)."""
    spectrum = np.fft.rfft(waveform)[: harmonics + 1]
    return np.asarray(np.fft.irfft(spectrum, waveform.size * FINER) * FINER)


def coarsen_weights(weights: Array, harmonics: int, points: int) -> Array:
    """
    Return weights of the points that do what `weights` do on the finer grid.

    For any waveform x, sum(weights * refine(x)) = sum(coarsen_weights(weights) * x).
    """
    spectrum = np.fft.rfft(weights)[: harmonics + 1]
    return np.asarray(np.fft.irfft(spectrum, points))


def average(waveforms: Rows, selection: Selection) -> Rows:
    """
    Return the mean waveforms of two alternating halves of the selected periods.

    Parameters
    ----------
    waveforms : ndarray, shape (rows, points)
        Periods.
    selection : ndarray of int, shape (n,)
        Which of them; n >= 2.

    Returns
    -------
    ndarray, shape (2, points)

    """
    halves = np.empty((2, waveforms.shape[1]))
    add_alternating(waveforms, selection, halves)
    return halves


def mean_of_halves(halves: Rows, count: int) -> Array:
    """Return the mean waveform of all `count` periods, shape (points,)."""
    odd = (count + 1) // 2
    return np.asarray((halves[0] * odd + halves[1] * (count - odd)) / count)


def mean_waveform(waveforms: Rows, selection: Selection) -> Array:
    """Return the mean waveform of the selected periods, shape (points,)."""
    return mean_of_halves(average(waveforms, selection), selection.size)


def project(waveforms: Rows, selection: Selection, weights: Array) -> Array:
    """Return the weighted sum over the points of each selected period, shape (n,)."""
    values = np.empty(selection.size)
    project_rows(waveforms, selection, weights, values)
    return values


def without_spoiled(waveforms: Rows, selection: Selection) -> Selection:
    """Return the selected periods without those that stand out, e.g. by a signal drop-out."""
    halves = average(waveforms, selection)
    distances = np.empty(selection.size)
    square_deviations(waveforms, selection, mean_of_halves(halves, selection.size), distances)
    distances = np.sqrt(distances)
    middle = float(np.median(distances))
    deviation = MEDIAN_TO_DEVIATION * float(np.median(np.abs(distances - middle)))
    return selection[distances <= middle + _SPOILED * deviation]


@dataclass(frozen=True)
class Extremes:
    """
    Peak-to-peak value of a mean waveform.

    Attributes
    ----------
    value : float
        Peak to peak, with what the low-pass of the channel took off the extrema.
    per_period : ndarray, shape (n,)
        The same for each period at the phases of the extrema; its scatter is the noise.
    noise_bias : float
        Standard uncertainty from choosing extrema among noise.
    bandwidth_loss : float
        What the bandwidth took off: as it is estimated, or where it cannot be, its bound.
    bandwidth_doubt : float
        Standard uncertainty of the value from that.

    """

    value: float
    per_period: Array
    noise_bias: float
    bandwidth_loss: float
    bandwidth_doubt: float


def peak_to_peak(
    waveforms: Rows, selection: Selection, harmonics: int, reach: float, low_pass: str = ""
) -> Extremes:
    """
    Return the peak-to-peak value of the mean waveform of selected periods.

    Parameters
    ----------
    waveforms : ndarray, shape (rows, points)
        Periods.
    selection : ndarray of int, shape (n,)
        Which of them; n >= 2.
    harmonics : int
        Harmonics that are kept.
    reach : float
        Half the inverse bandwidth of the channel, in periods.
    low_pass : str
        Kind of the low-pass, as in `ChannelDescription`; of one that is not known, or too low, the
        loss at the extrema is only bounded.

    """
    points = waveforms.shape[1]
    halves = average(waveforms, selection)
    fine = refine(mean_of_halves(halves, selection.size), harmonics)
    first, second = (refine(half, harmonics) for half in halves)
    crossed = 0.5 * (_swing_at(first, second) + _swing_at(second, first))
    high, low = int(np.argmax(fine)), int(np.argmin(fine))
    direct = float(fine[high] - fine[low])
    weights = np.zeros(fine.size)
    weights[high] += 1.0
    weights[low] -= 1.0
    value = (direct + _CROSSED * crossed) / (1.0 + _CROSSED)
    steps = max(1, round(reach * fine.size))
    if low_pass in _LOSS_WEIGHTS and reach <= _FARTHEST_REACH:
        restoring = _loss_weights(fine.size, high, steps, low_pass)
        restoring -= _loss_weights(fine.size, low, steps, low_pass)
        weights += restoring
        loss = float(restoring @ fine)
        value += loss
        doubt = _LOSS_DOUBT * abs(loss)
    else:
        steps = min(steps, fine.size // 4)
        loss = _CORNER_LOSS * (_bend(fine, high, steps) + _bend(fine, low, steps))
        doubt = loss * ONE_SIDED
    return Extremes(
        value=value,
        per_period=project(waveforms, selection, coarsen_weights(weights, harmonics, points)),
        noise_bias=abs(direct - crossed) / math.sqrt(12.0),
        bandwidth_loss=loss,
        bandwidth_doubt=doubt,
    )


def _loss_weights(size: int, at: int, steps: int, low_pass: str) -> Array:
    """Return weights of the points that give what a low-pass took off a maximum."""
    weights = np.zeros(size)
    for share, distance in zip(_LOSS_WEIGHTS[low_pass], (steps, 2 * steps), strict=True):
        weights[at] += 2.0 * share
        weights[(at + distance) % size] -= share
        weights[(at - distance) % size] -= share
    return weights


def corner_reach(bandwidth: float, sample_rate: float, frequency: float) -> float:
    """Return the distance (periods) over which the bend at an extremum is measured."""
    limit = bandwidth if bandwidth > 0.0 else _USABLE_BAND * sample_rate
    return _CORNER_REACH / limit * frequency


def _swing_at(where: Array, waveform: Array) -> float:
    """Return the swing of a waveform between the extrema of another."""
    return float(waveform[int(np.argmax(where))] - waveform[int(np.argmin(where))])


def _bend(fine: Array, at: int, reach: int) -> float:
    n = fine.size
    return abs(float(fine[(at + reach) % n] + fine[(at - reach) % n] - 2.0 * fine[at]))


@dataclass(frozen=True)
class MeanMagnitude:
    """
    Mean magnitude of the difference of two mean waveforms.

    Attributes
    ----------
    value : float
        The mean magnitude.
    per_period : ndarray, shape (n,)
        The same for each period, with the signs of the mean waveform.
    noise_bias : float
        Standard uncertainty from the noise left in the signs.
    signs : ndarray, shape (8 points,)
        Sign of the difference on the finer grid.

    """

    value: float
    per_period: Array
    noise_bias: float
    signs: Array


def mean_magnitude(
    minuend: Rows, subtrahend: Rows, offset: float, selection: Selection, harmonics: int
) -> MeanMagnitude:
    """
    Return the mean of |minuend - subtrahend - offset| over the mean waveforms.

    Parameters
    ----------
    minuend, subtrahend : ndarray, shape (rows, points)
        Periods of two channels.
    offset : float
        Known offset of the difference.
    selection : ndarray of int, shape (n,)
        Which periods; n >= 2.
    harmonics : int
        Harmonics that are kept.

    """
    points = minuend.shape[1]
    halves = average(minuend, selection) - average(subtrahend, selection) - offset
    fine = refine(mean_of_halves(halves, selection.size), harmonics)
    first, second = (refine(half, harmonics) for half in halves)
    crossed = 0.5 * float(np.mean(np.sign(first) * second) + np.mean(np.sign(second) * first))
    direct = float(np.mean(np.abs(fine)))
    signs = np.sign(fine)
    weights = coarsen_weights(signs / signs.size, harmonics, points)
    per_period = (
        project(minuend, selection, weights)
        - project(subtrahend, selection, weights)
        - offset * float(np.sum(weights))
    )
    return MeanMagnitude(crossed, per_period, abs(direct - crossed) / math.sqrt(12.0), signs)


@dataclass(frozen=True)
class Effective:
    """
    Effective value of a mean waveform without its mean.

    Attributes
    ----------
    value : float
        Root mean square over all harmonics; 0 if nothing stands out of the noise.
    per_period : ndarray, shape (n,)
        What each period contributes, to first order; the mean is about `value`.
    powers : ndarray, shape (harmonics,)
        Mean square of each harmonic; noise can make one negative.

    """

    value: float
    per_period: Array
    powers: Array

    def hidden_share(self, ratio: float) -> float:
        """
        Return how much of the true value the channel's bandwidth may hide (relative).

        `ratio` is the fundamental frequency over the bandwidth, at which the channel is taken
        to be down by 3 dB as a first-order low-pass; steeper ones hide less below it.
        """
        order = np.arange(1, self.powers.size + 1)
        # far beyond the bandwidth there is only noise to be raised
        within = order * ratio <= 1.0
        measured = float(np.sum(self.powers[within]))
        true = float(np.sum((self.powers * (1.0 + (order * ratio) ** 2))[within]))
        return 1.0 - math.sqrt(measured / true) if true > measured > 0.0 else 0.0


def effective_value(waveforms: Rows, selection: Selection, harmonics: int) -> Effective:
    """
    Return the effective value of harmonics 1 ... `harmonics` of the mean waveform.

    The power is the cross power of the two halves, to which noise adds nothing on average.
    """
    points = waveforms.shape[1]
    halves = average(waveforms, selection)
    spectra = np.fft.rfft(halves, axis=1)[:, 1 : harmonics + 1] / points
    powers = 2.0 * (spectra[0] * np.conj(spectra[1])).real
    power = float(np.sum(powers))
    if power <= 0.0:
        return Effective(0.0, np.zeros(selection.size), powers)
    value = math.sqrt(power)
    mean = mean_of_halves(halves, selection.size)
    kept = np.fft.rfft(mean)
    kept[0] = 0.0
    kept[harmonics + 1 :] = 0.0
    weights = np.fft.irfft(kept, points) / (points * value)
    return Effective(value, project(waveforms, selection, weights), powers)


def rectified_error(values: Array, deviations: Array) -> float:
    """
    Return by how much fixed errors raise the mean magnitude of values, on average.

    Parameters
    ----------
    values, deviations : ndarray, shape (n,)
        True values and standard deviations of normal errors.

    """
    total = 0.0
    for value, deviation in zip(np.abs(values), deviations, strict=True):
        if deviation <= 0.0 or value > 6.0 * deviation:
            continue
        ratio = value / deviation
        folded = math.sqrt(2.0 / math.pi) * math.exp(-0.5 * ratio * ratio)
        total += deviation * (folded + ratio * math.erf(ratio / math.sqrt(2.0)) - ratio)
    return total / values.size

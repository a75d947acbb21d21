"""
Harmonics of a measured velocity over the whole periods of one step, with their noise.

What the instrument does to them is taken out: its delay, by reading the samples later, and the
response of its low-pass, a third-order Bessel filter as velocity decoders have it. Noise is
taken from what changes between neighbouring periods, not from a data sheet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.linear_systems import bessel_low_pass, first_order_high_pass
from imotor_ros.core.periods import fold_rows

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Points per period beyond which nothing is gained, and samples that the interpolation needs
# around a period.
_POINTS_STEP = 16
_MARGIN = 16


@dataclass(frozen=True)
class Harmonics:
    """
    A periodic velocity, v = mean + Re sum of phasors_k exp(i k theta), k = 1 ... n.

    Attributes
    ----------
    mean : float
        Mean (m/s), with the channel's offset in it.
    phasors : ndarray of complex, shape (n,)
        Amplitudes and phases (m/s).
    noise : float
        Standard deviation (m/s) of the real and the imaginary part of every phasor.
    drift : complex
        First phasor of the second half of the periods less that of the first half (m/s).
    periods : int
        Number of periods they are the mean of.

    """

    mean: float
    phasors: Complex
    noise: float
    drift: complex
    periods: int

    def seen_as(self, ratio: complex) -> Harmonics:
        """
        Return the harmonics as another channel shows them.

        Parameters
        ----------
        ratio : complex
            First harmonic of the other channel over that of this one, for the same velocity: its
            magnitude is a gain, its phase a delay.

        """
        orders = np.arange(1, self.phasors.size + 1)
        turns = np.exp(1j * orders * np.angle(ratio))
        return replace(
            self,
            mean=abs(ratio) * self.mean,
            phasors=abs(ratio) * turns * self.phasors,
            noise=abs(ratio) * self.noise,
            drift=ratio * self.drift,
        )


def residual_response(channel: ChannelDescription, frequency: Array) -> Complex:
    """
    Return what a channel does to harmonics once its low-frequency delay is taken out.

    Parameters
    ----------
    channel : ChannelDescription
        The channel; its bandwidth is taken as that of a third-order Bessel low-pass, its
        high-pass as of first order. A bandwidth of 0 means that none is known.
    frequency : ndarray, shape (n,)
        Frequencies (Hz).

    """
    response = np.ones(frequency.shape, dtype=np.complex128)
    if channel.bandwidth > 0.0:
        low_pass = bessel_low_pass(channel.bandwidth)
        turn = np.exp(2j * np.pi * frequency * low_pass.delay)
        response = response * low_pass.frequency_response(frequency) * turn
    if channel.high_pass_frequency > 0.0:
        high_pass = first_order_high_pass(channel.high_pass_frequency)
        response = response * high_pass.frequency_response(frequency)
    return response


def whole_periods(start: int, end: int, period: float, delay: float) -> int:
    """
    Return how many periods can be read between two samples.

    Parameters
    ----------
    start, end : int
        First sample, and the one after the last.
    period, delay : float
        Drive period and delay of the channel (samples).

    """
    return max(0, math.floor((end - start - max(delay, 0.0) - _MARGIN) / period))


def measure_harmonics(
    samples: Array,
    channel: ChannelDescription,
    *,
    start: int,
    periods: int,
    frequency: float,
    sample_rate: float,
    count: int,
) -> Harmonics:
    """
    Return the harmonics of a channel over whole drive periods.

    Parameters
    ----------
    samples : ndarray, shape (n,)
        The channel from sample 0 of the run on.
    channel : ChannelDescription
        What it is.
    start, periods : int
        Sample at which the first period starts, and number of periods, at least 4.
    frequency, sample_rate : float
        Of the drive, and of the samples (Hz).
    count : int
        Number of harmonics.

    """
    period = sample_rate / frequency
    points = _POINTS_STEP * math.ceil(max(period, 4.0 * count) / _POINTS_STEP)
    waveforms, means = np.empty((periods, points)), np.empty(periods)
    delay = channel.delay * sample_rate
    fold_rows(np.ascontiguousarray(samples), 0, start, period, delay, 0, waveforms, means)
    parts = waveforms @ _projection(points, count)
    rows = parts[:, :count] + 1j * parts[:, count:]
    orders = np.arange(1, count + 1, dtype=np.float64)
    response = residual_response(channel, orders * frequency)
    half = periods // 2
    drift = (rows[-half:, 0].mean() - rows[:half, 0].mean()) / response[0]
    return Harmonics(
        mean=float(means.mean()),
        phasors=rows.mean(axis=0) / response,
        noise=max(_noise_of(rows, response), _least_noise(rows, channel, periods * period)),
        drift=complex(drift),
        periods=periods,
    )


@cache
def _projection(points: int, count: int) -> Array:
    """Return what takes a waveform to the real, then the imaginary parts of its phasors."""
    phases = 2.0 * np.pi * (np.arange(points) + 0.5) / points
    turns = np.exp(-1j * np.outer(phases, np.arange(1, count + 1))) * (2.0 / points)
    return np.hstack([turns.real, turns.imag])


def _noise_of(rows: Complex, response: Complex) -> float:
    """
    Return the standard deviation of both parts of the mean phasors.

    The noise is white in front of the low-pass, so that one number holds for all harmonics. The
    first is left out: it changes most where the slider has not quite settled.
    """
    power = np.mean(np.abs(np.diff(rows, axis=0)) ** 2, axis=0) / 4.0
    density = power / np.abs(response) ** 2
    white = float(density[1:].mean() if density.size > 1 else density[0])
    return math.sqrt(white / len(rows))


def _least_noise(rows: Complex, channel: ChannelDescription, samples: float) -> float:
    """
    Return what the noise is at least: that of the digitiser's rounding.

    Without dither the same errors come in every period, and nothing changes between periods.
    """
    rounding = channel.resolution / math.sqrt(12.0) * math.sqrt(2.0 / samples)
    return max(rounding, 1e-9 * float(np.abs(rows).max()), 1e-15)

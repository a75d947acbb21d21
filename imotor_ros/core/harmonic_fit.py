"""
Harmonics of a steady motion by least squares over whole drive periods.

The window is cut into parts of whole periods, each fitted by itself: their scatter tells the
noise, whatever its cause. What the channel does to each harmonic is divided out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.channel_response import channel_response
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.samples import Samples
from imotor_ros.errors import BadInputError

PARTS = 8
"""Parts that a window is cut into."""


@dataclass(frozen=True)
class HarmonicFit:
    """
    Harmonics of a quantity over the parts of a window.

    Attributes
    ----------
    parts : ndarray of complex, shape (m, n)
        Per part and harmonic A exp(i psi) of A sin(2 pi k f t + psi), with the cycles of the
        drive and the channel's response taken out (unit of the channel).

    """

    parts: Complex

    @property
    def phasors(self) -> Complex:
        """Means over the parts, shape (n,)."""
        return np.asarray(self.parts.mean(axis=0))

    @property
    def uncertainties(self) -> Samples:
        """Standard uncertainty of real and of imaginary part of the means, shape (n,)."""
        count = len(self.parts)
        scatter = np.abs(self.parts - self.phasors) ** 2
        return np.asarray(np.sqrt(scatter.sum(axis=0) / (2.0 * (count - 1) * count)))


def window_length(frequency: float, sample_rate: float, time: float) -> int:
    """
    Return the samples that `fit_harmonics` needs to measure for a time.

    Parameters
    ----------
    frequency, sample_rate : float
        Of the drive and of the samples (Hz).
    time : float
        Least time (s); it is rounded up to whole periods in every part.

    """
    periods = PARTS * max(1, math.ceil(time * frequency / PARTS))
    return math.ceil(periods * sample_rate / frequency)


def fit_harmonics(
    samples: Samples,
    channel: ChannelDescription,
    program: DriveProgram,
    label: str,
    *,
    settling_time: float,
    count: int,
) -> HarmonicFit:
    """
    Return the harmonics of a channel in a steady segment of a program.

    Parameters
    ----------
    samples : ndarray, shape (program.length,)
        The channel from sample 0 of the program on.
    channel : ChannelDescription
        What it is.
    program : DriveProgram
        What was played.
    label : str
        The segment, of constant frequency.
    settling_time : float
        Time (s) left out at its start.
    count : int
        Number of harmonics of the segment's frequency.

    Raises
    ------
    BadInputError
        If the segment is too short for one period in every part, or the samples end before.

    """
    start, end = program.span(label)
    segment = next(one for one in program.segments if one.label == label)
    period = program.sample_rate / segment.start_frequency
    delay = channel.delay * program.sample_rate
    first = start + math.ceil(settling_time * program.sample_rate + max(delay, 0.0))
    periods = math.floor((end - first) / (PARTS * period) + 1e-9)
    if periods < 1 or end > len(samples):
        raise BadInputError(
            "is too short to be measured",
            where=f"{program.run_id}: {label}",
            value=min(end, len(samples)) - first,
            bound=f">= {PARTS * period:.0f} samples after settling",
        )
    edges = first + np.rint(np.arange(PARTS + 1) * periods * period).astype(np.int64)
    turns = program.cycles(label, np.arange(edges[0], edges[-1], dtype=np.float64))
    rows = zip(edges - edges[0], edges[1:] - edges[0], strict=False)
    window = samples[edges[0] : edges[-1]]
    parts = np.array([_fit(turns[a:b], window[a:b], count) for a, b in rows])
    frequencies = np.arange(1, count + 1) * segment.start_frequency
    return HarmonicFit(parts / channel_response(channel, frequencies))


def _fit(turns: Samples, samples: Samples, count: int) -> Complex:
    """Return A exp(i psi) of each harmonic of a stretch; a constant beside them is fitted too."""
    matrix = np.zeros((2 * count + 1, 2 * count + 1))
    right = np.zeros(2 * count + 1)
    _add_up(np.ascontiguousarray(turns), np.ascontiguousarray(samples), count, matrix, right)
    found = np.linalg.solve(matrix, right)
    return np.asarray(found[1 : count + 1] + 1j * found[count + 1 :])


@njit(
    "void(Array(float64, 1, 'C', readonly=True), Array(float64, 1, 'C', readonly=True), int64, "
    "float64[:, ::1], float64[::1])",
    cache=True,
    error_model="numpy",
)
def _add_up(
    turns: Samples, samples: Samples, count: int, matrix: NDArray[np.float64], right: Samples
) -> None:
    """
    Add up the normal equations of the fit, sample by sample.

    So the result has the same bits in every process, which a threaded library does not promise.
    """
    size = 2 * count + 1
    shape = np.empty(size)
    shape[0] = 1.0
    for i in range(len(turns)):
        sine, cosine = math.sin(2.0 * math.pi * turns[i]), math.cos(2.0 * math.pi * turns[i])
        s, c = 0.0, 1.0
        for k in range(count):
            s, c = s * cosine + c * sine, c * cosine - s * sine
            shape[1 + k] = s
            shape[1 + count + k] = c
        for j in range(size):
            right[j] += shape[j] * samples[i]
            for k in range(size):
                matrix[j, k] += shape[j] * shape[k]

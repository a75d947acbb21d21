"""
Linear filters on sampled streams.

A stream of samples is taken as the continuous signal that interpolates it, passed through a
continuous-time system in closed form, and sampled again.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from imotor_ros.core.linear_systems import Complex, LinearSystem
from imotor_ros.core.samples import Samples, checked_sample_rate, checked_samples
from imotor_ros.errors import BadInputError

# Poles faster than this many radians per sample leave nothing to filter at that sample rate.
_FASTEST_POLE = 8.0


class StreamFilter:
    """
    A linear system with a delay, applied to a stream of samples.

    The samples are interpolated between each other, linearly or by the cubic through the four
    nearest; the system's answer to that signal is computed without further approximation. The
    impulse response h of the sampled filter is the answer to the interpolation's own kernel:
    single taps while the kernel passes, then one geometric sequence per pole. What is before
    the stream's start counts as zero.

    Parameters
    ----------
    system : LinearSystem
        What to pass through.
    sample_rate : float
        Samples per second (Hz).
    delay : float, optional
        Delay (s) in front of the system. Cubic interpolation looks one sample ahead: with it,
        a shorter delay becomes one sample.
    interpolation : {"cubic", "linear"}
        Cubic is true to 1e-4 up to a twentieth of the sample rate; linear needs no delay.

    Raises
    ------
    BadInputError
        If a pole is too fast for the sample rate.

    """

    def __init__(
        self,
        system: LinearSystem,
        sample_rate: float,
        *,
        delay: float = 0.0,
        interpolation: str = "cubic",
    ) -> None:
        self.sample_rate = checked_sample_rate(sample_rate)
        half_width = {"linear": 1, "cubic": 2}[interpolation]
        rate = self.sample_rate
        fastest = max((abs(pole) for pole in system.poles), default=0.0)
        if fastest > _FASTEST_POLE * rate:
            raise BadInputError(
                "is too low for the filter",
                where="sample_rate",
                value=rate,
                bound=f">= {fastest / _FASTEST_POLE:g} Hz",
            )
        lag = max(delay * rate, half_width - 1.0)
        first = math.floor(lag - half_width) + 1
        self._tail_start = math.ceil(lag + half_width)
        indices = range(max(first, 0), self._tail_start)
        self._taps = np.array([_kernel_answer(system, rate, n - lag, half_width) for n in indices])
        self._first_tap = max(first, 0)
        self._poles = np.exp(np.array(system.poles, dtype=np.complex128) / rate)
        self._weights = _tail_weights(system, rate, self._tail_start - lag, half_width)
        self._make_state()

    def _make_state(self) -> None:
        # a pair of conjugate poles is one complex state whose real part counts twice
        upper = self._poles.imag >= 0.0
        double = np.where(self._poles.imag[upper] > 0.0, 2.0, 1.0)
        self._modes = np.column_stack(
            [
                self._poles[upper].real,
                self._poles[upper].imag,
                double * self._weights[upper].real,
                double * self._weights[upper].imag,
            ]
        )
        self._state = np.zeros((len(self._modes), 2))
        self._history = np.zeros(self._tail_start)
        self._index = 0

    def process(self, samples: ArrayLike) -> Samples:
        """
        Return the filtered samples, shape (n,), of the next n samples of the stream.

        Raises
        ------
        BadInputError
            If a sample is not finite.

        """
        block = checked_samples(samples, where="filter", first_index=self._index)
        joined = np.concatenate([self._history, block])
        filtered = np.empty(len(block))
        _pass_through(
            joined,
            self._tail_start,
            self._first_tap,
            self._taps,
            self._modes,
            self._state,
            filtered,
        )
        self._history = joined[len(block) :].copy()
        self._index += len(block)
        return filtered

    @property
    def delay(self) -> float:
        """Delay (s) of the samples at low frequency, exact for the sampled filter."""
        n = self._first_tap + np.arange(len(self._taps))
        rest = 1.0 - self._poles
        tail = self._weights / rest
        late = tail * (self._tail_start + self._poles / rest)
        gain = self._taps.sum() + tail.sum().real
        return float((n @ self._taps + late.sum().real) / gain / self.sample_rate)

    @property
    def settling(self) -> int:
        """Number of samples after which an input step is answered to within 1 % of its height."""
        rest, count = np.abs(self._weights / (1.0 - self._poles)), 0
        speed = np.abs(self._poles).max(initial=0.0)
        # after the taps, what is still missing decays at least as fast as the slowest pole
        if rest.sum() > 0.01 and speed > 0.0:
            count = math.ceil(math.log(0.01 / rest.sum()) / math.log(speed))
        return self._tail_start + count

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return the complex gain of the sampled filter at frequencies (Hz), shape (...)."""
        turn = np.exp(-2j * np.pi * np.asarray(frequency, dtype=np.float64) / self.sample_rate)
        value = np.zeros(turn.shape, dtype=np.complex128)
        for n, tap in enumerate(self._taps, self._first_tap):
            value = value + tap * turn**n
        for pole, weight in zip(self._poles, self._weights, strict=True):
            value = value + weight * turn**self._tail_start / (1.0 - pole * turn)
        return value

    @property
    def noise_gain(self) -> float:
        """Standard deviation of the output over that of a white input."""
        # sum of h^2: taps one by one, the tail as geometric sums over all pairs of poles
        pairs = np.outer(self._weights, self._weights) / (1.0 - np.outer(self._poles, self._poles))
        return math.sqrt(float(self._taps @ self._taps + pairs.sum().real))


def _interpolation_kernel(s: Samples, half_width: int) -> Samples:
    """Return the weight of a sample at distance `s` (samples): Lagrange polynomials, even."""
    x = np.abs(s)
    if half_width == 1:
        return np.asarray(np.maximum(1.0 - x, 0.0))
    inner = (1.0 - x) * (1.0 + x) * (2.0 - x) / 2.0
    outer = (1.0 - x) * (2.0 - x) * (3.0 - x) / 6.0
    return np.where(x < 1.0, inner, np.where(x < 2.0, outer, 0.0))


@cache
def _quadrature() -> tuple[Samples, Samples]:
    """Return nodes and weights of a Gauss rule exact to rounding for the integrals below."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    return nodes, weights


def _kernel_integral(exponent: complex, end: float, half_width: int) -> complex:
    """Return the integral of kernel(s) exp(-exponent s) over s <= `end`."""
    nodes, weights = _quadrature()
    total = 0j
    for low in range(-half_width, half_width):
        high = min(low + 1.0, end)
        if high <= low:
            break
        s = low + (high - low) * 0.5 * (nodes + 1.0)
        values = _interpolation_kernel(s, half_width) * np.exp(-exponent * s)
        total += complex((high - low) * 0.5 * (weights @ values))
    return total


def _kernel_answer(system: LinearSystem, rate: float, t: float, half_width: int) -> float:
    """Return the system's answer, `t` samples after its centre, to the interpolation kernel."""
    kernel = _interpolation_kernel(np.array([t]), half_width)
    value = system.feedthrough * complex(kernel[0])
    for pole, residue in zip(system.poles, system.residues(), strict=True):
        p = pole / rate
        value += residue / rate * np.exp(p * t) * _kernel_integral(p, t, half_width)
    return float(value.real)


def _tail_weights(system: LinearSystem, rate: float, t: float, half_width: int) -> Complex:
    """Return what each pole contributes `t` samples after the kernel's centre, kernel passed."""
    return np.array(
        [
            r / rate * np.exp(p / rate * t) * _kernel_integral(p / rate, half_width, half_width)
            for p, r in zip(system.poles, system.residues(), strict=True)
        ],
        dtype=np.complex128,
    )


@njit(
    "void(float64[::1], int64, int64, float64[::1], float64[:, ::1], float64[:, "
    "::1], float64[::1])",
    cache=True,
    error_model="numpy",
)
def _pass_through(
    joined: Samples,
    tail_start: int,
    first_tap: int,
    taps: Samples,
    modes: Samples,
    state: Samples,
    filtered: Samples,
) -> None:
    """Run the filter over a block: `joined` is the block behind `tail_start` earlier samples."""
    for i in range(len(filtered)):
        value = 0.0
        at = i + tail_start - first_tap
        for j in range(len(taps)):
            value += taps[j] * joined[at - j]
        for k in range(len(modes)):
            re = modes[k, 0] * state[k, 0] - modes[k, 1] * state[k, 1] + joined[i]
            im = modes[k, 1] * state[k, 0] + modes[k, 0] * state[k, 1]
            value += modes[k, 2] * re - modes[k, 3] * im
            state[k, 0] = re
            state[k, 1] = im
        filtered[i] = value

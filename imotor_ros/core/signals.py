"""
Rod motions: sums of harmonics, and the sawtooth signals of the paper made of them.

A motion is a sum of sines, so that position, velocity and acceleration are exact at any time.
Sections 2 and 6 and table 1 of Hunstig, Hemsel and Sextro, "High-Velocity Operation of
Piezoelectric Inertia Motors - Experimental Validation".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.errors import BadInputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HarmonicMotion:
    """
    A periodic rod displacement, x(t) = sum of A_k sin(2 pi k f_1 t + psi_k), k = 1 ... n.

    Attributes
    ----------
    fundamental_frequency : float
        Frequency f_1 of the first harmonic (Hz).
    amplitudes : tuple of float
        Amplitudes A_k (m).
    phases : tuple of float
        Sine phases psi_k (rad).

    """

    fundamental_frequency: float
    amplitudes: tuple[float, ...]
    phases: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check the numbers and make plain tuples of them."""
        _check_positive(self.fundamental_frequency, "fundamental_frequency", "Hz")
        object.__setattr__(self, "fundamental_frequency", float(self.fundamental_frequency))
        for name in ("amplitudes", "phases"):
            values = tuple(float(value) for value in getattr(self, name))
            if not all(math.isfinite(value) for value in values):
                raise BadInputError("is not finite", where=name, value=values)
            object.__setattr__(self, name, values)
        if not self.amplitudes or len(self.amplitudes) != len(self.phases):
            raise BadInputError(
                "differ in number or are none",
                where="amplitudes, phases",
                value=(len(self.amplitudes), len(self.phases)),
            )

    @property
    def harmonics(self) -> int:
        """Number n of harmonics."""
        return len(self.amplitudes)

    @property
    def period(self) -> float:
        """Period (s) of the fundamental."""
        return 1.0 / self.fundamental_frequency

    @property
    def max_frequency(self) -> float:
        """Frequency f_n = n f_1 (Hz) of the highest harmonic."""
        return self.harmonics * self.fundamental_frequency

    @property
    def relative_phases(self) -> tuple[float, ...]:
        """Phases psi_k - k psi_1 (rad) in (-pi, pi], as in table 1; the first is zero."""
        first = self.phases[0]
        return tuple(_wrap(phase - k * first) for k, phase in enumerate(self.phases, 1))

    @cached_property
    def stroke(self) -> float:
        """Peak-to-peak displacement (m)."""
        low, high = _extremes(np.array(self.amplitudes), np.array(self.phases))
        return high - low

    def position(self, time: ArrayLike) -> Array:
        """Return the displacement (m) at the times (s), shape as `time`."""
        return self._evaluate(time, 0)

    def velocity(self, time: ArrayLike) -> Array:
        """Return the velocity (m/s) at the times (s), shape as `time`."""
        return self._evaluate(time, 1)

    def acceleration(self, time: ArrayLike) -> Array:
        """Return the acceleration (m/s^2) at the times (s), shape as `time`."""
        return self._evaluate(time, 2)

    def shifted(self, time: float) -> HarmonicMotion:
        """Return the motion that is ahead by `time` (s): its position(t) is position(t + time)."""
        turn = 2.0 * math.pi * math.fmod(self.fundamental_frequency * time, 1.0)
        phases = tuple(phase + k * turn for k, phase in enumerate(self.phases, 1))
        return HarmonicMotion(self.fundamental_frequency, self.amplitudes, phases)

    def scaled(self, factor: float) -> HarmonicMotion:
        """Return the motion with all amplitudes times `factor`."""
        amplitudes = tuple(factor * amplitude for amplitude in self.amplitudes)
        return HarmonicMotion(self.fundamental_frequency, amplitudes, self.phases)

    def _evaluate(self, time: ArrayLike, order: int) -> Array:
        # Whole turns are taken off first: far from time zero the phases would lose digits.
        turns = np.asarray(time, dtype=np.float64) * self.fundamental_frequency
        angle = 2.0 * np.pi * (turns - np.floor(turns))
        omega = 2.0 * np.pi * self.fundamental_frequency
        total = np.zeros_like(angle)
        for k, (amplitude, phase) in enumerate(zip(self.amplitudes, self.phases, strict=True), 1):
            gain = amplitude * (k * omega) ** order
            total += gain * np.sin(k * angle + (phase + order * (np.pi / 2)))
        return total


def parabolic_sawtooth(
    harmonics: int,
    stroke: float = 15e-6,
    *,
    fundamental_frequency: float | None = None,
    maximum_frequency: float | None = None,
) -> HarmonicMotion:
    """
    Return the parabolic sawtooth of the paper, made of its first harmonics.

    Parameters
    ----------
    harmonics : int
        Number n of harmonics.
    stroke : float
        Peak-to-peak displacement (m) of the sum.
    fundamental_frequency, maximum_frequency : float
        Frequency (Hz) of the first or of the highest harmonic; give exactly one of them.

    Returns
    -------
    HarmonicMotion
        Its slider moves towards +x.

    Raises
    ------
    BadInputError
        If a number is out of bounds, or none or both of the frequencies are given.

    Notes
    -----
    Fourier series of x = A (t/T)^2, each harmonic times Lanczos' factor sinc(k / (n + 1)):
    sections 2 and 6, table 1.

    Examples
    --------
    >>> motion = parabolic_sawtooth(4, fundamental_frequency=4625.0)
    >>> [round(1e6 * amplitude, 3) for amplitude in motion.amplitudes]
    [6.23, 2.432, 1.073, 0.372]

    """
    frequency = _fundamental(harmonics, fundamental_frequency, maximum_frequency)
    return _from_series(lambda k: 1.0 / (np.pi * k) ** 2, harmonics, stroke, frequency)


def classic_sawtooth(
    harmonics: int,
    stroke: float = 15e-6,
    *,
    fundamental_frequency: float | None = None,
    maximum_frequency: float | None = None,
) -> HarmonicMotion:
    """
    Return the classic sawtooth, a straight rise and a quick return, made of its first harmonics.

    Parameters, result and errors are those of `parabolic_sawtooth`; the series is that of
    x = A t/T, with the same Lanczos factors.
    """
    frequency = _fundamental(harmonics, fundamental_frequency, maximum_frequency)
    return _from_series(np.zeros_like, harmonics, stroke, frequency)


def sine(amplitude: float, frequency: float) -> HarmonicMotion:
    """Return the motion amplitude * sin(2 pi frequency t), amplitude in m, frequency in Hz."""
    return HarmonicMotion(frequency, (amplitude,), (0.0,))


def ideal_parabolic_sawtooth(phase: ArrayLike, stroke: float = 15e-6) -> Array:
    """
    Return the displacement (m) of the ideal parabolic sawtooth of figure 2.

    Parameters
    ----------
    phase : array_like
        Time in periods, t/T; any real number.
    stroke : float
        Peak-to-peak displacement (m).

    """
    turns = np.asarray(phase, dtype=np.float64)
    share = turns - np.floor(turns)
    return np.asarray(stroke * share * share)


def _from_series(
    cosine: Callable[[Array], Array], harmonics: int, stroke: float, frequency: float
) -> HarmonicMotion:
    """Both sawtooths share the sine terms -1/(pi k); only the cosine terms differ."""
    _check_positive(stroke, "stroke", "m")
    k = np.arange(1, harmonics + 1, dtype=np.float64)
    lanczos = np.sinc(k / (harmonics + 1))
    a, b = cosine(k) * lanczos, -lanczos / (np.pi * k)
    amplitudes, phases = np.hypot(a, b), np.arctan2(a, b)
    low, high = _extremes(amplitudes, phases)
    scaled = tuple((stroke / (high - low) * amplitudes).tolist())
    motion = HarmonicMotion(frequency, scaled, tuple(phases.tolist()))
    motion.__dict__["stroke"] = float(stroke)
    return motion


def _fundamental(harmonics: int, fundamental: float | None, maximum: float | None) -> float:
    is_count = isinstance(harmonics, int) and not isinstance(harmonics, bool)
    if not is_count or not 1 <= harmonics <= 1000:
        raise BadInputError(
            "is out of bounds", where="harmonics", value=harmonics, bound="1 to 1000"
        )
    if (fundamental is None) == (maximum is None):
        raise BadInputError(
            "give exactly one", where="fundamental_frequency, maximum_frequency",
            value=(fundamental, maximum),
        )  # fmt: skip
    if fundamental is not None:
        _check_positive(fundamental, "fundamental_frequency", "Hz")
        return float(fundamental)
    assert maximum is not None
    _check_positive(maximum, "maximum_frequency", "Hz")
    return maximum / harmonics


def _check_positive(value: float, where: str, unit: str) -> None:
    if not (math.isfinite(value) and value > 0):
        raise BadInputError("is out of bounds", where=where, value=value, bound=f"> 0 {unit}")


def _wrap(angle: float) -> float:
    """Return the angle (rad) in (-pi, pi]."""
    wrapped = math.remainder(angle, 2.0 * math.pi)
    return math.pi if wrapped <= -math.pi else wrapped


def extremes(amplitudes: ArrayLike, phases: ArrayLike) -> tuple[float, float]:
    """
    Return lowest and highest value of sum A_k sin(k theta + psi_k), k = 1, 2, ...

    Parameters
    ----------
    amplitudes, phases : array_like, shape (n,)
        Amplitudes A_k and sine phases psi_k (rad); both values are 0 without any.

    """
    sizes = np.asarray(amplitudes, dtype=np.float64)
    if not np.any(sizes):
        return 0.0, 0.0
    return _extremes(sizes, np.asarray(phases, dtype=np.float64))


def _extremes(amplitudes: Array, phases: Array) -> tuple[float, float]:
    """
    Do the work of `extremes`.

    A grid of 32 points per shortest wave holds every extreme to 0.5 % of its wave; two Newton
    steps from the grid's own local extremes bring the value to rounding error.
    """
    k = np.arange(1, amplitudes.size + 1)
    points = 32 * amplitudes.size
    theta = 2.0 * np.pi * np.arange(points) / points
    spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
    spectrum[1 : amplitudes.size + 1] = -0.5j * amplitudes * np.exp(1j * phases) * points
    values = np.fft.irfft(spectrum, points)
    before, after = np.roll(values, 1), np.roll(values, -1)
    peaks = theta[(values >= np.maximum(before, after)) | (values <= np.minimum(before, after))]
    for _ in range(3):
        angle = np.multiply.outer(peaks, k) + phases
        slope = np.cos(angle) @ (amplitudes * k)
        curvature = -np.sin(angle) @ (amplitudes * k**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(curvature != 0.0, -slope / curvature, 0.0)
        peaks = peaks + np.clip(step, -2.0 * np.pi / points, 2.0 * np.pi / points)
    refined = np.sin(np.multiply.outer(peaks, k) + phases) @ amplitudes
    both = np.concatenate([refined, values])
    return float(both.min()), float(both.max())

"""Continuous-time systems by zeros, poles and gain: the models of the instruments' filters."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.errors import BadInputError

Complex = NDArray[np.complex128]

# Denominator s^3 + 6 s^2 + 15 s + 15 of the Bessel filter with unit delay, and the frequency at
# which its magnitude is 1/sqrt(2): the root w of x^3 + 6 x^2 + 45 x - 225 = 0 in x = w^2.
_BESSEL_DENOMINATOR = (1.0, 6.0, 15.0, 15.0)
_BESSEL_CUT_OFF = 1.7556723686812107


@dataclass(frozen=True)
class LinearSystem:
    """
    A continuous-time system with one input and one output.

    H(s) = gain * product(s - zeros) / product(s - poles).

    Attributes
    ----------
    zeros, poles : tuple of complex
        Zeros and poles (rad/s); poles differ, and complex ones come in conjugate pairs.
    gain : float
        Factor in front.

    """

    zeros: tuple[complex, ...]
    poles: tuple[complex, ...]
    gain: float

    def __post_init__(self) -> None:
        """Refuse what the closed forms below do not cover."""
        if len(self.zeros) > len(self.poles):
            raise BadInputError("has more zeros than poles", where="linear system")
        for i, pole in enumerate(self.poles):
            if any(abs(pole - other) < 1e-6 * abs(pole) for other in self.poles[:i]):
                raise BadInputError("has coinciding poles", where="linear system", value=pole)

    def response(self, s: ArrayLike) -> Complex:
        """Return H at the complex frequencies `s` (rad/s)."""
        at = np.asarray(s, dtype=np.complex128)
        value = np.full(at.shape, self.gain, dtype=np.complex128)
        # one zero and one pole at a time: the products alone could overflow
        for i, pole in enumerate(self.poles):
            value = value / (at - pole)
            if i < len(self.zeros):
                value = value * (at - self.zeros[i])
        return value

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return H at frequencies (Hz)."""
        return self.response(2j * np.pi * np.asarray(frequency, dtype=np.float64))

    @property
    def delay(self) -> float:
        """Group delay (s) at low frequency."""
        poles = sum((1.0 / pole for pole in self.poles), 0j)
        zeros = sum((1.0 / zero for zero in self.zeros), 0j)
        return float((zeros - poles).real)

    @property
    def feedthrough(self) -> float:
        """Part of the input that reaches the output at once: H at infinite frequency."""
        return self.gain if len(self.zeros) == len(self.poles) else 0.0

    def residues(self) -> tuple[complex, ...]:
        """Return r_k of H(s) = feedthrough + sum of r_k / (s - p_k)."""
        result = []
        for k, pole in enumerate(self.poles):
            others = self.poles[:k] + self.poles[k + 1 :]
            value = complex(self.gain)
            for i, other in enumerate(others):
                value *= (pole - self.zeros[i] if i < len(self.zeros) else 1.0) / (pole - other)
            for zero in self.zeros[len(others) :]:
                value *= pole - zero
            result.append(value)
        return tuple(result)

    def __matmul__(self, other: LinearSystem) -> LinearSystem:
        """Return the two systems in series."""
        return LinearSystem(
            self.zeros + other.zeros, self.poles + other.poles, self.gain * other.gain
        )


def bessel_low_pass(cut_off_frequency: float) -> LinearSystem:
    """
    Return the third-order Bessel low-pass with -3 dB at the cut-off frequency (Hz).

    Its phase there is -99.5 degrees, its delay at low frequency 0.2794 / `cut_off_frequency`;
    amplitudes at 0.4 and 0.7 of the cut-off are 4.9 % and 14.8 % low.
    """
    scale = 2.0 * math.pi * cut_off_frequency / _BESSEL_CUT_OFF
    poles = tuple(complex(root) * scale for root in np.roots(_BESSEL_DENOMINATOR))
    return LinearSystem((), poles, _BESSEL_DENOMINATOR[-1] * scale**3)


def first_order_low_pass(cut_off_frequency: float) -> LinearSystem:
    """Return the first-order low-pass with -3 dB at the cut-off frequency (Hz)."""
    rate = 2.0 * math.pi * cut_off_frequency
    return LinearSystem((), (complex(-rate),), rate)


def first_order_high_pass(cut_off_frequency: float) -> LinearSystem:
    """Return the first-order high-pass with -3 dB at the cut-off frequency (Hz)."""
    return LinearSystem((0j,), (complex(-2.0 * math.pi * cut_off_frequency),), 1.0)


def resonator(resonance_frequency: float, damping_ratio: float) -> LinearSystem:
    """
    Return a mass on a spring: gain 1 at rest, one resonance.

    Parameters
    ----------
    resonance_frequency : float
        Undamped natural frequency (Hz).
    damping_ratio : float
        Share of critical damping, >= 0 and < 1.

    """
    omega = 2.0 * math.pi * resonance_frequency
    pole = omega * complex(-damping_ratio, math.sqrt(1.0 - damping_ratio**2))
    return LinearSystem((), (pole, pole.conjugate()), omega**2)

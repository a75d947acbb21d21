"""From a wanted rod motion to the drive voltage, section 6: inverse of a linear model, result."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.errors import BadInputError


def voltage_for_motion(
    motion: HarmonicMotion, response: Callable[[Any], Any]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """
    Return the harmonics of the voltage that gives a wanted rod motion.

    Parameters
    ----------
    motion : HarmonicMotion
        Wanted displacement of the rod.
    response : callable
        Complex displacement per volt (m/V) at frequencies (Hz), taken and returned as arrays.

    Returns
    -------
    amplitudes, phases : tuple of float
        Amplitudes (V) and sine phases (rad) in (-pi, pi], of harmonics 1, 2, ...

    Raises
    ------
    BadInputError
        If the response at a harmonic is zero or not finite: no voltage gives that motion.

    Notes
    -----
    Each harmonic by itself, u_k = x_k / H(k f_1), as section 6 of the paper describes: the
    linear step, which nonlinearities of the stator spoil and an iteration then mends.

    Examples
    --------
    >>> from imotor_ros.core.signals import sine
    >>> voltage_for_motion(sine(1e-6, 2000.0), lambda frequency: 0.0 * frequency + 0.2e-6j)
    ((5.0,), (-1.5707963267948966,))

    """
    orders = np.arange(1, motion.harmonics + 1)
    frequencies = orders * motion.fundamental_frequency
    gains = np.asarray(response(frequencies), dtype=np.complex128)
    for frequency, gain in zip(frequencies, gains, strict=True):
        if not cmath.isfinite(gain) or gain == 0.0:
            raise BadInputError(
                "does not let the rod move",
                where=f"response at {frequency:g} Hz",
                value=complex(gain),
                bound="a finite displacement per volt, not zero",
            )
    pairs = zip(motion.amplitudes, motion.phases, gains, strict=True)
    voltages = [a * cmath.exp(1j * p) / complex(gain) for a, p, gain in pairs]
    phases = (cmath.phase(voltage) for voltage in voltages)
    return (
        tuple(abs(voltage) for voltage in voltages),
        tuple(math.pi if phase == -math.pi else phase for phase in phases),
    )


@dataclass(frozen=True)
class Excitation:
    """
    The voltage for a motion, and how it was found.

    n is the number of harmonics wanted, m >= n that of those driven; all by harmonic.

    Attributes
    ----------
    fundamental_frequency : float
        Frequency (Hz) of the first harmonic.
    motion_amplitudes, motion_phases : tuple of float, length n
        Wanted displacement: amplitudes (m), sine phases (rad) with the cycles of the drive.
    response_gains, response_phases : tuple of float, length m
        Measured displacement per volt (m/V) and its phase (rad).
    linear_amplitudes, linear_phases : tuple of float, length n
        Voltage by the linear model: amplitudes (V), sine phases (rad).
    amplitudes, phases : tuple of float, length m
        Voltage as corrected.
    amplitude_errors, phase_errors : tuple of float, length n
        What is left, as measured: of the amplitudes (relative); of the first phase, and of the
        others relative to it (rad).
    uncertainties : tuple of float, length n
        Standard uncertainty of both by noise (relative; rad); calibration comes on top.
    unwanted_velocities : tuple of float, length m - n
        Velocity of the harmonics that are not wanted, over that of the largest wanted one.
    cycles : int
        Corrections made.
    largest_amplitude_errors, largest_phase_errors : tuple of float, length cycles + 1
        Largest errors with the linear model and after each correction.

    """

    fundamental_frequency: float
    motion_amplitudes: tuple[float, ...]
    motion_phases: tuple[float, ...]
    response_gains: tuple[float, ...]
    response_phases: tuple[float, ...]
    linear_amplitudes: tuple[float, ...]
    linear_phases: tuple[float, ...]
    amplitudes: tuple[float, ...]
    phases: tuple[float, ...]
    amplitude_errors: tuple[float, ...]
    phase_errors: tuple[float, ...]
    uncertainties: tuple[float, ...]
    unwanted_velocities: tuple[float, ...]
    cycles: int
    largest_amplitude_errors: tuple[float, ...]
    largest_phase_errors: tuple[float, ...]

    @property
    def harmonics(self) -> int:
        """Number of harmonics wanted."""
        return len(self.motion_amplitudes)

    def to_mapping(self) -> dict[str, Any]:
        """Return plain numbers, from which `from_mapping` makes an equal object."""
        return {
            one.name: list(value) if isinstance(value, tuple) else value
            for one in fields(self)
            for value in [getattr(self, one.name)]
        }

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> Excitation:
        """Make an excitation from what `to_mapping` returns."""
        values: dict[str, Any] = {
            one.name: tuple(map(float, value)) if isinstance(value, (list, tuple)) else value
            for one in fields(cls)
            for value in [mapping[one.name]]
        }
        return cls(**values)

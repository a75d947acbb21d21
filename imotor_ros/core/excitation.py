"""From a wanted rod motion to the drive voltage: the inverse of a linear model, section 6."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
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

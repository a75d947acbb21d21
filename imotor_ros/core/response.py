"""A measured frequency response: what was found, how sure it is, and its values in between."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.samples import Samples
from imotor_ros.errors import BadInputError

COMMAND = "command"
"""Reference of a response to the commanded voltage, not to a measured one."""

LEAST_COHERENCE = 0.9
"""Coherence below which a response is no basis for a voltage."""

_LISTS = ("frequencies", "amplitudes", "coherences", "uncertainties")


@dataclass(frozen=True)
class MeasuredResponse:
    """
    Rod displacement per volt at some frequencies.

    Attributes
    ----------
    method : str
        "stepped_sine" or "multisine".
    reference : str
        Channel of the voltage, or `COMMAND`.
    frequencies : tuple of float
        Frequencies (Hz), rising.
    gains : tuple of complex
        Displacement per volt (m/V).
    amplitudes : tuple of float
        Amplitude (V) of the sine at each frequency; of a multisine, its peak.
    coherences : tuple of float
        Share of the velocity's power that goes with the voltage, over the parts measured.
    uncertainties : tuple of float
        Standard uncertainty of real and of imaginary part, over the gain's magnitude, from the
        scatter between the parts.
    degrees_of_freedom : int
        Of these uncertainties.
    calibration_uncertainty : float
        Standard uncertainty of all magnitudes together (relative), by the channels' calibration.

    """

    method: str
    reference: str
    frequencies: tuple[float, ...]
    gains: tuple[complex, ...]
    amplitudes: tuple[float, ...]
    coherences: tuple[float, ...]
    uncertainties: tuple[float, ...]
    degrees_of_freedom: int
    calibration_uncertainty: float = 0.0

    @property
    def admittances(self) -> Complex:
        """Rod velocity per volt (m/s/V), shape (n,): the "mechanical admittance" of figure 5."""
        return np.asarray(2j * np.pi * np.array(self.frequencies) * np.array(self.gains))

    @property
    def half_widths(self) -> Samples:
        """
        Half widths of the 95 % confidence band, shape (n,).

        Of the magnitude, relative; and of the phase (rad), as they are alike for small ones. The
        common error of the calibration comes on top.
        """
        from scipy.special import stdtrit

        factor = float(stdtrit(self.degrees_of_freedom, 0.975))
        return np.asarray(factor * np.array(self.uncertainties))

    def __call__(self, frequency: ArrayLike) -> Complex:
        """
        Return the displacement per volt (m/V) at frequencies (Hz), shape (...).

        Between the points the inverse of the gain is interpolated by a parabola through the
        nearest three: for a single mode it is one.

        Raises
        ------
        BadInputError
            If a frequency is outside the measured range or where the coherence is too low.

        """
        at = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
        values = np.array([self._at(float(f)) for f in at.ravel()]).reshape(at.shape)
        return np.asarray(values.reshape(np.shape(frequency)))

    def _at(self, frequency: float) -> complex:
        measured = np.array(self.frequencies)
        low, high = measured[0], measured[-1]
        slack = 1e-9 * high
        if not low - slack <= frequency <= high + slack:
            raise BadInputError(
                "is outside the measured response",
                where="frequency",
                value=frequency,
                bound=f"{low:g} to {high:g} Hz",
            )
        nearest = np.sort(np.argsort(np.abs(measured - frequency), kind="stable")[:3])
        exact = int(np.argmin(np.abs(measured - frequency)))
        used = [exact] if abs(measured[exact] - frequency) <= slack else nearest.tolist()
        worst = min(used, key=lambda i: self.coherences[i])
        if not self.coherences[worst] >= LEAST_COHERENCE:
            raise BadInputError(
                "cannot be told from noise and distortion",
                where=f"response at {self.frequencies[worst]:g} Hz",
                value=f"a coherence of {self.coherences[worst]:.3f}",
                bound=f">= {LEAST_COHERENCE:g}",
            )
        inverse = 0j
        for i in used:
            weight = 1.0
            for j in used:
                if j != i:
                    weight *= (frequency - measured[j]) / (measured[i] - measured[j])
            inverse += weight / self.gains[i]
        return 1.0 / inverse

    def to_mapping(self) -> dict[str, Any]:
        """Return plain numbers, phases in rad, from which `from_mapping` makes an equal object."""
        admittances = self.admittances
        return {
            "method": self.method,
            "reference": self.reference,
            **{name: list(getattr(self, name)) for name in _LISTS},
            "gains": [abs(gain) for gain in self.gains],
            "phases": [math.atan2(gain.imag, gain.real) for gain in self.gains],
            "gain_parts": [[gain.real, gain.imag] for gain in self.gains],
            "admittance_magnitudes": np.abs(admittances).tolist(),
            "admittance_phases": np.angle(admittances).tolist(),
            "half_widths": self.half_widths.tolist(),
            "degrees_of_freedom": self.degrees_of_freedom,
            "calibration_uncertainty": self.calibration_uncertainty,
        }

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], where: str = "response") -> MeasuredResponse:
        """
        Make a response from what `to_mapping` returns.

        Raises
        ------
        BadInputError
            If something is missing or makes no sense.

        """
        try:
            response = cls(
                method=str(mapping["method"]),
                reference=str(mapping["reference"]),
                gains=tuple(complex(re, im) for re, im in mapping["gain_parts"]),
                degrees_of_freedom=int(mapping["degrees_of_freedom"]),
                calibration_uncertainty=float(mapping["calibration_uncertainty"]),
                **{name: tuple(float(x) for x in mapping[name]) for name in _LISTS},
            )
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"is no frequency response: {error!r}", where=where) from error
        counts = {len(response.gains), *(len(getattr(response, name)) for name in _LISTS)}
        if len(counts) != 1 or not response.gains:
            raise BadInputError("has lists of different lengths", where=where, value=sorted(counts))
        return response

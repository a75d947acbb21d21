"""From harmonics of velocity and voltage to a response with coherence and uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from imotor_ros.core.channel import ROD_VELOCITY, SampleFlag
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.response import COMMAND, MeasuredResponse
from imotor_ros.core.samples import Samples
from imotor_ros.core.trial import Recording
from imotor_ros.errors import BadInputError

_OVERLOAD = (
    SampleFlag.OVER_RANGE
    | SampleFlag.VOLTAGE_CLIPPED
    | SampleFlag.SLEW_LIMITED
    | SampleFlag.CURRENT_LIMITED
)


def refuse_overload(recording: Recording, *names: str) -> None:
    """
    Check that channels show what they should: no part of them clipped or limited.

    Parameters
    ----------
    recording : Recording
        What was measured.
    *names : str
        The channels.

    Raises
    ------
    BadInputError
        If one was over range, or the amplifier could not follow.

    """
    for name in names:
        flags = _overload(recording, name)
        if flags:
            found = ", ".join(str(flag.name).lower().replace("_", " ") for flag in flags)
            raise BadInputError(
                "cannot be used",
                where=f"{recording.program.run_id}: {name}",
                value=found,
                bound="a smaller amplitude, or a larger range of the instrument",
            )


def is_over_range(recording: Recording, name: str) -> bool:
    """Whether a channel was over range at some time."""
    return bool(_overload(recording, name) & SampleFlag.OVER_RANGE)


def _overload(recording: Recording, name: str) -> SampleFlag:
    return SampleFlag(recording.flags.get(name, 0)) & _OVERLOAD


def estimate_response(
    method: str,
    reference: str,
    frequencies: Sequence[float],
    velocity: Complex,
    voltage: Complex,
    amplitudes: Samples,
    recording: Recording,
) -> MeasuredResponse:
    """
    Return the response that harmonics show.

    Parameters
    ----------
    method, reference : str
        See `MeasuredResponse`.
    frequencies : sequence of float, length n
        Frequencies (Hz).
    velocity, voltage : ndarray of complex, shape (m, n)
        Harmonics of rod velocity (m/s) and voltage (V), part by part of what was measured.
    amplitudes : ndarray, shape (n,)
        Amplitudes (V) to note down.
    recording : Recording
        Where they come from.

    Notes
    -----
    Least squares over the parts, noise in the velocity alone: cross power over power.
    """
    cross = np.sum(velocity * voltage.conj(), axis=0)
    power = np.sum(np.abs(voltage) ** 2, axis=0)
    admittances = cross / power
    total = np.sum(np.abs(velocity) ** 2, axis=0)
    coherences = np.abs(cross) ** 2 / (power * np.maximum(total, np.finfo(float).tiny))
    count = len(velocity)
    scatter = np.sum(np.abs(velocity - admittances * voltage) ** 2, axis=0)
    spread = np.sqrt(scatter / (2.0 * (count - 1) * power))
    magnitudes = np.maximum(np.abs(admittances), np.finfo(float).tiny)
    calibration = [recording.channel(ROD_VELOCITY)[1].gain_uncertainty]
    if reference != COMMAND:
        calibration.append(recording.channel(reference)[1].gain_uncertainty)
    gains = admittances / (2j * np.pi * np.asarray(frequencies))
    return MeasuredResponse(
        method=method,
        reference=reference,
        frequencies=tuple(map(float, frequencies)),
        gains=tuple(complex(gain) for gain in gains),
        amplitudes=tuple(float(size) for size in amplitudes),
        coherences=tuple(float(value) for value in np.minimum(coherences, 1.0)),
        uncertainties=tuple(float(value) for value in spread / magnitudes),
        degrees_of_freedom=2 * (count - 1),
        calibration_uncertainty=math.hypot(*calibration),
    )

"""What the tests of the core share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]


@pytest.fixture(scope="session")
def measured_gain() -> Callable[..., complex]:
    """A probe: output over input of anything that processes a stream, by one sine."""
    return _measured_gain


def _measured_gain(
    process: Callable[[Array], Array],
    frequency: float,
    sample_rate: float,
    *,
    amplitude: float = 1.0,
    settling_time: float = 2e-4,
) -> complex:
    """
    Return output over input of `process` at one frequency (Hz) once it has settled.

    Sine, cosine, offset and slope are fitted to 20 periods after the settling time (s).
    """
    skipped = round(settling_time * sample_rate)
    count = skipped + round(20 * sample_rate / frequency)
    angle = 2.0 * np.pi * frequency * np.arange(count) / sample_rate
    output = process(amplitude * np.sin(angle))[skipped:]
    angle = angle[skipped:]
    columns = [np.sin(angle), np.cos(angle), np.ones_like(angle), angle - angle.mean()]
    in_phase, quadrature, _, _ = np.linalg.lstsq(np.column_stack(columns), output, rcond=None)[0]
    return complex(in_phase, quadrature) / amplitude

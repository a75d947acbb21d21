"""The digitiser: step size, rounding and the ends of its range."""

import numpy as np
import pytest

from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.digitiser import Digitiser, DigitiserParameters


@pytest.mark.parametrize("bits", [4, 12, 16, 24])
def test_digitiser_is_never_off_by_more_than_half_a_step(bits: int) -> None:
    digitiser = Digitiser(DigitiserParameters(bits=bits), 5.0)
    assert digitiser.resolution == 10.0 / 2**bits
    values = np.linspace(-5.0, 5.0 - digitiser.resolution, 9973)
    rounded, flags = digitiser.process(values)
    # a few units of rounding on top of half a step
    assert np.abs(rounded - values).max() <= 0.5 * digitiser.resolution + 1e-14
    counts = rounded / digitiser.resolution
    assert np.array_equal(counts, np.rint(counts))
    assert flags == SampleFlag(0)


def test_digitiser_shows_zero_as_zero() -> None:
    """Mid-tread: what is below half a step vanishes, of either sign."""
    digitiser = Digitiser(DigitiserParameters(bits=8), 1.0)
    small = 0.49 * digitiser.resolution
    assert np.array_equal(digitiser.process(np.array([-small, 0.0, small]))[0], np.zeros(3))


def test_digitiser_clips_at_the_ends_of_its_range() -> None:
    digitiser = Digitiser(DigitiserParameters(bits=8), 1.0)
    for value, shown in ((1.0, 127 / 128), (3.0, 127 / 128), (-1.01, -1.0)):
        clipped, flags = digitiser.process(np.array([0.0, value]))
        assert clipped[1] == shown
        assert flags == SampleFlag.OVER_RANGE
    assert digitiser.process(np.array([-1.0, 127 / 128]))[1] == SampleFlag(0)


def test_digitiser_adds_the_noise_of_its_steps() -> None:
    """A signal over many steps: rms error is a step over the square root of 12."""
    digitiser = Digitiser(DigitiserParameters(bits=12), 1.0)
    values = 0.9 * np.sin(np.arange(100_000) * 0.7)
    error = digitiser.process(values)[0] - values
    assert error.std() == pytest.approx(digitiser.resolution / np.sqrt(12.0), rel=0.02)

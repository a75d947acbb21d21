"""Reading between samples: a known signal, at positions where it was not sampled."""

from __future__ import annotations

import numpy as np
import pytest

from imotor_ros.core.alignment import AFTER, BEFORE, compensate_delay, interpolate
from imotor_ros.errors import BadInputError

RATE = 1e6


# The bounds are those of the table in the module's docstring; rounding adds a few 1e-15.
@pytest.mark.parametrize(
    ("frequency", "bound"), [(18.5e3, 1e-14), (100e3, 2e-9), (200e3, 5e-5), (250e3, 2e-3)]
)
def test_interpolation_error_of_a_sine_is_within_the_stated_bound(
    frequency: float, bound: float
) -> None:
    samples = np.exp(2j * np.pi * frequency / RATE * np.arange(400))
    positions = 100.0 + 0.37 * np.arange(400)
    wanted = np.exp(2j * np.pi * frequency / RATE * positions)
    read = interpolate(samples.real, 100.0, 0.37, 400) + 1j * interpolate(
        samples.imag, 100.0, 0.37, 400
    )
    error = np.max(np.abs(read - wanted))
    # rounding of the positions and of the samples themselves: 400 samples, a few 1e-14
    assert error < bound + 3e-14
    if frequency >= 100e3:
        assert error > 0.2 * bound, "the bound is stated too generously"


def test_interpolation_is_exact_for_polynomials_of_degree_fifteen() -> None:
    x = np.linspace(-1.0, 1.0, 40)
    polynomial = np.polynomial.Polynomial(np.random.default_rng(1).standard_normal(16))
    step = x[1] - x[0]
    read = interpolate(polynomial(x), 10.3, 1.0, 15)
    wanted = polynomial(x[0] + step * (10.3 + np.arange(15)))
    # the largest Lagrange weight is below 1, values are below 16
    np.testing.assert_allclose(read, wanted, rtol=0, atol=1e-13)


def test_interpolation_returns_samples_at_whole_positions() -> None:
    samples = np.random.default_rng(2).standard_normal(50)
    np.testing.assert_array_equal(interpolate(samples, 10.0, 1.0, 20), samples[10:30])


def test_interpolation_is_nan_where_neighbours_are_missing() -> None:
    samples = np.arange(40.0)
    read = interpolate(samples, 0.5, 1.0, 40)
    is_there = ~np.isnan(read)
    assert np.flatnonzero(is_there)[0] == BEFORE
    assert np.flatnonzero(is_there)[-1] == 40 - AFTER - 1
    np.testing.assert_allclose(read[is_there], np.arange(40.0)[is_there] + 0.5, atol=1e-12)


def test_interpolation_of_too_few_samples_is_all_nan() -> None:
    assert np.isnan(interpolate(np.ones(BEFORE + AFTER), 0.5, 0.25, 60)).all()


def test_delay_is_taken_out() -> None:
    time = np.arange(2000) / RATE
    delay = 6.8e-6
    wanted = np.sin(2 * np.pi * 18.5e3 * time)
    aligned = compensate_delay(np.sin(2 * np.pi * 18.5e3 * (time - delay)), delay, RATE)
    inside = ~np.isnan(aligned)
    assert inside.sum() > 1970
    # 6.8 us uncompensated would be 45 degrees
    np.testing.assert_allclose(aligned[inside], wanted[inside], rtol=0, atol=1e-12)


@pytest.mark.parametrize("step", [0.0, -1.0, np.nan])
def test_interpolation_refuses_a_step_that_is_not_positive(step: float) -> None:
    with pytest.raises(BadInputError, match="step > 0"):
        interpolate(np.ones(40), 10.0, step, 5)


def test_interpolation_refuses_nan_samples() -> None:
    with pytest.raises(BadInputError, match="not finite"):
        interpolate(np.array([1.0, np.nan]), 0.0, 1.0, 1)

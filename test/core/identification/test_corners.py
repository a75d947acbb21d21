"""Velocities with corners from their first harmonics: exact, unbiased, with the right noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.friction import CoulombFriction, StribeckFriction, VelocityDependentFriction
from imotor_ros.core.identification.corners import (
    TURN,
    fit_corners,
    fit_crossings,
    fit_smooth,
)

MASS = 6.92e-3
NOISE = 5e-6
"""Standard deviation of phasor parts (m/s) of a head with 0.5 um/s/sqrt(Hz) over 14 ms."""


def triangle(count: int, phase: float = 0.3) -> NDArray[np.complex128]:
    """Return the phasors of a triangle between -1 and 1, its tips at `phase` and opposite."""
    k = np.arange(1, count + 1)
    return np.where(k % 2 == 1, 8.0 / (np.pi * k) ** 2, 0.0) * np.exp(-1j * k * phase)


@pytest.mark.parametrize("count", [5, 13, 25])
def test_triangle_is_found_exactly(count: int) -> None:
    """The tip lies beyond what the harmonics reach: 1 - 0.4 / count of its height."""
    fit = fit_corners(triangle(count), 1e-9, 1)
    assert fit.total_variation == pytest.approx(4.0, rel=1e-9)
    assert np.sort(fit.corners) == pytest.approx([0.3, 0.3 + np.pi], abs=1e-8)
    assert np.abs(fit.slope_jumps) == pytest.approx([4.0 / np.pi, 4.0 / np.pi], rel=1e-6)
    cut = fit_smooth(triangle(count), 1e-9, count)
    assert cut.total_variation < 4.0 * (1.0 - 0.3 / count)


@pytest.mark.parametrize("slope", [0.0, 2.213, 20.0])
@pytest.mark.parametrize(("frequency", "count", "free"), [(2000.0, 25, 5), (5000.0, 10, 3)])
@pytest.mark.parametrize("amplitude", [1.9, 3.0, 8.7])
def test_sliding_force_is_unbiased(
    true_period: Callable[..., Any],
    slope: float,
    frequency: float,
    count: int,
    free: int,
    amplitude: float,
) -> None:
    """
    Where the slider slides all the time, m mean |a_S| = mean F, to 1e-4.

    The amplitude is that over the one at which Coulomb friction breaks away. What is left is the
    jump of the next derivative, of which a slope of 20 N s/m makes the most.
    """
    law = VelocityDependentFriction(sliding_force=0.94, slope=slope)
    size = amplitude * 0.94 / MASS / (TURN * frequency) ** 2
    truth = true_period(law, size * (1.0 + 0.02 * slope), frequency, count)
    assert truth.stick_share == 0.0
    fit = fit_corners(truth.slider, NOISE, free)
    assert MASS * frequency * fit.total_variation == pytest.approx(truth.force, rel=1e-4)


@pytest.mark.parametrize("amplitude", [1.2e-6, 1.5e-6])
@pytest.mark.parametrize("law", [CoulombFriction(), VelocityDependentFriction()])
def test_force_is_nearly_unbiased_where_the_slider_sticks_for_a_while(
    true_period: Callable[..., Any], law: Any, amplitude: float
) -> None:
    """Breaking away makes kinks that the model leaves to its free harmonics: 0.5 % at most."""
    truth = true_period(law, amplitude, 2000.0)
    assert 0.0 < truth.stick_share < 1.0
    fit = fit_corners(truth.slider, NOISE, 5)
    assert MASS * 2000.0 * fit.total_variation == pytest.approx(truth.force, rel=5e-3)


@pytest.mark.parametrize("decay_velocity", [2e-3, 5e-3, 20e-3])
def test_peak_of_stribeck_friction_is_resolved_in_part(
    true_period: Callable[..., Any], decay_velocity: float
) -> None:
    """Its force peak passes in microseconds: up to 0.6 % of the force are missed, never more."""
    law = StribeckFriction(decay_velocity=decay_velocity)
    errors = []
    for amplitude in (2.5e-6, 4e-6, 8e-6):
        truth = true_period(law, amplitude, 2000.0)
        fit = fit_corners(truth.slider, NOISE, 5)
        errors.append(MASS * 2000.0 * fit.total_variation / truth.force - 1.0)
    assert max(map(abs, errors)) < 6e-3
    assert min(errors) < -1e-3, "the bias is real, and stated in the docs"


def test_noise_leaves_no_bias_and_is_told(true_period: Callable[..., Any]) -> None:
    """200 draws: mean within 4 of its standard deviations, scatter within 15 % of that stated."""
    truth = true_period(VelocityDependentFriction(), 4e-6, 2000.0)
    draws = np.random.default_rng(1)
    found, told, misfits = [], [], []
    for _ in range(200):
        noise = NOISE * (draws.standard_normal(25) + 1j * draws.standard_normal(25))
        fit = fit_corners(truth.slider + noise, NOISE, 5)
        found.append(MASS * 2000.0 * fit.total_variation / truth.force - 1.0)
        told.append(MASS * 2000.0 * fit.total_variation_noise / truth.force)
        misfits.append(fit.misfit)
    scatter = float(np.std(found))
    assert scatter < 1.5e-3
    assert abs(np.mean(found)) < 4.0 * scatter / np.sqrt(200)
    assert np.mean(told) == pytest.approx(scatter, rel=0.15)
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.1)


def test_corners_too_close_to_be_told_apart_share_one_jump() -> None:
    """Up and down six times, as under a rod that rings: corners within 20 us at 2 kHz."""
    corners = np.array([1.0, 1.2, 1.45])
    corners = np.concatenate([corners, corners + np.pi])
    signs = np.resize([-1.0, 1.0], 6)
    k = np.arange(1, 26)
    phasors = sum(
        s * 2.0 * np.exp(-1j * k * c) / (1j * k) ** 2 for s, c in zip(signs, corners, strict=True)
    )
    exact = np.pi * TURN  # the slope is +-pi everywhere, over one turn
    fit = fit_crossings(np.asarray(phasors), 1e-6, 5, corners)
    assert fit.total_variation == pytest.approx(exact, rel=1e-6)
    assert len(fit.turning_points) == 6


def test_waveform_with_given_noise_is_the_same_wherever_the_period_starts(
    true_period: Callable[..., Any],
) -> None:
    truth = true_period(VelocityDependentFriction(), 4e-6, 2000.0)
    k = np.arange(1, 26)
    forces = [
        fit_corners(truth.slider * np.exp(1j * k * shift), NOISE, 5).total_variation
        for shift in np.linspace(0.0, TURN, 7)
    ]
    assert forces == pytest.approx([forces[0]] * 7, rel=1e-6)

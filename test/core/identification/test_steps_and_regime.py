"""What a step tells, against closed forms for a sine and Coulomb friction."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from imotor_ros.core.friction import CoulombFriction, StribeckFriction, VelocityDependentFriction
from imotor_ros.core.identification.harmonics import Harmonics
from imotor_ros.core.identification.regime import BOTH, SLIDES, STICKS, classify, find_agreement
from imotor_ros.core.identification.stepped_sine import RISING, DriveStep
from imotor_ros.core.identification.steps import (
    StepMeasurement,
    free_harmonics,
    harmonic_count,
    measure_step,
)
from imotor_ros.core.signals import HarmonicMotion

FREQUENCY, MASS, NOISE = 2000.0, 6.92e-3, 5e-6
OMEGA = 2.0 * math.pi * FREQUENCY
FORCE = 1.01
BREAK = FORCE / MASS / OMEGA**2
"""Amplitude (m) at which a slider with Coulomb friction breaks away: 0.92 um."""


def measured(
    truth: Any, *, gain: float = 1.0, noise: float = NOISE, seed: int = 0
) -> StepMeasurement:
    """Measure a true period; `gain` is that of the slider's head, seed 0 leaves the noise out."""
    draws = np.random.default_rng(seed)
    parts = []
    for phasors, factor in ((truth.rod, 1.0), (truth.slider, gain)):
        drawn = draws.standard_normal((2, phasors.size)) if seed else np.zeros((2, phasors.size))
        parts.append(
            Harmonics(0.0, factor * phasors + noise * (drawn[0] + 1j * drawn[1]), noise, 0j, 27)
        )
    return measure_step(DriveStep(1, RISING, 0, 1), FREQUENCY, *parts)


def test_sticking_slider_moves_as_the_rod(true_period: Callable[..., Any]) -> None:
    """Mean |a| of a sine is 2 / pi of its peak; below 0.92 um nothing slides."""
    one = measured(true_period(CoulombFriction(), 0.6e-6, FREQUENCY))
    assert one.rod_amplitude == pytest.approx(0.6e-6, rel=1e-6)
    assert one.mean_acceleration == pytest.approx(2.0 / math.pi * 0.6e-6 * OMEGA**2, rel=1e-4)
    assert one.mean_slider_speed == pytest.approx(2.0 / math.pi * 0.6e-6 * OMEGA, rel=1e-4)
    assert one.mean_relative_speed < 1e-6
    assert one.phase == pytest.approx(0.0, abs=1e-6)
    assert one.amplitude_ratio == pytest.approx(1.0, abs=1e-6)
    assert one.excess_harmonic < 1e-6


def test_sliding_slider_moves_as_a_triangle(true_period: Callable[..., Any]) -> None:
    """Coulomb: |a| = F / m; harmonics of a triangle, 1/9, 1/25, ...; lag by its corner's phase."""
    one = measured(true_period(CoulombFriction(), 4e-6, FREQUENCY))
    assert MASS * one.mean_acceleration == pytest.approx(FORCE, rel=1e-5)
    # a triangle of height a T / 4 has half of it as mean
    assert one.mean_slider_speed == pytest.approx(FORCE / MASS / FREQUENCY / 8.0, rel=1e-4)
    assert one.odd_harmonics[:3] == pytest.approx([1 / 9, 1 / 25, 1 / 49], rel=1e-4)
    # rod velocity equals the triangle's tip at the corner: cos(phase) = pi/2 BREAK / A
    assert one.phase == pytest.approx(math.acos(math.pi / 2.0 * BREAK / 4e-6), abs=1e-4)
    assert one.rising_share == pytest.approx(0.5, abs=1e-3)


def test_relative_speed_is_the_exact_one(true_period: Callable[..., Any]) -> None:
    truth = true_period(VelocityDependentFriction(), 2.5e-6, FREQUENCY)
    one = measured(truth)
    assert one.mean_relative_speed == pytest.approx(truth.mean_relative_speed, rel=1e-4)
    assert one.relative_speeds().mean() == pytest.approx(one.mean_relative_speed, rel=1e-6)


@pytest.mark.parametrize("gain", [1.0, 1.014])
@pytest.mark.parametrize("seed", [1, 2])
def test_regime_of_coulomb_friction(
    true_period: Callable[..., Any], gain: float, seed: int
) -> None:
    """Sticks up to BREAK, slides all the time from sqrt(1 + pi^2/4) BREAK, whatever the heads."""
    shares = (0.2, 0.5, 0.8, 0.98, 1.06, 1.2, 1.5, 1.8, 2.0, 2.5, 5.0, 8.5)
    steps = [
        measured(true_period(CoulombFriction(), k * BREAK, FREQUENCY), gain=gain, seed=seed + i)
        for i, k in enumerate(shares)
    ]
    agreement = find_agreement(steps)
    found = [classify(one, agreement) for one in steps]
    assert found == [STICKS] * 4 + [BOTH] * 4 + [SLIDES] * 4
    assert abs(agreement.ratio) == pytest.approx(gain, abs=5.0 * agreement.uncertainty)


def test_crossing_margin_is_the_rod_s_acceleration_over_friction(
    true_period: Callable[..., Any],
) -> None:
    """At the corner the rod's acceleration is A w^2 sin(phase), friction gives F / m."""
    for share in (2.0, 4.0):
        one = measured(true_period(CoulombFriction(), share * BREAK, FREQUENCY))
        exact = share * math.sin(one.phase) * np.sinc(1.0 / 25.0)
        assert one.crossing_margin == pytest.approx(exact, rel=1e-3)


def test_regime_with_a_peak_of_force_at_low_speed(true_period: Callable[..., Any]) -> None:
    law = StribeckFriction()
    amplitudes = (0.5e-6, 0.9e-6, 1.4e-6, 1.6e-6, 2.2e-6, 4e-6)
    truths = [true_period(law, one, FREQUENCY) for one in amplitudes]
    steps = [measured(one, seed=3 + i) for i, one in enumerate(truths)]
    agreement = find_agreement(steps)
    assert [classify(one, agreement) for one in steps] == [STICKS] * 2 + [BOTH] * 2 + [SLIDES] * 2


def test_without_a_step_that_sticks_heads_are_taken_to_agree(
    true_period: Callable[..., Any],
) -> None:
    steps = [measured(true_period(CoulombFriction(), k * BREAK, FREQUENCY)) for k in (3.0, 5.0)]
    agreement = find_agreement(steps)
    assert (agreement.ratio, agreement.steps) == (1.0, 0)


def test_ringing_rod_overtakes_the_slider_more_than_twice(
    true_period: Callable[..., Any],
) -> None:
    """A rod that rings at its 18th harmonic: more corners, and still the right force."""
    orders = np.zeros(18)
    orders[0], orders[17] = 2.9e-6, 0.05e-6
    motion = HarmonicMotion(FREQUENCY, tuple(orders), (0.0,) * 18)
    law = VelocityDependentFriction()
    truth = true_period(law, motion)
    assert truth.stick_share == 0.0
    one = measured(truth, seed=5)
    assert one.slider.corners.size > 2
    deviation = one.mean_acceleration_noise / one.mean_acceleration
    assert MASS * one.mean_acceleration == pytest.approx(truth.force, rel=3e-3 + 4.0 * deviation)
    assert one.mean_relative_speed == pytest.approx(truth.mean_relative_speed, rel=2e-3)
    assert classify(one, find_agreement([one])) == SLIDES


@pytest.mark.parametrize(
    ("frequency", "bandwidth", "rate", "count"),
    [(2000.0, 1e5, 1e6, 25), (2000.0, 0.0, 1e5, 10), (500.0, 1e5, 1e6, 40), (2e4, 1e5, 1e6, 2)],
)
def test_harmonics_stay_within_half_the_bandwidth(
    frequency: float, bandwidth: float, rate: float, count: int
) -> None:
    assert harmonic_count(frequency, bandwidth, rate) == count


def test_model_keeps_degrees_of_freedom() -> None:
    """Two numbers per harmonic against free ones, four jumps and two corners."""
    for count in range(5, 41):
        assert 2 * count - 2 * free_harmonics(count) - 6 >= 2

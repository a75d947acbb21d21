"""Friction laws fitted to steps that are known exactly, and to noisy ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from imotor_ros.core.friction import (
    CoulombFriction,
    FrictionLaw,
    StribeckFriction,
    VelocityDependentFriction,
)
from imotor_ros.core.identification.fits import (
    Bootstrap,
    SlidingSteps,
    choose,
    fit_law,
    fit_laws,
    mean_difference,
)

FAST = Bootstrap(draws=200)


def sliding_steps(law: FrictionLaw, scatter: float = 0.0, seed: int = 1) -> SlidingSteps:
    """Return 60 steps whose speeds are those of a sine, with the law's exact mean forces."""
    phase = np.abs(np.sin(np.linspace(0.0, np.pi, 400, endpoint=False)))
    speeds = np.outer(np.tile(np.linspace(0.016, 0.1, 30), 2), phase)
    forces = law.force(speeds).mean(axis=1)
    noise = scatter * np.random.default_rng(seed).standard_normal(forces.size)
    return SlidingSteps(speeds, forces + noise)


@pytest.mark.parametrize("law", [CoulombFriction(), VelocityDependentFriction()])
def test_straight_laws_are_found_exactly(law: FrictionLaw) -> None:
    fit = fit_law("velocity", sliding_steps(law), FAST)
    assert fit.estimates["sliding_force"].value == pytest.approx(law.numbers.force, rel=1e-9)
    assert fit.estimates["slope"].value == pytest.approx(law.numbers.slope, abs=1e-8)


def test_curved_law_is_averaged_over_the_speeds_of_a_step() -> None:
    """The mean force is not the force at the mean speed: taking it so would be 4 % off."""
    law = StribeckFriction(decay_velocity=15e-3)
    steps = sliding_steps(law)
    assert np.abs(law.force(steps.mean_speeds) / steps.forces - 1.0).max() > 0.03
    fit = fit_law("stribeck", steps, FAST)
    # the grid of decay velocities has steps of 4 %
    assert fit.scatter < 3e-4
    assert fit.estimates["sliding_force"].value == pytest.approx(0.94, rel=2e-3)
    assert fit.estimates["static_force"].value == pytest.approx(1.2, rel=5e-3)
    assert fit.estimates["slope"].value == pytest.approx(2.213, rel=5e-3)
    assert fit.estimates["decay_velocity"].value == pytest.approx(15e-3, rel=0.03)


@pytest.mark.parametrize(
    ("law", "name"),
    [
        (CoulombFriction(), "coulomb"),
        (VelocityDependentFriction(), "velocity"),
        (StribeckFriction(decay_velocity=15e-3), "stribeck"),
    ],
)
def test_criterion_chooses_the_true_law(law: FrictionLaw, name: str) -> None:
    """19 of 20 noisy runs at least: by chance a law with one more parameter wins once in 70."""
    chosen = [choose(fit_laws(sliding_steps(law, 8e-4, k), FAST)).law for k in range(20)]
    assert chosen.count(name) >= 19


def test_fits_load_as_laws() -> None:
    fits = fit_laws(sliding_steps(StribeckFriction(decay_velocity=15e-3), 8e-4), FAST)
    speeds = np.linspace(0.0, 0.1, 50)
    for fit in fits.values():
        law = fit.friction
        assert isinstance(law, FrictionLaw)
        zero = fit.estimates["zero_speed_force"].value
        assert law.force(speeds)[0] == pytest.approx(zero)
        assert law.break_away == pytest.approx(zero)


def test_falling_line_is_no_law() -> None:
    steps = sliding_steps(CoulombFriction(), 8e-4)
    falling = SlidingSteps(steps.speeds, steps.forces - 0.5 * steps.mean_speeds)
    fits = fit_laws(falling, FAST)
    assert "falls" in fits["velocity"].remark
    assert choose(fits).law != "velocity"


@pytest.mark.parametrize("name", ["sliding_force", "slope"])
def test_intervals_hold_the_truth_as_often_as_they_say(name: str) -> None:
    """300 runs: 95 % with a standard deviation of 1.3 %."""
    truth = {"sliding_force": 0.94, "slope": 2.213}[name]
    steps = [sliding_steps(VelocityDependentFriction(), 8e-4, k) for k in range(300)]
    fits = [fit_law("velocity", one, Bootstrap(300, seed=k)) for k, one in enumerate(steps)]
    share = np.mean([fit.estimates[name].holds(truth) for fit in fits])
    assert 0.91 <= share <= 0.98


def test_bootstrap_depends_on_its_seed_only() -> None:
    steps = sliding_steps(VelocityDependentFriction(), 8e-4)
    first, again, other = (
        fit_law("velocity", steps, Bootstrap(draws=100, seed=k)).estimates["slope"]
        for k in (1, 1, 2)
    )
    assert first == again
    assert first != other


def test_difference_of_branches() -> None:
    """Welch: the interval of a difference of means with unequal scatter."""
    draws = np.random.default_rng(2)
    hits = 0
    for _ in range(400):
        first, second = draws.normal(1.0, 1.0, 12), draws.normal(0.0, 3.0, 20)
        hits += mean_difference(first, second).holds(1.0)
    assert hits / 400 == pytest.approx(0.95, abs=0.04)
    same = mean_difference(np.ones(5), np.ones(5))
    assert (same.value, same.low, same.high) == (0.0, 0.0, 0.0)
    assert math.isfinite(same.high)

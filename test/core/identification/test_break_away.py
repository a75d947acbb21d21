"""The break-away force from the transition between sticking and sliding."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from imotor_ros.core.friction import CoulombFriction, StribeckFriction, VelocityDependentFriction
from imotor_ros.core.identification.break_away import (
    Transition,
    estimate_break_away,
    rod_motion,
)
from imotor_ros.core.identification.harmonics import Harmonics
from imotor_ros.core.identification.regime import classify, find_agreement
from imotor_ros.core.identification.stepped_sine import RISING, DriveStep
from imotor_ros.core.identification.steps import measure_step
from imotor_ros.core.signals import HarmonicMotion

FREQUENCY, MASS, NOISE = 2000.0, 6.92e-3, 5e-6
AMPLITUDES = tuple(np.arange(0.3, 3.1, 0.15) * 1e-6)


@pytest.fixture
def transition(true_period: Callable[..., Any]) -> Callable[..., Transition]:
    """Return a function that measures steps under a law."""

    def make(
        law: Any,
        slope: float,
        amplitudes: tuple[float, ...] = AMPLITUDES,
        gains: tuple[float, float] = (1.0, 1.0),
        seed: int = 1,
    ) -> Transition:
        draws = np.random.default_rng(seed)
        steps = []
        for number, amplitude in enumerate(amplitudes, 1):
            truth = true_period(law, amplitude, FREQUENCY)
            parts = []
            for phasors, gain in zip((truth.rod, truth.slider), gains, strict=True):
                noise = draws.standard_normal((2, phasors.size))
                noisy = gain * phasors + NOISE * (noise[0] + 1j * noise[1])
                parts.append(Harmonics(0.0, noisy, NOISE, 0j, 27))
            steps.append(measure_step(DriveStep(number, RISING, 0, 1), FREQUENCY, *parts))
        agreement = find_agreement(steps)
        regimes = [classify(one, agreement) for one in steps]
        return Transition(steps, regimes, agreement, FREQUENCY, MASS, slope)

    return make


@pytest.mark.parametrize(
    ("law", "slope", "force"),
    [
        (CoulombFriction(), 0.0, 1.01),
        (VelocityDependentFriction(), 2.213, 0.94),
        (VelocityDependentFriction(break_away_force=1.1), 2.213, 1.1),
        (VelocityDependentFriction(break_away_force=1.3), 2.213, 1.3),
    ],
)
def test_break_away_force_is_found(
    transition: Callable[..., Transition], law: Any, slope: float, force: float
) -> None:
    """Within 0.3 %; within 1.5 % where it is larger than the sliding force, and told from it."""
    found = estimate_break_away(transition(law, slope))
    assert found.force is not None, found.reason
    is_larger = law.break_away_force > 0.0
    assert found.force.value == pytest.approx(force, rel=0.015 if is_larger else 0.003)
    assert found.force.low < force * 1.005
    assert found.force.high > force * 0.995
    assert found.sliding_force == pytest.approx(law.numbers.force, rel=0.02)
    assert found.highest_sticking < force < found.lowest_slipping
    assert found.is_clear


def test_force_scales_with_the_rod_s_head_alone(transition: Callable[..., Transition]) -> None:
    """What the slider's head shows differently while it sticks is taken out."""
    values = []
    for gains in ((1.0, 1.0), (1.0, 1.02), (1.02, 1.0)):
        found = estimate_break_away(transition(CoulombFriction(), 0.0, gains=gains))
        assert found.force is not None, found.reason
        values.append(found.force.value)
    assert values[1] / values[0] == pytest.approx(1.0, abs=2e-3)
    assert values[2] / values[0] == pytest.approx(1.02, abs=2e-3)


def test_other_contacts_end_in_a_reason(transition: Callable[..., Transition]) -> None:
    """A Stribeck law does not slide at one force at low speed: bounds, but no number."""
    found = estimate_break_away(transition(StribeckFriction(), 2.213))
    assert found.force is None
    assert "does not move as one that breaks away" in found.reason
    assert found.highest_sticking < 1.2 < found.lowest_slipping


@pytest.mark.parametrize(
    ("amplitudes", "reason"),
    [
        ((3e-6, 4e-6, 5e-6), "no step sticks"),
        ((0.2e-6, 0.4e-6, 0.6e-6), "no step slides"),
        ((0.3e-6, 0.6e-6, 1.3e-6, 3e-6, 4e-6), "take smaller steps"),
    ],
)
def test_steps_that_miss_the_transition_end_in_a_reason(
    transition: Callable[..., Transition], amplitudes: tuple[float, ...], reason: str
) -> None:
    found = estimate_break_away(transition(CoulombFriction(), 0.0, amplitudes))
    assert found.force is None
    assert reason in found.reason
    assert math.isnan(found.sliding_force)


def test_distorted_rod_motion_is_remarked(true_period: Callable[..., Any]) -> None:
    """Peaks of acceleration break the slider loose for moments that are not seen."""
    ringing = np.zeros(18)
    steps = []
    for number, amplitude in enumerate(AMPLITUDES, 1):
        ringing[0], ringing[16] = amplitude, 1.5e-3 * amplitude
        motion = HarmonicMotion(FREQUENCY, tuple(ringing), (0.0,) * 18)
        truth = true_period(CoulombFriction(), motion)
        parts = [Harmonics(0.0, one, NOISE, 0j, 27) for one in (truth.rod, truth.slider)]
        steps.append(measure_step(DriveStep(number, RISING, 0, 1), FREQUENCY, *parts))
    agreement = find_agreement(steps)
    regimes = [classify(one, agreement) for one in steps]
    found = estimate_break_away(Transition(steps, regimes, agreement, FREQUENCY, MASS, 0.0))
    assert found.distortion > 1.25
    assert not found.is_clear
    assert found.remark or found.reason


def test_measured_rod_motion_without_its_noise(transition: Callable[..., Transition]) -> None:
    one = transition(CoulombFriction(), 0.0, (2e-6, 3e-6)).measurements[0]
    motion = rod_motion(one, FREQUENCY)
    assert motion.harmonics == 1
    assert motion.amplitudes[0] == pytest.approx(2e-6, rel=1e-3)
    time = np.linspace(0.0, 5e-4, 7)
    exact = 2e-6 * np.sin(2.0 * np.pi * FREQUENCY * time)
    assert motion.position(time) == pytest.approx(exact, abs=2e-9)

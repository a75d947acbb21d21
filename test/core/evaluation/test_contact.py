"""Contact: found where it is, not found where there is none, and never by a single glitch."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.contact import ContactCriteria, find_baseline, find_contact

Array = NDArray[np.float64]

CRITERIA = ContactCriteria(threshold=0.006, persistence=3, first=1)


def velocity(contact: int | None, rows: int = 120, noise: float = 1e-4, seed: int = 0) -> Array:
    """Period means of a slider that starts within ten periods and stops at `contact`."""
    values = 0.05 * (1.0 - np.exp(-np.arange(rows) / 3.0))
    if contact is not None:
        values[contact:] = 0.0
    return values + noise * np.random.default_rng(seed).standard_normal(rows)


def force(contact: int | None, rows: int = 120, noise: float = 1e-3, seed: int = 1) -> Array:
    """Period means of a load force that rises from `contact` on."""
    values = np.zeros(rows)
    if contact is not None:
        values[contact:] = 0.3 * (1.0 - np.exp(-np.arange(1, rows - contact + 1) / 2.0))
    return values + noise * np.random.default_rng(seed).standard_normal(rows)


@pytest.mark.parametrize("contact", [15, 60, 110])
def test_contact_is_found_from_force(contact: int) -> None:
    found = find_contact(velocity(contact), force(contact), CRITERIA)
    assert found.row == contact
    assert found.is_seen_by_force
    assert not found.warning


@pytest.mark.parametrize("contact", [20, 60, 110])
def test_contact_is_found_from_velocity_alone(contact: int) -> None:
    found = find_contact(velocity(contact), None, CRITERIA)
    assert found.row == contact
    assert not found.is_seen_by_force
    assert not found.warning


def test_contact_is_found_from_force_alone() -> None:
    found = find_contact(None, force(60), CRITERIA)
    assert (found.row, found.is_seen_by_force) == (60, True)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_contact_is_found_in_both_directions(sign: float) -> None:
    assert find_contact(sign * velocity(60), None, CRITERIA).row == 60
    assert find_contact(sign * velocity(60), sign * force(60), CRITERIA).row == 60


def test_no_contact_is_found_where_there_is_none() -> None:
    for seed in range(100):
        found = find_contact(velocity(None, seed=seed), force(None, seed=seed), CRITERIA)
        assert found.row is None
        assert not found.warning


def test_falling_velocity_is_no_contact() -> None:
    falling = 0.05 * (1.0 + 0.8 * np.exp(-np.arange(120) / 3.0))
    assert find_contact(falling, None, CRITERIA).row is None


def test_slider_that_never_moves_has_no_contact() -> None:
    for seed in range(100):
        noise = 1e-4 * np.random.default_rng(seed).standard_normal(120)
        assert find_contact(noise, None, CRITERIA).row is None


def test_a_glitch_of_the_force_is_no_contact() -> None:
    glitch = force(None)
    glitch[40:42] = 1.0
    assert find_contact(velocity(None), glitch, CRITERIA).row is None


def test_a_force_that_does_not_slow_the_slider_is_no_contact_but_a_warning() -> None:
    shifted = force(None)
    shifted[1:] += 0.02
    found = find_contact(velocity(None), shifted, CRITERIA)
    assert found.row is None
    assert "does not slow down" in found.warning


def test_a_stop_without_force_is_contact_with_a_warning() -> None:
    found = find_contact(velocity(60), force(None), CRITERIA)
    assert (found.row, found.is_seen_by_force) == (60, False)
    assert "no load force is seen" in found.warning


def test_soft_spring_is_in_contact_from_its_first_force() -> None:
    # the force rises long before the slider has stopped
    rows = np.arange(120)
    slowed = np.where(rows < 30, 0.05, 0.05 * np.exp(-(rows - 30) / 20.0))
    rising = np.where(rows < 30, 0.0, 0.3 * (1.0 - np.exp(-(rows - 30) / 20.0)))
    found = find_contact(slowed, rising, CRITERIA)
    assert (found.row, found.is_seen_by_force) == (31, True)


def test_slider_at_the_stop_from_the_beginning_is_in_contact() -> None:
    noise = 1e-4 * np.random.default_rng(3).standard_normal(120)
    found = find_contact(noise, force(0), CRITERIA)
    assert (found.row, found.is_seen_by_force) == (0, True)


def test_bouncing_does_not_hide_the_contact() -> None:
    bouncing = velocity(60)
    bouncing[60:70] += 0.04 * np.cos(np.arange(10.0)) * np.exp(-np.arange(10) / 3.0)
    assert find_contact(bouncing, force(60), CRITERIA).row == 60


def test_baseline_is_offset_and_noise_of_the_bias() -> None:
    samples = 0.02 + 3e-3 * np.random.default_rng(4).standard_normal(5000)
    samples[:600] += 0.5  # the instrument's filters settle
    base = find_baseline(samples, 216.2)
    assert not base.reason
    assert base.offset == pytest.approx(0.02, abs=3.0 * base.uncertainty)
    assert base.uncertainty == pytest.approx(3e-3 / math.sqrt(3750), rel=0.5)
    # parts of a quarter of a period, rather too noisy than not noisy enough
    assert base.noise == pytest.approx(3e-3 / math.sqrt(54), rel=0.4)


def test_baseline_is_refused_without_bias() -> None:
    assert "only 80 samples" in find_baseline(np.zeros(80), 216.2).reason
    assert "only 0 samples" in find_baseline(np.empty(0), 216.2).reason
    assert not find_baseline(np.zeros(86), 216.2).reason

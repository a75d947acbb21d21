"""Harmonics of a measured velocity: the head's response is out of them, its noise is known."""

from __future__ import annotations

import numpy as np
import pytest

from imotor_ros.core.channel import ROD_VELOCITY, ChannelDescription
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.identification.harmonics import measure_harmonics, whole_periods
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters

RATE = 1e6
CLEAN = VibrometerParameters(
    calibration_uncertainty=0.0,
    offset_uncertainty=0.0,
    noise_density=0.0,
    digitiser=DigitiserParameters(bits=32),
)
PHASORS = np.array([0.02 + 0.01j, 0.0, -0.003j, 0.001, 0.0005 + 0.0005j, 0.0, 0.0002j])


def measured(parameters: VibrometerParameters, frequency: float, seed: int = 1, periods: int = 40):
    head = Vibrometer(parameters, RATE, seed, ROD_VELOCITY)
    count = round((periods + 12) * RATE / frequency)
    angle = 2.0 * np.pi * frequency * np.arange(count) / RATE
    k = np.arange(1, PHASORS.size + 1)
    velocity = (np.exp(1j * np.multiply.outer(angle, k)) @ PHASORS).real
    samples, _ = head.process(velocity)
    start = round(5 * RATE / frequency)
    found = measure_harmonics(
        samples, head.channel, start=start, periods=periods, frequency=frequency,
        sample_rate=RATE, count=12,
    )  # fmt: skip
    return found, np.exp(1j * k * angle[start])


@pytest.mark.parametrize("frequency", [2000.0, 1234.5, 6100.0])
def test_head_is_taken_out(frequency: float) -> None:
    """
    Amplitude and phase come out as they were, whatever part of a sample a period ends at.

    1e-4 of each harmonic: the sampled filter of the virtual head differs from its continuous
    model by so much at a tenth of the sample rate, and less below.
    """
    found, turns = measured(CLEAN, frequency)
    expected = PHASORS * turns
    assert np.abs(found.phasors[:7] - expected).max() < 1e-4 * np.abs(expected[0])
    shown = np.abs(expected) > 0.0
    assert found.phasors[:7][shown] == pytest.approx(expected[shown], rel=2e-3)
    assert np.abs(found.phasors[7:]).max() < 1e-6
    assert abs(found.drift) < 1e-6 * abs(found.phasors[0])


def test_noise_is_told_from_the_periods() -> None:
    """One-sided density D over a time T scatters both parts of a phasor by D / sqrt(T)."""
    noisy = CLEAN.replace(noise_density=0.5e-6)
    expected = 0.5e-6 / np.sqrt(40 / 2000.0)
    found = [measured(noisy, 2000.0, seed)[0] for seed in range(60)]
    assert np.mean([one.noise for one in found]) == pytest.approx(expected, rel=0.03)
    parts = np.array([one.phasors[8:] for one in found])
    scatter = np.concatenate([parts.real.ravel(), parts.imag.ravel()]).std()
    # 480 numbers: 3.2 % by chance
    assert scatter == pytest.approx(expected, rel=0.1)


def test_rounding_counts_as_noise_where_nothing_else_does() -> None:
    """Without dither every period is rounded alike, and nothing changes between periods."""
    found, _ = measured(CLEAN.replace(digitiser=DigitiserParameters(bits=14)), 2000.0)
    step = 2.0 * CLEAN.full_scale / 2**14
    assert found.noise == pytest.approx(step / np.sqrt(12.0) * np.sqrt(2.0 / 20_000), rel=0.01)


def test_velocity_seen_by_another_head() -> None:
    found, _ = measured(CLEAN, 2000.0)
    gain, delay = 1.01, 0.02  # rad of the fundamental
    seen = found.seen_as(gain * np.exp(1j * delay))
    k = np.arange(1, 13)
    assert seen.phasors == pytest.approx(gain * found.phasors * np.exp(1j * k * delay))
    assert seen.noise == pytest.approx(gain * found.noise)


def test_unknown_bandwidth_leaves_harmonics_as_they_are() -> None:
    channel = ChannelDescription("rod/velocity", "velocity", "m/s", 1.0)
    samples = np.sin(2.0 * np.pi * 0.002 * np.arange(30_000))
    found = measure_harmonics(
        samples, channel, start=1000, periods=40, frequency=2000.0, sample_rate=RATE, count=5
    )
    assert found.phasors[0] == pytest.approx(-1j, abs=1e-9)


@pytest.mark.parametrize(
    ("span", "delay", "periods"), [((0, 5016), 0.0, 10), ((0, 5015), 0.0, 9), ((100, 600), 7.0, 0)]
)
def test_whole_periods_fit_with_what_interpolation_needs(
    span: tuple[int, int], delay: float, periods: int
) -> None:
    assert whole_periods(*span, 500.0, delay) == periods

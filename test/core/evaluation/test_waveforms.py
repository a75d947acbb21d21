"""What is read from mean waveforms: known shapes, and the bias that noise must not make."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.channel import BESSEL_3, FIRST_ORDER
from imotor_ros.core.filters import StreamFilter
from imotor_ros.core.linear_systems import LinearSystem, bessel_low_pass, first_order_low_pass
from imotor_ros.core.period_statistics import standard_error
from imotor_ros.core.waveforms import (
    FINER,
    average,
    coarsen_weights,
    corner_reach,
    count_harmonics,
    effective_value,
    mean_magnitude,
    mean_waveform,
    peak_to_peak,
    rectified_error,
    refine,
    without_spoiled,
)

Array = NDArray[np.float64]

POINTS = 224
PHASE = np.arange(POINTS) / POINTS


def triangle(phase: Array) -> Array:
    """A triangle of peak-to-peak value 1, harmonics up to 21."""
    orders = range(1, 22, 2)
    return sum(4 / (math.pi * k) ** 2 * np.cos(2 * np.pi * k * phase) for k in orders)


SWING = 2.0 * sum(4 / (math.pi * k) ** 2 for k in range(1, 22, 2))


def noisy(waveform: Array, noise: float, rows: int, seed: int) -> tuple[Array, NDArray[np.int64]]:
    draws = np.random.default_rng(seed).standard_normal((rows, POINTS))
    return waveform + noise * draws, np.arange(rows)


def test_refining_keeps_points_and_band() -> None:
    waveform = np.cos(2 * np.pi * 7 * PHASE + 0.3)
    fine = refine(waveform, 21)
    np.testing.assert_allclose(fine[::FINER], waveform, atol=1e-14)
    phase = np.arange(POINTS * FINER) / (POINTS * FINER)
    np.testing.assert_allclose(fine, np.cos(2 * np.pi * 7 * phase + 0.3), atol=1e-13)
    np.testing.assert_allclose(refine(np.cos(2 * np.pi * 30 * PHASE), 21), 0.0, atol=1e-13)


def test_coarse_weights_do_what_fine_weights_do() -> None:
    rng = np.random.default_rng(20)
    waveform, weights = rng.standard_normal(POINTS), rng.standard_normal(POINTS * FINER)
    wanted = weights @ refine(waveform, 40)
    assert coarsen_weights(weights, 40, POINTS) @ waveform == pytest.approx(wanted, rel=1e-11)


def test_harmonics_are_limited_by_rate_bandwidth_and_points() -> None:
    assert count_harmonics(4625.0, 1e6, 0.0, 10_000) == 86  # 0.4 of the sample rate
    assert count_harmonics(4625.0, 1e6, 100e3, 10_000) == 64  # three times the bandwidth
    assert count_harmonics(4625.0, 1e6, 0.0, 64) == 31
    assert count_harmonics(9250.0, 1e5, 1e3, 64) == 1


def test_halves_alternate() -> None:
    rows = np.arange(5.0)[:, None] * np.ones((5, POINTS))
    halves = average(rows, np.arange(5))
    np.testing.assert_array_equal(halves[:, 0], [2.0, 2.0])
    np.testing.assert_allclose(mean_waveform(rows, np.array([0, 1, 4])), 5.0 / 3.0)


def test_swing_of_a_clean_triangle_is_exact() -> None:
    rows, every = noisy(triangle(PHASE), 0.0, 6, 0)
    found = peak_to_peak(rows, every, 64, 0.02)
    assert found.value == pytest.approx(SWING, rel=1e-13)
    assert found.noise_bias < 1e-15
    np.testing.assert_allclose(found.per_period, SWING, rtol=1e-12)


@pytest.mark.parametrize(("noise", "rows"), [(0.02, 10), (0.1, 100), (0.3, 100)])
def test_noise_does_not_bias_the_swing(noise: float, rows: int) -> None:
    values, naive, errors = [], [], []
    for seed in range(100):
        found = peak_to_peak(*noisy(triangle(PHASE), noise, rows, seed), 64, 0.02)
        single = refine(mean_waveform(*noisy(triangle(PHASE), noise, rows, seed)), 64)
        values.append(found.value)
        naive.append(np.ptp(single))
        errors.append(math.hypot(standard_error(found.per_period), found.noise_bias))
    error = np.mean(errors)
    # the mean of 100 is good to a tenth of one; a fifth of one is all the bias there may be
    assert abs(np.mean(values) - SWING) < 0.3 * error
    assert np.mean(naive) - SWING > 0.4 * error, "the naive swing is biased: the test can fail"
    holds = np.mean(np.abs(np.array(values) - SWING) < 2.0 * np.array(errors))
    assert holds >= 0.9


def test_swing_of_pure_noise_is_within_its_uncertainty() -> None:
    found = [peak_to_peak(*noisy(np.zeros(POINTS), 0.1, 50, s), 64, 0.02) for s in range(50)]
    errors = [math.hypot(standard_error(f.per_period), f.noise_bias) for f in found]
    assert all(f.value < 3.0 * e for f, e in zip(found, errors, strict=True))


@pytest.mark.parametrize("frequency", [1156.25, 4625.0, 9250.0])
def test_bandwidth_hides_no_more_of_a_triangle_than_stated(frequency: float) -> None:
    # a true triangle through the vibrometer's filter, sampled so finely that rate is no matter
    rate = frequency * 4096
    cycles = np.arange(4096 * 4) / 4096
    sharp = np.abs(2.0 * (cycles % 1.0) - 1.0)
    late = StreamFilter(bessel_low_pass(100e3), rate).process(sharp)[-4096:]
    rows = np.tile(late[:: 4096 // 256][:256], (4, 1))
    reach = corner_reach(100e3, 1e6, frequency)
    harmonics = count_harmonics(frequency, 1e6, 100e3, 256)
    found = peak_to_peak(rows, np.arange(4), harmonics, reach)
    loss = 1.0 - found.value
    # docstring: each corner loses 0.0525/B times its change of slope, here 4 f
    assert loss == pytest.approx(2 * 0.0525 / 100e3 * 4 * frequency, rel=0.1)
    assert loss <= 1.05 * found.bandwidth_loss
    assert found.bandwidth_loss < 1.3 * loss


@pytest.mark.parametrize(
    ("make", "kind"), [(bessel_low_pass, BESSEL_3), (first_order_low_pass, FIRST_ORDER)]
)
@pytest.mark.parametrize(
    ("shape", "left"),
    [
        (lambda phase: 2.0 * np.abs(phase - 0.5), 0.01),
        (lambda phase: np.where(phase < 0.3, phase / 0.3, (1.0 - phase) / 0.7), 0.1),
        (lambda phase: 0.5 * np.cos(2.0 * np.pi * phase), 0.1),
    ],
    ids=["symmetric corners", "slopes of 7 to 3", "sine"],
)
def test_what_a_low_pass_takes_off_extrema_is_given_back(
    make: Callable[[float], LinearSystem], kind: str, shape: Callable[[Array], Array], left: float
) -> None:
    frequency, points = 4625.0, 4096
    sharp = shape(np.arange(4 * points) / points % 1.0)
    late = StreamFilter(make(100e3), frequency * points).process(sharp)[-points:]
    rows = np.tile(late[:: points // 256], (4, 1))
    harmonics = count_harmonics(frequency, 1e6, 100e3, 256)
    reach = corner_reach(100e3, 1e6, frequency)
    found = peak_to_peak(rows, np.arange(4), harmonics, reach, kind)
    plain = peak_to_peak(rows, np.arange(4), harmonics, reach)
    lost = np.ptp(sharp) - plain.value
    assert lost > 0.0004, "the low-pass hides something: the test can fail"
    assert abs(found.value - np.ptp(sharp)) < left * lost + 1e-4 * np.ptp(sharp)
    assert abs(found.value - np.ptp(sharp)) < 2.0 * found.bandwidth_doubt
    np.testing.assert_allclose(found.per_period, found.value, rtol=1e-9)


def test_low_pass_too_low_for_its_loss_to_be_told_only_bounds_it() -> None:
    rows, every = noisy(triangle(PHASE), 0.0, 6, 0)
    found = peak_to_peak(rows, every, 64, 0.2, BESSEL_3)
    assert found.value == pytest.approx(SWING, rel=1e-13)
    assert found.bandwidth_doubt == pytest.approx(found.bandwidth_loss / math.sqrt(3.0))


def test_mean_magnitude_of_a_sine() -> None:
    rows = np.tile(3.0 + np.cos(2 * np.pi * PHASE), (6, 1))
    found = mean_magnitude(rows, np.zeros_like(rows), 3.0, np.arange(6), 64)
    # 1792 points: the kinks leave (pi/1792)^2 / 3
    assert found.value == pytest.approx(2.0 / math.pi, rel=1.1e-6)
    np.testing.assert_allclose(found.per_period, 2.0 / math.pi, rtol=1e-3)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_noise_does_not_bias_the_mean_magnitude_where_the_slider_sticks(share: float) -> None:
    # a relative velocity that is zero for a share of the period
    end = 1.0 - share
    slides = np.sin(np.pi * PHASE / max(end, 1e-9)) ** 2 * (end > PHASE)
    true = 0.5 * end
    found = []
    for seed in range(60):
        rows, every = noisy(slides, 0.2, 40, seed)
        found.append(mean_magnitude(rows, np.zeros_like(rows), 0.0, every, 64))
    noise_left = 0.2 / math.sqrt(40)
    bias = np.mean([one.value for one in found]) - true
    # a plain mean of magnitudes would be 0.8 of the remaining noise too high where it sticks,
    # and without averaging first 0.8 of all the noise
    assert abs(bias) < 0.12 * noise_left
    naive = np.mean([np.mean(np.abs(mean_waveform(*noisy(slides, 0.2, 40, s)))) for s in range(60)])
    if share == 1.0:
        assert naive > 0.7 * noise_left, "the naive value is biased: the test can fail"


def test_effective_value_is_that_of_all_harmonics_without_the_mean() -> None:
    waveform = 50.0 + 30.0 * np.sin(2 * np.pi * PHASE) + 10.0 * np.cos(2 * np.pi * 2 * PHASE)
    rows, every = noisy(waveform, 0.0, 6, 0)
    found = effective_value(rows, every, 64)
    assert found.value == pytest.approx(math.sqrt(500.0), rel=1e-12)
    np.testing.assert_allclose(found.per_period, found.value, rtol=1e-12)


def test_noise_does_not_raise_the_effective_value() -> None:
    waveform = 0.1 * np.sin(2 * np.pi * PHASE)
    values = [effective_value(*noisy(waveform, 1.0, 50, s), 64).value for s in range(200)]
    power = np.mean(np.square(values))
    # the noise of the mean waveform alone has 2 * 64 / 224 / 50 = 0.0114, the signal 0.005
    assert power == pytest.approx(0.005, abs=6e-4)


def test_hidden_share_is_that_of_a_first_order_low_pass() -> None:
    frequencies = np.array([18.5e3, 37e3])
    gains = 1.0 / np.sqrt(1.0 + (frequencies / 100e3) ** 2)
    amplitudes = np.array([1.0, 0.5])
    shown = amplitudes * gains
    waveform = sum(a * np.sin(2 * np.pi * k * PHASE) for k, a in enumerate(shown, 1))
    found = effective_value(*noisy(waveform, 0.0, 4, 0), 64)
    wanted = 1.0 - math.hypot(*shown) / math.hypot(*amplitudes)
    assert found.hidden_share(0.185) == pytest.approx(wanted, rel=1e-9)
    assert found.hidden_share(0.0) == 0.0


def test_rectified_error_is_the_mean_of_folded_normal_errors() -> None:
    rng = np.random.default_rng(21)
    values, deviations = np.array([0.0, 0.5, -1.0, 10.0]), np.array([1.0, 1.0, 0.5, 0.1])
    draws = values + deviations * rng.standard_normal((400_000, 4))
    wanted = np.mean(np.abs(draws) - np.abs(values))
    # 1.6 million draws of about 1
    assert rectified_error(values, deviations) == pytest.approx(wanted, abs=3e-3)
    assert rectified_error(values, np.zeros(4)) == 0.0


def test_spoiled_periods_are_left_out_and_others_kept() -> None:
    rows, every = noisy(triangle(PHASE), 0.015, 80, 1)
    assert without_spoiled(rows, every).size == 80
    rows[17, 40:60] = rows[17, 40]  # held for 20 of 224 points
    rows[33, 100:] = 0.0
    left = without_spoiled(rows, every)
    assert sorted(set(every) - set(left)) == [17, 33]

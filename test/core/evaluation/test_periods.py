"""Folding into periods: exact for the harmonics of the drive, whatever the block boundaries."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.alignment import AFTER
from imotor_ros.core.drive import DriveProgram, DriveSegment, steady_drive
from imotor_ros.core.periods import (
    FoldedChannel,
    PeriodGrid,
    add_alternating,
    project_rows,
    square_deviations,
)
from imotor_ros.errors import BadInputError

Array = NDArray[np.float64]


def drive(frequency: float = 4625.0, hold: float = 0.02, **changes: float) -> DriveProgram:
    return steady_drive(
        run_id="run", epoch=0, sample_rate=1e6, fundamental_frequency=frequency, offset=50.0,
        amplitudes=(30.0,), phases=(0.0,), hold_time=hold, **changes,
    )  # fmt: skip


def fold(signal: Array, grid: PeriodGrid, delay: float = 0.0, block: int = 1000) -> FoldedChannel:
    channel = FoldedChannel(grid, delay)
    for first in range(0, signal.size, block):
        channel.add(signal[first : first + block])
    return channel


def test_grid_runs_from_ramp_up_to_the_end_of_hold() -> None:
    program = drive()
    grid = PeriodGrid.of_program(program)
    assert grid.origin == program.span("ramp_up")[0] == 5000
    assert grid.period == 1e6 / 4625
    assert grid.count == math.floor((program.span("hold")[1] - 5000) / grid.period)
    assert grid.points >= grid.period
    assert grid.row_at(program.span("hold")[0]) == 1
    assert grid.first_sample(0) == 5000
    assert grid.first_sample(1) == 5217


def test_grid_knows_the_phase_of_the_drive() -> None:
    program = drive()
    turning = DriveSegment("bias", 5000, 1030.0, 1030.0, 0.0, 50.0, (0.0,), (0.0,), (0.0,))
    turned = dataclasses.replace(program, segments=(turning, *program.segments[1:]))
    assert PeriodGrid.of_program(program).start_phase == 0.0
    assert PeriodGrid.of_program(turned).start_phase == pytest.approx(0.15, abs=1e-12)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"segments": drive().segments[:1]}, "no such segment"),
        ({"fundamental_frequency": 4000.0}, "is not steady"),
        ({"sample_rate": 20e3}, "is too short"),
    ],
)
def test_grid_refuses_a_program_without_steady_drive(
    change: dict[str, object], reason: str
) -> None:
    with pytest.raises(BadInputError, match=reason):
        PeriodGrid.of_program(dataclasses.replace(drive(), **change))  # type: ignore[arg-type]


# 216.2, 1730.1 and 108.1 samples per period; the last two are no simple fractions at all
@pytest.mark.parametrize("frequency", [4625.0, 578.0, 9250.0, 4623.71, 7777.77])
def test_period_means_do_not_leak(frequency: float) -> None:
    program = drive(frequency, hold=max(0.02, 8 / frequency))
    grid = PeriodGrid.of_program(program)
    time = (np.arange(program.length) - grid.origin) / 1e6
    harmonics = sum(
        np.cos(2 * np.pi * k * frequency * time + k) for k in range(1, int(1e5 / frequency) + 1)
    )
    means = fold(0.01 + harmonics, grid).means
    assert means.size == grid.count
    # relative to harmonics of amplitude 1 up to 100 kHz; the interpolation is good to 2e-9
    np.testing.assert_allclose(means, 0.01, rtol=0, atol=1e-9)
    whole = round(grid.period)
    plain = harmonics[grid.origin : grid.origin + whole].mean()
    if abs(whole - grid.period) > 0.05:
        assert abs(plain) > 1e-5, "plain means over whole samples leak: the test can fail"


def test_period_means_follow_a_slow_change() -> None:
    program = drive()
    grid = PeriodGrid.of_program(program)
    time = (np.arange(program.length) - grid.origin) / 1e6
    means = fold(np.exp(-time / 3e-3), grid).means
    middles = grid.middle(np.arange(grid.count)) / 1e6
    half = 0.5 * grid.period / 1e6 / 3e-3
    wanted = np.exp(-middles / 3e-3) * math.sinh(half) / half
    # the midpoint rule with 224 points leaves (period / 224 / 3 ms)^2 / 24
    np.testing.assert_allclose(means, wanted, rtol=1e-8)


def test_delay_is_taken_out_of_the_periods() -> None:
    program = drive()
    grid = PeriodGrid.of_program(program)
    time = (np.arange(program.length) - grid.origin) / 1e6
    late = np.sin(2 * np.pi * 18.5e3 * (time - 7.3e-6))
    waveforms = fold(late, grid, delay=7.3).waveforms
    wanted = np.sin(2 * np.pi * 4 * grid.phases)
    np.testing.assert_allclose(waveforms, np.tile(wanted, (grid.count, 1)), rtol=0, atol=1e-10)


@pytest.mark.parametrize("delay", [0.0, 7.3, -3.7])
def test_periods_do_not_depend_on_blocks_to_the_last_bit(delay: float) -> None:
    program = drive(4623.71)
    grid = PeriodGrid.of_program(program)
    signal = np.random.default_rng(3).standard_normal(program.length)
    whole = fold(signal, grid, delay, block=signal.size)
    assert whole.rows == grid.count
    for block in (10_000, 777, 97, 1):
        parts = fold(signal, grid, delay, block)
        np.testing.assert_array_equal(parts.waveforms, whole.waveforms)
        np.testing.assert_array_equal(parts.means, whole.means)


def test_periods_appear_as_soon_as_their_samples_are_there() -> None:
    program = drive()
    grid = PeriodGrid.of_program(program)
    channel = FoldedChannel(grid, 7.3)
    for end in range(1, 7000):
        channel.add(np.ones(1))
        assert channel.rows == channel.rows_until(end)
    # the interpolation looks ahead by some samples only
    assert channel.rows == math.floor((7000 - AFTER - 5000 - 7.3) / grid.period) == 9


def test_means_alone_are_the_same_as_with_waveforms() -> None:
    program = drive()
    grid = PeriodGrid.of_program(program)
    signal = np.random.default_rng(4).standard_normal(program.length)
    lean = FoldedChannel(grid, 7.3, keeps_waveforms=False)
    lean.add(signal)
    np.testing.assert_array_equal(lean.means, fold(signal, grid, 7.3).means)
    assert lean.waveforms.shape == (0, grid.points)


def test_period_without_samples_before_it_is_nan() -> None:
    program = drive(bias_time=0.0)  # one sample of bias
    grid = PeriodGrid.of_program(program)
    channel = fold(np.ones(program.length), grid)
    assert np.isnan(channel.means[0])
    np.testing.assert_allclose(channel.means[1:], 1.0, rtol=1e-15)


def test_kernels_average_project_and_compare_selected_rows() -> None:
    rows = np.random.default_rng(5).standard_normal((9, 6))
    selection = np.array([1, 2, 4, 7, 8])
    halves = np.empty((2, 6))
    add_alternating(rows, selection, halves)
    np.testing.assert_allclose(halves[0], rows[[1, 4, 8]].mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(halves[1], rows[[2, 7]].mean(axis=0), rtol=1e-14)
    weights = np.arange(6.0)
    values = np.empty(5)
    project_rows(rows, selection, weights, values)
    np.testing.assert_allclose(values, rows[selection] @ weights, rtol=1e-13)
    square_deviations(rows, selection, weights, values)
    np.testing.assert_allclose(values, ((rows[selection] - weights) ** 2).mean(axis=1), rtol=1e-13)

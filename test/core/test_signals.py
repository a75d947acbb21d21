"""The sawtooth signals against table 1 of the paper and against their definition."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imotor_ros.core.signals import (
    HarmonicMotion,
    classic_sawtooth,
    ideal_parabolic_sawtooth,
    parabolic_sawtooth,
    sine,
)
from imotor_ros.errors import BadInputError


def test_first_row_of_table_1_is_met_in_every_printed_digit():
    motion = parabolic_sawtooth(4, stroke=15e-6, fundamental_frequency=4625.0)
    assert [f"{a * 1e6:.2f}" for a in motion.amplitudes] == ["6.23", "2.43", "1.07", "0.37"]
    degrees = [math.degrees(phase) for phase in motion.relative_phases]
    assert [f"{angle:.1f}" for angle in degrees[1:]] == ["-153.7", "46.9", "-113.9"]
    assert motion.max_frequency == 18500.0


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 30, 200])
def test_stroke_is_the_peak_to_peak_displacement(n):
    motion = parabolic_sawtooth(n, stroke=15e-6, maximum_frequency=18500.0)
    x = motion.position(np.arange(400 * n + 1) / (400 * n) * motion.period)
    # 400 points per shortest wave miss an extreme by at most (pi / 400)^2 / 2 of a harmonic
    assert np.ptp(x) == pytest.approx(15e-6, rel=1e-4)
    assert np.ptp(x) <= 15e-6 * (1 + 1e-14)
    assert motion.stroke == pytest.approx(15e-6, rel=1e-14)


@pytest.mark.parametrize("n", [2, 5, 40])
def test_amplitudes_carry_lanczos_factors(n):
    motion = parabolic_sawtooth(n, fundamental_frequency=1.0)
    k = np.arange(1, n + 1)
    exact = np.hypot(1.0 / (np.pi * k) ** 2, 1.0 / (np.pi * k))
    factor = np.array(motion.amplitudes) / exact
    sigma = np.sin(np.pi * k / (n + 1)) / (np.pi * k / (n + 1))
    assert factor / factor[0] == pytest.approx(sigma / sigma[0], rel=1e-13)


def test_many_harmonics_come_close_to_the_ideal_parabola():
    motion = parabolic_sawtooth(400, stroke=1.0, fundamental_frequency=1.0)
    phase = np.linspace(0.05, 0.95, 200)
    ideal = ideal_parabolic_sawtooth(phase, 1.0)
    rest = motion.position(phase) - ideal
    assert np.ptp(rest) < 0.02
    assert np.all(np.diff(motion.velocity(np.linspace(0.1, 0.9, 50))) > 0.0)


def test_classic_sawtooth_rises_steadily():
    motion = classic_sawtooth(60, stroke=1.0, fundamental_frequency=1.0)
    assert motion.velocity(np.linspace(0.2, 0.8, 30)) == pytest.approx(1.0, rel=0.1)


def test_derivatives_follow_from_each_other():
    motion = parabolic_sawtooth(3, maximum_frequency=9250.0)
    t, h = np.linspace(0.0, 2 * motion.period, 57), 1e-9
    slope = (motion.position(t + h) - motion.position(t - h)) / (2 * h)
    assert motion.velocity(t) == pytest.approx(slope, abs=1e-6)
    rate = (motion.velocity(t + h) - motion.velocity(t - h)) / (2 * h)
    assert motion.acceleration(t) == pytest.approx(rate, abs=1e-2)


def test_far_times_lose_no_digits_beyond_those_of_the_time():
    motion = parabolic_sawtooth(3, fundamental_frequency=1024.0)
    t = np.arange(64) / 65536.0
    assert motion.velocity(t + 1e5) == pytest.approx(motion.velocity(t), abs=1e-12)


@settings(deadline=None, derandomize=True, database=None)
@given(st.floats(-3.0, 3.0))
def test_shifted_motion_is_ahead(cycles):
    motion = parabolic_sawtooth(3, fundamental_frequency=100.0)
    t = np.linspace(0.0, 0.01, 11)
    ahead = motion.shifted(cycles * motion.period).position(t)
    assert ahead == pytest.approx(
        motion.position(t + cycles * motion.period), abs=1e-18 + 1e-13 * 15e-6
    )


def test_relative_phases_do_not_depend_on_the_time_origin():
    motion = parabolic_sawtooth(4, fundamental_frequency=4625.0)
    for time in (1e-5, 7.7e-5, -3e-4):
        turn = np.subtract(motion.shifted(time).relative_phases, motion.relative_phases)
        assert np.cos(turn) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    "call",
    [
        lambda: parabolic_sawtooth(2),
        lambda: parabolic_sawtooth(2, fundamental_frequency=1.0, maximum_frequency=2.0),
        lambda: parabolic_sawtooth(0, fundamental_frequency=1.0),
        lambda: parabolic_sawtooth(2.5, fundamental_frequency=1.0),
        lambda: parabolic_sawtooth(2, -1e-6, fundamental_frequency=1.0),
        lambda: parabolic_sawtooth(2, fundamental_frequency=math.nan),
        lambda: parabolic_sawtooth(2, maximum_frequency=0.0),
        lambda: HarmonicMotion(1.0, (1.0,), (1.0, 2.0)),
        lambda: HarmonicMotion(1.0, (), ()),
        lambda: HarmonicMotion(1.0, (math.inf,), (0.0,)),
        lambda: sine(1.0, -1.0),
    ],
)
def test_unusable_values_are_refused(call):
    with pytest.raises(BadInputError):
        call()

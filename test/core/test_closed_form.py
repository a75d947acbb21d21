"""The closed form against oracles with closed forms of their own, and an independent solver."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from imotor_ros.core import taylor
from imotor_ros.core.closed_form import applies, simulate
from imotor_ros.core.friction import (
    CoulombFriction,
    StribeckFriction,
    VelocityDependentFriction,
)
from imotor_ros.core.signals import HarmonicMotion, parabolic_sawtooth, sine
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.solution import summarise
from imotor_ros.errors import BadInputError

SLIDER = SliderParameters()
MASS = SLIDER.mass
LAWS = (CoulombFriction(), VelocityDependentFriction())
GRID = [(n, f) for n in (2, 3, 4) for f in (2312.5, 4625.0, 9250.0, 18500.0)]
CASES = [(law, n, f) for law in LAWS for n, f in GRID]
RANDOM = settings(deadline=None, derandomize=True, database=None, max_examples=150)


def _steady(table, name="mean_velocity"):
    return float(np.mean(getattr(table, name)[-(table.periods // 4) :]))


def _weight(force):
    return LoadParameters(constant_force=force, stop_stiffness=0.0)


# ---------------------------------------------------------------- sine drive, section 5, figure 7


@pytest.mark.parametrize("law", LAWS)
def test_slider_sticks_throughout_up_to_the_acceleration_of_break_away(law):
    omega = 2 * math.pi * 2000.0
    amplitude = law.break_away / (MASS * omega**2)
    for share, sticks in ((0.5, True), (1 - 1e-9, True), (1 + 1e-6, False)):
        motion = sine(share * amplitude, 2000.0)
        table = simulate(
            motion, SLIDER, law, periods=50, initial_velocity=float(motion.velocity(0.0))
        )
        assert (table.stick_share == 1.0).all() == sticks
        if sticks:
            peak = share * amplitude * omega
            assert table.max_velocity == pytest.approx(peak, rel=1e-14)
            assert table.min_velocity == pytest.approx(-peak, rel=1e-14)
            assert table.mean_velocity == pytest.approx(0.0, abs=1e-15)


def test_paper_s_sticking_thresholds_are_met():
    omega2 = (2 * math.pi * 2000.0) ** 2
    assert 1.01 / (MASS * omega2) == pytest.approx(0.92e-6, abs=0.005e-6)
    full = math.sqrt(1 + math.pi**2 / 4) * 1.01 / (MASS * omega2)
    assert full == pytest.approx(1.72e-6, abs=0.005e-6)


@pytest.mark.parametrize("frequency", [50.0, 2000.0, 40e3])
def test_slider_slides_throughout_from_the_threshold_of_full_sliding(frequency):
    threshold = math.sqrt(1 + math.pi**2 / 4) * 1.01 / (MASS * (2 * math.pi * frequency) ** 2)
    for share, slides in ((0.999, False), (1.0005, True), (1.5, True), (10.0, True)):
        table = simulate(sine(share * threshold, frequency), SLIDER, LAWS[0], periods=3000)
        assert (table.stick_share[-500:] == 0.0).all() == slides, share


@pytest.mark.parametrize("share", [1.01, 2.0, 10.0])
def test_sliding_slider_moves_in_a_triangle_with_the_acceleration_of_friction(share):
    frequency = 2000.0
    threshold = math.sqrt(1 + math.pi**2 / 4) * 1.01 / (MASS * (2 * math.pi * frequency) ** 2)
    motion = sine(share * threshold, frequency)
    table = simulate(motion, SLIDER, LAWS[0], periods=4000, record=True)
    # a triangle with slopes +-F/m rises by F/m T/2
    rise = 1.01 / MASS / frequency / 2
    assert table.max_velocity[-1] - table.min_velocity[-1] == pytest.approx(rise, rel=1e-9)
    assert table.mean_velocity[-1] == pytest.approx(0.0, abs=1e-9 * rise)
    t = np.linspace(3999.0, 4000.0, 20001) / frequency
    acceleration = np.diff(table.trajectory.sample(t).velocity) / np.diff(t)
    # the two reversals share a difference each with both slopes
    assert np.mean(np.abs(acceleration)) == pytest.approx(1.01 / MASS, rel=2e-4)


# ---------------------------------------------------------------- sawtooth drives, section 2


@pytest.mark.parametrize("n", [2, 3, 4])
def test_fast_drive_tends_to_the_median_of_the_rod_velocity(n):
    errors = []
    for frequency in (5e4, 1e5):
        motion = parabolic_sawtooth(n, fundamental_frequency=frequency)
        median = np.median(motion.velocity((np.arange(200_000) + 0.5) / 200_000 * motion.period))
        table = simulate(motion, SLIDER, LAWS[0], periods=60_000, initial_velocity=float(median))
        errors.append(abs(_steady(table) / median - 1.0))
    # what is left falls with the square of the slider's ripple over the rod velocity, 1 / f^2
    assert errors[1] < 2e-4
    assert errors[1] == pytest.approx(errors[0] / 4, rel=0.1)


@pytest.mark.parametrize(("law", "n", "frequency"), CASES)
def test_friction_has_no_mean_in_steady_state(law, n, frequency):
    motion = parabolic_sawtooth(n, maximum_frequency=frequency)
    table = simulate(motion, SLIDER, law, periods=4000)
    # no momentum is gained over a steady period, so mean[sgn(w) F(|w|)] over sliding and
    # mean[m a_R] over sticking cancel; the slider velocity repeats
    again = simulate(
        motion, SLIDER, law, periods=1, initial_velocity=table.final_velocity, record=True
    )
    assert again.final_velocity == pytest.approx(table.final_velocity, abs=1e-12)
    edges = np.unique([0.0, *again.trajectory.event_times, motion.period])
    nodes, weights = np.polynomial.legendre.leggauss(24)
    total = size = 0.0
    for a, b in itertools.pairwise(edges):
        t = a + (b - a) * (nodes + 1) / 2
        seen = again.trajectory.sample(t)
        w = seen.rod_velocity - seen.velocity
        force = np.where(
            seen.is_sticking, MASS * motion.acceleration(t), np.sign(w) * law.force(np.abs(w))
        )
        total += (b - a) / 2 * float(weights @ force)
        size += (b - a) / 2 * float(weights @ np.abs(force))
    # 24 points per stretch integrate harmonics to some 1e-13
    assert abs(total) < 1e-11 * size


@pytest.mark.parametrize(("law", "n", "frequency"), CASES[::5])
def test_work_of_the_rod_is_friction_loss_and_kinetic_energy(law, n, frequency):
    motion = parabolic_sawtooth(n, maximum_frequency=frequency)
    load = _weight(0.1)
    table = simulate(motion, SLIDER, law, load=load, periods=7, record=True)
    edges = np.unique([0.0, *table.trajectory.event_times, 7 * motion.period])
    nodes, weights = np.polynomial.legendre.leggauss(32)
    work = loss = 0.0
    for a, b in itertools.pairwise(edges):
        t = a + (b - a) * (nodes + 1) / 2
        seen = table.trajectory.sample(t)
        w = seen.rod_velocity - seen.velocity
        need = MASS * motion.acceleration(t) + 0.1
        force = np.where(seen.is_sticking, need, np.sign(w) * law.force(np.abs(w)))
        work += (b - a) / 2 * float(weights @ (force * seen.rod_velocity))
        loss += (b - a) / 2 * float(weights @ (force * w))
    kinetic = 0.5 * MASS * table.final_velocity**2
    lifted = 0.1 * table.final_position
    assert loss > 0.0
    assert work == pytest.approx(loss + kinetic + lifted, rel=1e-11)


@pytest.mark.parametrize(("n", "share"), [(2, 0.2285), (3, 0.3750), (4, 0.4755)])
@pytest.mark.parametrize("frequency", [9250.0, 200e3])
def test_stall_force_of_a_held_slider_depends_on_the_signal_alone(n, share, frequency):
    motion = parabolic_sawtooth(n, fundamental_frequency=frequency, stroke=7e-6)
    phase = (np.arange(1_000_000) + 0.5) / 1_000_000
    forward = np.mean(motion.velocity(phase * motion.period) > 0.0)
    assert 2 * forward - 1 == pytest.approx(share, abs=1e-4)
    # a weight just below that force is carried along, one just above falls
    if frequency > 1e5:
        force = 1.01 * (2 * forward - 1)
        for factor, sign in ((0.99, 1), (1.01, -1)):
            table = simulate(motion, SLIDER, LAWS[0], load=_weight(factor * force), periods=60_000)
            assert sign * _steady(table) > 0.0


def test_three_harmonics_beat_two_at_18500_hz_with_friction_model_2():
    speed = {
        n: _steady(
            simulate(
                parabolic_sawtooth(n, maximum_frequency=18500.0), SLIDER, LAWS[1], periods=2000
            )
        )
        for n in (2, 3, 4)
    }
    assert speed[3] > speed[2] > speed[4]
    # at half that frequency, and with model 1, two harmonics are the fastest, as the paper says
    for law, frequency in ((LAWS[1], 9250.0), (LAWS[0], 18500.0)):
        speed = [
            _steady(
                simulate(
                    parabolic_sawtooth(n, maximum_frequency=frequency), SLIDER, law, periods=4000
                )
            )
            for n in (2, 3, 4)
        ]
        assert speed[0] > max(speed[1:])


def test_slowest_case_takes_some_400_periods():
    table = simulate(
        parabolic_sawtooth(2, maximum_frequency=18500.0), SLIDER, LAWS[0], periods=4000
    )
    error = np.abs(table.mean_velocity / _steady(table) - 1.0)
    # so a mean over the last quarter of 200 periods is still about 1 % low
    assert 0.005 < error[150:200].mean() < 0.012
    assert error[400:].max() < 1e-4
    assert summarise(table, has_load=False).is_steady
    short = simulate(parabolic_sawtooth(2, maximum_frequency=18500.0), SLIDER, LAWS[0], periods=150)
    found = summarise(short, has_load=False)
    assert not found.is_steady
    assert "not steady" in found.reasons["mean_velocity"]


# ---------------------------------------------------------------- independent solvers


def _reference(motion, law, periods, push=0.0):
    """DOP853 with events: mean velocities of the periods, from rest."""
    mass, need_max = MASS, law.break_away

    def slide(start, end, v, x, sign):
        def rate(t, y):
            w = abs(float(motion.velocity(t)) - y[0])
            return [(sign * float(law.force(w)) + push) / mass, y[0]]

        def zero(t, y):
            return float(motion.velocity(t)) - y[0]

        zero.terminal, zero.direction = True, -sign
        found = solve_ivp(
            rate, (start, end), [v, x], method="DOP853", rtol=1e-13, atol=1e-16, events=zero,
            max_step=motion.period / 40,
        )  # fmt: skip
        return found.t[-1], found.y[0, -1], found.y[1, -1], found.status == 1

    def need(t):
        return mass * float(motion.acceleration(t)) - push

    edges = np.arange(1, periods + 1) * motion.period
    t, v, x, means = 0.0, 0.0, 0.0, []
    sign = 1 if motion.velocity(0.0) > 0 else -1
    last = 0.0
    for edge in edges:
        while t < edge:
            if sign:
                t, v, x, stopped = slide(t, edge, v, x, sign)
                if stopped:
                    force = need(t)
                    sign = 0 if abs(force) <= need_max else int(np.sign(force))
                continue
            grid = np.linspace(t, edge, 400)
            beyond = np.flatnonzero(np.abs([need(s) for s in grid]) > need_max)
            end = edge
            if beyond.size:
                i = beyond[0]
                end = brentq(
                    lambda s: abs(need(s)) - need_max, grid[max(i - 1, 0)], grid[i], xtol=1e-18
                )
                sign = int(np.sign(need(grid[i])))
            x += float(motion.position(end) - motion.position(t))
            t, v = end, float(motion.velocity(end))
        means.append((x - last) / motion.period)
        last = x
    return np.array(means)


@pytest.mark.parametrize(
    ("law", "n", "frequency", "push"),
    [
        (LAWS[0], 2, 18500.0, 0.0),
        (LAWS[1], 3, 9250.0, 0.0),
        (LAWS[0], 4, 4625.0, 0.0),
        (LAWS[1], 2, 2312.5, 0.0),
        (LAWS[1], 4, 4625.0, -0.2),
    ],
)
def test_period_means_agree_with_a_general_integrator(law, n, frequency, push):
    motion = parabolic_sawtooth(n, maximum_frequency=frequency)
    table = simulate(motion, SLIDER.replace(axial_force=push), law, periods=4)
    expected = _reference(motion, law, 4, push)
    # DOP853 at rtol 1e-13 stays within some 1e-11 of the velocities
    assert table.mean_velocity == pytest.approx(expected, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize(("law", "n", "frequency"), CASES)
def test_all_columns_agree_with_power_series(law, n, frequency):
    motion = parabolic_sawtooth(n, maximum_frequency=frequency)
    ours = simulate(motion, SLIDER, law, periods=300, record=True)
    series = taylor.simulate(motion, SLIDER, law, periods=300, record=True)
    _assert_equal_tables(ours, series, 1e-11)
    t = np.linspace(0.0, 300 * motion.period, 5000)
    a, b = ours.trajectory.sample(t), series.trajectory.sample(t)
    assert np.abs(a.velocity - b.velocity).max() < 1e-12
    assert np.abs(a.position - b.position).max() < 1e-11 * max(abs(ours.final_position), 15e-6)
    assert (a.is_sticking == b.is_sticking).mean() > 0.999


def _assert_equal_tables(ours, other, tolerance):
    scale = np.abs(other.max_velocity).max() + np.abs(other.min_velocity).max()
    scale += other.mean_relative_speed.max()
    for name in ("mean_velocity", "min_velocity", "max_velocity", "mean_relative_speed"):
        error = np.abs(getattr(ours, name) - getattr(other, name)).max()
        assert error <= tolerance * scale, name
    assert np.abs(ours.stick_share - other.stick_share).max() < math.sqrt(tolerance)


motions = st.builds(
    lambda f, pairs: HarmonicMotion(
        f, tuple(a * 1e-6 for a, _ in pairs), tuple(p for _, p in pairs)
    ),
    st.sampled_from([300.0, 2000.0, 9250.0]),
    st.lists(
        st.tuples(st.just(0.0) | st.floats(1e-3, 10.0), st.floats(-3.2, 3.2)),
        min_size=1,
        max_size=5,
    ),
)
straight_laws = st.builds(
    lambda force, slope, factor: VelocityDependentFriction(
        sliding_force=force, slope=slope, break_away_force=force * factor
    ),
    st.floats(0.1, 3.0),
    st.sampled_from([0.0, 1e-9, 0.5, 2.213, 50.0]),
    st.sampled_from([1.0, 1.0, 1.000001, 1.3, 4.0]),
)


@RANDOM
@given(motions, straight_laws, st.sampled_from([0.0, 0.0, 0.05, -0.3, 0.9, 2.0]))
def test_any_motion_and_straight_law_agree_with_power_series(motion, law, push):
    slider = SLIDER.replace(axial_force=push * law.sliding_force)
    ours = simulate(motion, slider, law, periods=12)
    series = taylor.simulate(motion, slider, law, periods=12)
    _assert_equal_tables(ours, series, 1e-10)


@RANDOM
@given(motions, straight_laws, st.floats(-0.5, 0.5))
def test_mirrored_motion_gives_the_mirrored_solution(motion, law, push):
    slider, mirrored = SLIDER.replace(axial_force=push), SLIDER.replace(axial_force=-push)
    a = simulate(motion, slider, law, periods=10)
    b = simulate(motion.scaled(-1.0), mirrored, law, periods=10)
    scale = 1e-300 + np.abs(a.max_velocity).max() + np.abs(a.min_velocity).max()
    assert a.mean_velocity == pytest.approx(-b.mean_velocity, abs=1e-12 * scale)
    assert a.min_velocity == pytest.approx(-b.max_velocity, abs=1e-12 * scale)
    assert a.stick_share == pytest.approx(b.stick_share, abs=1e-6)


@RANDOM
@given(st.integers(2, 4), st.sampled_from(LAWS), st.floats(0.0, 1.0))
def test_steady_state_does_not_depend_on_where_the_period_starts(n, law, cycles):
    motion = parabolic_sawtooth(n, maximum_frequency=9250.0)
    a = simulate(motion, SLIDER, law, periods=1000)
    b = simulate(motion.shifted(cycles * motion.period), SLIDER, law, periods=1000)
    assert _steady(a) == pytest.approx(_steady(b), rel=1e-10)
    assert a.max_velocity[-1] == pytest.approx(b.max_velocity[-1], rel=1e-10)
    assert a.min_velocity[-1] == pytest.approx(b.min_velocity[-1], rel=1e-9, abs=1e-12)


@RANDOM
@given(motions, straight_laws, st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_solution_scales_with_mass_stroke_and_time(motion, law, length, time):
    # x -> length x, t -> time t: velocities by length/time, forces by m length/time^2
    force, slope = length / time**2, 1.0 / time
    scaled_motion = HarmonicMotion(
        motion.fundamental_frequency / time, tuple(length * a for a in motion.amplitudes),
        motion.phases,
    )  # fmt: skip
    scaled_law = VelocityDependentFriction(
        sliding_force=law.sliding_force * force, slope=law.slope * slope,
        break_away_force=law.break_away_force * force,
    )  # fmt: skip
    if scaled_law.break_away_force < scaled_law.sliding_force:
        return
    a = simulate(motion, SLIDER, law, periods=8)
    b = simulate(scaled_motion, SLIDER, scaled_law, periods=8)
    scale = 1e-300 + np.abs(a.max_velocity).max() + a.mean_relative_speed.max()
    # a slide that starts with next to no acceleration multiplies rounding
    assert b.mean_velocity * time / length == pytest.approx(a.mean_velocity, abs=1e-9 * scale)


# ---------------------------------------------------------------- forces, start, bounds


def test_break_away_above_the_sliding_force_delays_sliding():
    motion = parabolic_sawtooth(4, maximum_frequency=2312.5)
    equal = simulate(motion, SLIDER, CoulombFriction(), periods=20)
    higher = simulate(motion, SLIDER, CoulombFriction(break_away_force=1.3), periods=20)
    held = simulate(motion, SLIDER, CoulombFriction(break_away_force=100.0), periods=20)
    assert higher.stick_share[-1] > equal.stick_share[-1]
    assert held.stick_share[-1] == 1.0


def test_inclined_rod_slows_the_slider_like_a_weight():
    motion = parabolic_sawtooth(3, maximum_frequency=18500.0)
    upwards = SLIDER.replace(inclination=0.3)
    weight = MASS * 9.81 * math.sin(0.3)
    scaled = CoulombFriction(sliding_force=1.01 * upwards.friction_scale)
    a = simulate(motion, upwards, CoulombFriction(), periods=300)
    b = simulate(motion, SLIDER, scaled, load=_weight(weight), periods=300)
    assert a.mean_velocity == pytest.approx(b.mean_velocity, rel=1e-12)
    assert _steady(a) < _steady(simulate(motion, SLIDER, CoulombFriction(), periods=300))


def test_slider_pulled_by_more_than_friction_runs_away_at_a_constant_rate():
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    table = simulate(motion, SLIDER.replace(axial_force=1.5), CoulombFriction(), periods=2000)
    gain = np.diff(table.mean_velocity[-100:])
    # faster than the rod at all times, friction is a constant drag
    assert gain == pytest.approx((1.5 - 1.01) / MASS * motion.period, rel=1e-9)
    assert not summarise(table, has_load=False).is_steady


def test_slider_pulled_by_more_than_rising_friction_settles_where_they_balance():
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    table = simulate(
        motion, SLIDER.replace(axial_force=3.0), VelocityDependentFriction(), periods=4000
    )
    assert _steady(table) == pytest.approx((3.0 - 0.940) / 2.213, rel=1e-10)
    series = taylor.simulate(
        motion, SLIDER.replace(axial_force=3.0), VelocityDependentFriction(), periods=30
    )
    assert table.max_velocity[:30] == pytest.approx(series.max_velocity, rel=1e-12)
    assert table.min_velocity[:30] == pytest.approx(series.min_velocity, rel=1e-12)


def test_solution_goes_on_from_a_given_velocity():
    motion = parabolic_sawtooth(3, maximum_frequency=9250.0)
    whole = simulate(motion, SLIDER, LAWS[1], periods=60)
    first = simulate(motion, SLIDER, LAWS[1], periods=25)
    rest = simulate(motion, SLIDER, LAWS[1], periods=35, initial_velocity=first.final_velocity)
    assert rest.mean_velocity == pytest.approx(whole.mean_velocity[25:], rel=1e-12)
    assert first.final_position + rest.final_position == pytest.approx(
        whole.final_position, rel=1e-12
    )


def test_a_hundred_thousand_periods_lose_no_digits():
    motion = parabolic_sawtooth(3, maximum_frequency=18500.0)
    table = simulate(motion, SLIDER, LAWS[1], periods=100_000)
    late = table.mean_velocity[2000:]
    assert np.ptp(late) < 1e-13 * late[0] * 100


def test_motion_can_be_sampled_anywhere_and_nowhere_else():
    motion = parabolic_sawtooth(4, maximum_frequency=4625.0)
    table = simulate(motion, SLIDER, LAWS[0], periods=6, record=True)
    t = np.linspace(0.0, 6 * motion.period, 60_001)
    seen = table.trajectory.sample(t)
    assert seen.position[-1] == pytest.approx(table.final_position, rel=1e-10)
    steps = np.diff(seen.position) - 0.5 * np.diff(t) * (seen.velocity[1:] + seen.velocity[:-1])
    # trapezoids miss dt^2 / 8 times the jump of the acceleration where sliding begins or ends
    assert np.abs(steps).max() < (t[1] - t[0]) ** 2 / 8 * 1e4
    assert seen.velocity[seen.is_sticking] == pytest.approx(seen.rod_velocity[seen.is_sticking])
    assert seen.is_sticking.mean() == pytest.approx(table.stick_share.mean(), abs=1e-3)
    for time in (-1e-9, 6.001 * motion.period):
        with pytest.raises(BadInputError):
            table.trajectory.sample(time)


def test_unsuitable_laws_and_loads_are_refused():
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    assert not applies(StribeckFriction())
    assert not applies(LAWS[0], LoadParameters())
    for call in (
        lambda: simulate(motion, SLIDER, StribeckFriction(), periods=1),
        lambda: simulate(motion, SLIDER, LAWS[0], load=LoadParameters(), periods=1),
        lambda: simulate(motion, SLIDER, LAWS[0], periods=0),
        lambda: simulate(motion, SLIDER, LAWS[0], periods=1, initial_velocity=math.nan),
    ):
        with pytest.raises(BadInputError):
            call()


@pytest.mark.parametrize("law", [CoulombFriction(), VelocityDependentFriction()])
@pytest.mark.parametrize("harmonics", [2, 3, 4])
@pytest.mark.parametrize("frequency", [2312.5, 18500.0, 60e3])
def test_solution_that_ends_when_steady_is_the_whole_one(law, harmonics, frequency):
    motion = parabolic_sawtooth(harmonics, maximum_frequency=frequency)
    whole, until = (
        simulate(motion, SLIDER, law, periods=4000, until_steady=flag) for flag in (False, True)
    )
    scale = float(np.abs(motion.velocity(np.linspace(0.0, motion.period, 1000))).max())
    for name in ("mean_velocity", "min_velocity", "max_velocity", "mean_relative_speed"):
        difference = np.abs(getattr(whole, name) - getattr(until, name))
        # what changes by 1e-15 per period, and shrinks by 1e-3 of it, has 1e-12 left to go
        assert difference.max() <= 1e-12 * scale, name
    assert until.periods == 4000
    assert np.abs(whole.stick_share - until.stick_share).max() <= 1e-9
    assert until.final_position == pytest.approx(whole.final_position, abs=1e-12 * scale)


def test_slider_that_runs_away_is_never_taken_for_steady():
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    table = simulate(
        motion, SLIDER, CoulombFriction(), load=_weight(2.0), periods=300, until_steady=True
    )
    rises = np.diff(table.mean_velocity)[200:]
    # constant acceleration once the rod is always the slower one: (2.0 - 1.01) N on 6.92 g
    assert rises == pytest.approx(-(2.0 - 1.01) / SLIDER.mass * motion.period, rel=1e-9)

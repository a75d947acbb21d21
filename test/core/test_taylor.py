"""The power-series solver on springs, end stops and Stribeck friction."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from imotor_ros.core.friction import (
    CoulombFriction,
    StribeckFriction,
    VelocityDependentFriction,
)
from imotor_ros.core.signals import HarmonicMotion, parabolic_sawtooth, sine
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.solution import summarise
from imotor_ros.core.taylor import simulate
from imotor_ros.errors import BadInputError

SLIDER = SliderParameters()
MASS = SLIDER.mass
LAWS = (
    CoulombFriction(),
    VelocityDependentFriction(),
    StribeckFriction(),
    StribeckFriction(exponent=1),
    StribeckFriction(break_away_force=1.5),
)
SPRING = LoadParameters(spring_stiffness=3e3, stop_stiffness=0.0)
STOPS = LoadParameters(lower_stop=-20e-6, upper_stop=30e-6)
HARD_STOPS = LoadParameters(upper_stop=30e-6, stop_stiffness=1e5, stop_damping=0.0)


def _work_and_changes(motion, law, load, table, periods):
    """Work of the rod on the slider, friction loss, kinetic energy, work on the load; turnover."""
    edges = np.unique([0.0, *table.trajectory.step_times, periods * motion.period])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    numbers = load.numbers
    work = loss = pushed = turnover = 0.0
    for a, b in itertools.pairwise(edges):
        t = a + (b - a) * (nodes + 1) / 2
        seen = table.trajectory.sample(t)
        x, v = seen.position, seen.velocity
        force = numbers.spring_stiffness * (x - numbers.spring_position) + numbers.constant_force
        for side, surface in ((1, numbers.upper_stop), (-1, numbers.lower_stop)):
            if math.isfinite(surface):
                touch = numbers.stop_stiffness * (x - surface) + numbers.stop_damping * v
                force = force + np.where(
                    (x - surface) * side > 0, side * np.maximum(side * touch, 0), 0
                )
        w = seen.rod_velocity - v
        need = MASS * motion.acceleration(t) + force
        friction = np.where(seen.is_sticking, need, np.sign(w) * law.force(np.abs(w)))
        half = (b - a) / 2
        work += half * float(weights @ (friction * seen.rod_velocity))
        turnover += half * float(weights @ np.abs(friction * seen.rod_velocity))
        loss += half * float(weights @ (friction * w))
        pushed += half * float(weights @ (force * v))
    return work, loss, 0.5 * MASS * table.final_velocity**2, pushed, turnover


@pytest.mark.parametrize("load", [SPRING, STOPS, HARD_STOPS], ids=["spring", "stops", "hard"])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_work_of_the_rod_goes_into_friction_motion_and_load(law, load):
    motion, periods = parabolic_sawtooth(3, maximum_frequency=9250.0), 12
    table = simulate(motion, SLIDER, law, load=load, periods=periods, record=True)
    work, loss, kinetic, pushed, _ = _work_and_changes(motion, law, load, table, periods)
    assert loss > 0.0
    assert pushed != 0.0
    assert work == pytest.approx(loss + kinetic + pushed, rel=1e-10)


def test_stuck_slider_on_a_spring_has_the_spring_s_energy():
    motion = sine(0.5e-6, 2000.0)
    table = simulate(
        motion, SLIDER, CoulombFriction(), load=SPRING, periods=3,
        initial_velocity=float(motion.velocity(0.0)), record=True,
    )  # fmt: skip
    assert (table.stick_share == 1.0).all()
    t = np.linspace(0.0, 3 * motion.period, 100)
    assert table.trajectory.sample(t).position == pytest.approx(motion.position(t), abs=1e-18)


def test_slider_leaves_a_stop_as_an_undamped_spring_throws_it_back():
    # Next to no friction, rod at rest: into the stop with v, out with -v.
    law, motion = CoulombFriction(sliding_force=1e-9), sine(0.0, 100.0)
    load = LoadParameters(upper_stop=1e-4, stop_stiffness=1e5, stop_damping=0.0)
    table = simulate(motion, SLIDER, law, load=load, periods=1, initial_velocity=0.05, record=True)
    contact = math.pi * math.sqrt(MASS / 1e5)
    assert table.max_velocity[0] == 0.05
    assert table.min_velocity[0] == pytest.approx(-0.05, rel=1e-6)
    expected = 1e-4 - 0.05 * (motion.period - 1e-4 / 0.05 - contact)
    assert table.final_position == pytest.approx(expected, rel=1e-6)


def test_damped_stop_never_pulls():
    law, motion = CoulombFriction(sliding_force=1e-9), sine(0.0, 100.0)
    load = LoadParameters(upper_stop=1e-4, stop_stiffness=1e4, stop_damping=10.0)
    table = simulate(motion, SLIDER, law, load=load, periods=1, initial_velocity=0.05, record=True)

    def rate(t, y):
        depth = y[0] - 1e-4
        push = max(0.0, 1e4 * depth + 10.0 * y[1]) if depth > 0 else 0.0
        return [y[1], -push / MASS]

    found = solve_ivp(rate, (0, 0.01), [0.0, 0.05], rtol=1e-10, atol=1e-13, max_step=1e-5)
    t = np.linspace(0.0, 0.01, 50)
    seen = np.interp(t, found.t, found.y[1])
    assert table.trajectory.sample(t).velocity == pytest.approx(seen, abs=2e-4)
    assert table.final_velocity == pytest.approx(found.y[1, -1], rel=1e-5)
    # a stop that held the slider back while it leaves would make it slower
    assert table.mean_load_force[0] > 0.0


def test_soft_spring_measures_the_same_force_whatever_its_stiffness():
    motion = parabolic_sawtooth(3, maximum_frequency=18500.0)
    forces = []
    for stiffness in (1e3, 5e3, 20e3):
        load = LoadParameters(spring_stiffness=stiffness, stop_stiffness=0.0)
        table = simulate(motion, SLIDER, CoulombFriction(), load=load, periods=1500)
        found = summarise(table, has_load=True)
        assert found.is_steady
        forces.append(found.force)
    assert np.ptp(forces) < 0.01 * forces[0]
    # at this frequency the slider is nearly held: F_0 (2 P(v_R > 0) - 1)
    assert forces[0] == pytest.approx(0.375 * 1.01, rel=0.05)
    # the end stop is a spring as well
    load = LoadParameters(upper_stop=0.2e-3)
    table = simulate(motion, SLIDER, CoulombFriction(), load=load, periods=1500)
    assert summarise(table, has_load=True).force == pytest.approx(forces[-1], rel=0.01)


def test_force_grows_with_the_number_of_harmonics_and_hardly_with_frequency():
    load = LoadParameters(spring_stiffness=10e3, stop_stiffness=0.0)
    force = {}
    for n, frequency in itertools.product((2, 3, 4), (9250.0, 18500.0)):
        motion = parabolic_sawtooth(n, maximum_frequency=frequency)
        table = simulate(motion, SLIDER, CoulombFriction(), load=load, periods=1500)
        force[n, frequency] = summarise(table, has_load=True).force
    assert force[2, 18500.0] < force[3, 18500.0] < force[4, 18500.0]
    for n in (2, 3, 4):
        assert force[n, 9250.0] == pytest.approx(force[n, 18500.0], rel=0.15)


def test_stribeck_friction_with_a_wide_and_a_narrow_fall_agrees_with_a_general_integrator():
    motion = parabolic_sawtooth(2, maximum_frequency=18500.0)
    for law in (
        StribeckFriction(),
        StribeckFriction(exponent=1),
        StribeckFriction(decay_velocity=0.1),
    ):
        table = simulate(motion, SLIDER, law, periods=3, record=True)

        # this drive slides throughout: the sign of w alone makes the equation piecewise smooth
        assert (table.stick_share == 0.0).all()
        edges = [0.0, *table.trajectory.event_times, 3 * motion.period]
        v = 0.0
        for a, b in itertools.pairwise(edges):
            middle = table.trajectory.sample(0.5 * (a + b))
            sign = math.copysign(1.0, float(middle.rod_velocity - middle.velocity))

            def rate(t, y, sign=sign, law=law):
                w = sign * (float(motion.velocity(t)) - y[0])
                return [sign * float(law.force(max(w, 0.0))) / MASS]

            found = solve_ivp(
                rate, (a, b), [v], method="DOP853", rtol=1e-12, atol=1e-15,
                max_step=motion.period / 400,
            )  # fmt: skip
            v = found.y[0, -1]
        assert table.final_velocity == pytest.approx(v, rel=1e-8)


def test_equal_static_and_sliding_force_make_stribeck_the_line():
    motion = parabolic_sawtooth(4, maximum_frequency=4625.0)
    line = VelocityDependentFriction()
    flat = StribeckFriction(sliding_force=0.940, static_force=0.940, slope=2.213)
    a = simulate(motion, SLIDER, line, load=SPRING, periods=20)
    b = simulate(motion, SLIDER, flat, load=SPRING, periods=20)
    assert a.mean_velocity == pytest.approx(b.mean_velocity, rel=1e-12)


motions = st.builds(
    lambda f, pairs: HarmonicMotion(
        f, tuple(a * 1e-6 for a, _ in pairs), tuple(p for _, p in pairs)
    ),
    st.sampled_from([300.0, 2000.0, 9250.0]),
    st.lists(st.tuples(st.floats(1e-3, 10.0), st.floats(-3.2, 3.2)), min_size=1, max_size=5),
)
loads = st.builds(
    LoadParameters,
    spring_stiffness=st.sampled_from([0.0, 100.0, 5e3, 8e4]),
    constant_force=st.floats(-0.5, 0.5),
    lower_stop=st.floats(-30e-6, -1e-6),
    upper_stop=st.floats(0.0, 30e-6),
    stop_stiffness=st.sampled_from([0.0, 1e3, 2e4, 1e6]),
    stop_damping=st.sampled_from([0.0, 1.0, 20.0]),
)


@settings(deadline=None, derandomize=True, database=None, max_examples=150)
@given(motions, st.sampled_from(LAWS), loads)
def test_no_motion_law_or_load_stalls_or_creates_energy(motion, law, load):
    table = simulate(motion, SLIDER, law, load=load, periods=6, record=True)
    work, loss, kinetic, pushed, turnover = _work_and_changes(motion, law, load, table, 6)
    size = turnover + loss + kinetic + abs(pushed)
    assert loss >= -1e-12 * size
    assert work == pytest.approx(loss + kinetic + pushed, abs=1e-9 * size + 1e-22)
    assert ((table.stick_share >= 0.0) & (table.stick_share <= 1.0 + 1e-12)).all()
    mirrored = LoadParameters(
        spring_stiffness=load.spring_stiffness, constant_force=-load.constant_force,
        lower_stop=-load.upper_stop, upper_stop=-load.lower_stop,
        stop_stiffness=load.stop_stiffness, stop_damping=load.stop_damping,
    )  # fmt: skip
    other = simulate(motion.scaled(-1.0), SLIDER, law, load=mirrored, periods=1)
    assert other.mean_velocity[0] == pytest.approx(
        -table.mean_velocity[0], abs=1e-9 * table.mean_relative_speed[0] + 1e-15
    )


def test_unusable_starts_are_refused():
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    for start in ({"periods": 0}, {"periods": 1, "initial_position": math.inf}):
        with pytest.raises(BadInputError):
            simulate(motion, SLIDER, CoulombFriction(), **start)

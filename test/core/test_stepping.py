"""The sampled slider solver: accuracy, forces, and independence of the cutting into blocks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imotor_ros.core import closed_form, sampled, taylor
from imotor_ros.core.friction import (
    CoulombFriction,
    StribeckFriction,
    VelocityDependentFriction,
)
from imotor_ros.core.signals import parabolic_sawtooth, sine
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.solution import summarise
from imotor_ros.core.stepping import SliderStepper
from imotor_ros.errors import BadInputError

SLIDER = SliderParameters()
FREE = LoadParameters.free()
RATE = 1e6
LAWS = (CoulombFriction(), VelocityDependentFriction())
GRID = [(n, f) for n in (2, 3, 4) for f in (2312.5, 4625.0, 9250.0, 18500.0)]
STOPS = LoadParameters(spring_stiffness=500.0, lower_stop=-20e-6, upper_stop=50e-6)


def _motion(motion, seconds, rate=RATE):
    t = np.arange(round(seconds * rate)) / rate
    return t, motion.velocity(t), motion.acceleration(t)


@pytest.mark.parametrize("law", LAWS, ids=["coulomb", "velocity"])
@pytest.mark.parametrize(("n", "frequency"), GRID)
def test_mean_velocity_at_1_mhz_is_that_of_the_closed_form(law, n, frequency):
    motion = parabolic_sawtooth(n, maximum_frequency=frequency)
    periods = 40
    table = sampled.simulate(motion, SLIDER, law, periods=periods, sample_rate=RATE)
    exact = closed_form.simulate(motion, SLIDER, law, periods=periods)
    # the cubic between samples errs by (2 pi f_n / rate)^4 / 384 of the rod velocity
    tolerance = 1e-6 + 3.0 * (2 * np.pi * frequency / RATE) ** 4
    assert tolerance < 1e-3
    steady = slice(-10, None)
    assert table.mean_velocity[steady].mean() == pytest.approx(
        exact.mean_velocity[steady].mean(), rel=tolerance
    )
    assert table.mean_relative_speed == pytest.approx(exact.mean_relative_speed, rel=0.02)
    assert table.stick_share == pytest.approx(exact.stick_share, abs=4 / RATE / motion.period)
    a, b = summarise(table, has_load=False), summarise(exact, has_load=False)
    assert a.durability == pytest.approx(b.durability, rel=1e-4)
    # extremes fall between samples: the slider's acceleration times half a sample, twice
    assert a.ripple == pytest.approx(b.ripple, abs=2 * 400.0 / RATE / abs(b.mean_velocity))


@pytest.mark.parametrize(
    ("law", "load"),
    [
        (LAWS[0], FREE),
        (LAWS[1], STOPS),
        (StribeckFriction(), FREE),
        (StribeckFriction(exponent=1, break_away_force=1.6), STOPS),
        (LAWS[0], LoadParameters(upper_stop=20e-6, stop_stiffness=2e6, stop_damping=0.0)),
    ],
)
def test_samples_lie_on_the_continuous_solution(law, load):
    motion = parabolic_sawtooth(3, maximum_frequency=9250.0)
    t, velocity, acceleration = _motion(motion, 20 * motion.period)
    ours = SliderStepper(SLIDER, load, law, RATE).process(velocity, acceleration)
    exact = taylor.simulate(motion, SLIDER, law, load=load, periods=20, record=True)
    seen = exact.trajectory.sample(t)
    # the cubic errs by 1e-8 of the rod velocity; a hard stop multiplies that at each impact
    assert np.abs(ours.velocity - seen.velocity).max() < 3e-6 * np.abs(velocity).max()
    assert np.abs(ours.position - seen.position).max() < 1e-6 * 15e-6 + 1e-6 * np.ptp(seen.position)


@pytest.mark.parametrize("rate", [1e6, 2e6])
def test_error_falls_with_the_fourth_power_of_the_sample_rate(rate):
    motion = parabolic_sawtooth(2, maximum_frequency=18500.0)
    errors = []
    exact = closed_form.simulate(motion, SLIDER, LAWS[1], periods=300)
    for each in (rate, 2 * rate):
        table = sampled.simulate(motion, SLIDER, LAWS[1], periods=300, sample_rate=each)
        errors.append(abs(table.mean_velocity[-50:].mean() - exact.mean_velocity[-50:].mean()))
    assert 10.0 < errors[0] / errors[1] < 25.0


@pytest.mark.parametrize(
    "law", [*LAWS, StribeckFriction()], ids=["coulomb", "velocity", "stribeck"]
)
@pytest.mark.parametrize("load", [FREE, STOPS], ids=["free", "stops"])
@pytest.mark.parametrize("block", [1, 777, 10_000])
def test_blocks_of_any_length_give_the_same_samples(law, load, block):
    motion = parabolic_sawtooth(3, maximum_frequency=18500.0)
    _, velocity, acceleration = _motion(motion, 0.012)
    rng = np.random.default_rng(7)
    axial, normal = 0.1 * rng.standard_normal((2, velocity.size))
    whole = SliderStepper(SLIDER, load, law, RATE).process(velocity, acceleration, axial, normal)
    stepper = SliderStepper(SLIDER, load, law, RATE)
    parts = [
        stepper.process(*(x[i : i + block] for x in (velocity, acceleration, axial, normal)))
        for i in range(0, velocity.size, block)
    ]
    for name in ("position", "velocity", "load_force", "friction_force", "is_sticking"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(joined, getattr(whole, name)), name


def test_state_carries_everything():
    motion = parabolic_sawtooth(4, maximum_frequency=4625.0)
    _, velocity, acceleration = _motion(motion, 0.004)
    first = SliderStepper(SLIDER, STOPS, LAWS[1], RATE)
    whole = first.process(velocity, acceleration)
    second, third = (SliderStepper(SLIDER, STOPS, LAWS[1], RATE) for _ in range(2))
    second.process(velocity[:1500], acceleration[:1500])
    third.state = second.state
    rest = third.process(velocity[1500:], acceleration[1500:])
    assert np.array_equal(rest.position, whole.position[1500:])
    second.reset()
    assert np.array_equal(second.process(velocity, acceleration).position, whole.position)


def test_read_only_and_empty_blocks_are_taken():
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    _, velocity, acceleration = _motion(motion, 0.001)
    expected = SliderStepper(SLIDER, FREE, LAWS[0], RATE).process(velocity, acceleration)
    stepper = SliderStepper(SLIDER, FREE, LAWS[0], RATE)
    assert stepper.process([], []).position.size == 0
    assert stepper.state is None
    frozen = np.frombuffer(velocity.tobytes())
    assert np.array_equal(stepper.process(frozen, acceleration).velocity, expected.velocity)


@pytest.mark.parametrize(
    "law", [*LAWS, StribeckFriction()], ids=["coulomb", "velocity", "stribeck"]
)
def test_friction_force_is_the_law_while_sliding_and_what_is_needed_while_sticking(law):
    motion = parabolic_sawtooth(4, maximum_frequency=4625.0)
    _, velocity, acceleration = _motion(motion, 0.01)
    seen = SliderStepper(SLIDER, STOPS, law, RATE).process(velocity, acceleration)
    w = velocity - seen.velocity
    sliding = ~seen.is_sticking
    assert 0.1 < sliding.mean() < 0.95
    assert (w[seen.is_sticking] == 0.0).all()
    expected = np.sign(w) * law.force(np.abs(w))
    assert seen.friction_force[sliding] == pytest.approx(expected[sliding], rel=1e-12)
    need = SLIDER.mass * acceleration + seen.load_force
    assert seen.friction_force[seen.is_sticking] == pytest.approx(need[seen.is_sticking])
    assert np.abs(seen.friction_force[seen.is_sticking]).max() <= law.break_away * (1 + 1e-9)
    x = seen.position
    spring = 500.0 * x
    stop = seen.load_force - spring
    assert (stop[(x > -20e-6) & (x < 50e-6)] == 0.0).all()
    assert (stop[x > 50e-6] >= 0.0).all()
    assert (stop > 0.0).any()


def test_axial_force_array_acts_as_a_constant_force_does():
    motion = parabolic_sawtooth(3, maximum_frequency=9250.0)
    _, velocity, acceleration = _motion(motion, 0.01)
    for law in (*LAWS, StribeckFriction()):
        constant = SliderStepper(SLIDER.replace(axial_force=-0.2), FREE, law, RATE)
        array = SliderStepper(SLIDER, FREE, law, RATE)
        a = constant.process(velocity, acceleration)
        b = array.process(velocity, acceleration, axial_force=np.full(velocity.size, -0.2))
        assert a.position == pytest.approx(b.position, rel=1e-12, abs=1e-20)
        assert (a.load_force == 0.0).all()


def test_normal_force_array_scales_friction():
    motion = parabolic_sawtooth(3, maximum_frequency=9250.0)
    _, velocity, acceleration = _motion(motion, 0.01)
    for law in (*LAWS, StribeckFriction()):
        constant = SliderStepper(SLIDER.replace(normal_force=1.5), FREE, law, RATE)
        array = SliderStepper(SLIDER, FREE, law, RATE)
        a = constant.process(velocity, acceleration)
        b = array.process(velocity, acceleration, normal_force=np.full(velocity.size, 1.5))
        assert a.position == pytest.approx(b.position, rel=1e-10)


def test_rising_normal_force_stops_a_slide_as_its_integral_says():
    # Rod at rest, slider thrown: v falls by the integral of mu (N_0 + N_1 t) / m.
    slider, law = SLIDER, CoulombFriction()
    count = 4000
    normal = np.linspace(0.0, 4.0, count)
    still = np.zeros(count)
    stepper = SliderStepper(slider, FREE, law, RATE, velocity=0.3)
    seen = stepper.process(still, still, normal_force=normal)
    t = np.arange(count) / RATE
    scale = 1.0 + (normal[-1] / t[-1]) * t / 2 / slider.nominal_contact_force
    expected = np.maximum(0.3 - law.sliding_force * scale * t / slider.mass, 0.0)
    assert seen.velocity == pytest.approx(expected, abs=1e-13)
    assert seen.is_sticking[-1]
    lifted = SliderStepper(slider, FREE, law, RATE, velocity=0.3)
    free = lifted.process(still, still, normal_force=np.full(count, -20.0))
    assert free.velocity == pytest.approx(0.3, rel=1e-14)


def test_two_crossings_within_one_sample_are_both_seen():
    # The rod overtakes the slider and falls back between two samples.
    rate, law = 1e5, CoulombFriction()
    stepper = SliderStepper(SLIDER, FREE, law, rate, velocity=0.101)
    seen = stepper.process([0.1, 0.1, 0.1], [3e3, -3e3, 0.0])
    # rod: 0.1 + 3000 t (1 - t / T) within the sample, up to 7.5 mm/s above its ends
    u = np.linspace(0.0, 1.0, 200_001)
    rod = 0.1 + 3e3 * u * (1 - u) / rate
    v, dt = 0.101, 1.0 / rate / 200_000
    for value in rod:
        v += np.sign(value - v) * law.sliding_force / SLIDER.mass * dt
    # Euler's method errs by its step times the acceleration, at each of the crossings
    assert seen.velocity[1] == pytest.approx(v, abs=1e-8)
    assert not seen.is_sticking[1]


@settings(deadline=None, derandomize=True, database=None, max_examples=60)
@given(
    st.floats(100.0, 40e3), st.floats(1e-8, 2e-5), st.sampled_from([1e5, 1e6]),
    st.sampled_from([*LAWS, StribeckFriction()]), st.sampled_from([FREE, STOPS]),
)  # fmt: skip
def test_any_sine_is_followed(frequency, amplitude, rate, law, load):
    motion = sine(amplitude, frequency)
    t, velocity, acceleration = _motion(motion, 10 / frequency, rate)
    if t.size < 2:
        return
    seen = SliderStepper(SLIDER, load, law, rate).process(velocity, acceleration)
    assert np.isfinite(seen.position).all()
    # friction cannot give the slider more speed than the rod has, nor can spring and stops
    # that were relaxed at the start
    assert np.abs(seen.velocity).max() <= np.abs(velocity).max() * 1.1 + 1e-12


def test_unusable_blocks_are_refused():
    stepper = SliderStepper(SLIDER, FREE, LAWS[0], RATE)
    for arrays in (
        ([0.0, 1.0], [0.0]),
        ([[0.0]], [[0.0]]),
        ([np.nan], [0.0]),
        ([0.0], [0.0], [np.inf]),
        ([0.0], [0.0], None, [0.0, 1.0]),
    ):
        with pytest.raises(BadInputError):
            stepper.process(*arrays)
    for rate in (0.0, -1.0, np.inf):
        with pytest.raises(BadInputError):
            SliderStepper(SLIDER, FREE, LAWS[0], rate)
    with pytest.raises(BadInputError):
        sampled.simulate(
            parabolic_sawtooth(2, maximum_frequency=1e5),
            SLIDER,
            LAWS[0],
            periods=1,
            sample_rate=1e5,
        )

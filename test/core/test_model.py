"""Predicted indicators, and what is said where one is missing."""

import math

import pytest

from imotor_ros.core.friction import (
    CoulombFriction,
    StribeckFriction,
    VelocityDependentFriction,
)
from imotor_ros.core.model import predict
from imotor_ros.core.signals import parabolic_sawtooth, sine
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.errors import BadInputError

SLIDER = SliderParameters()
SPRING = LoadParameters(spring_stiffness=10e3, stop_stiffness=0.0)


@pytest.mark.parametrize(
    ("law", "load", "rate", "solver"),
    [
        (CoulombFriction(), None, None, "closed_form"),
        (VelocityDependentFriction(), LoadParameters(constant_force=0.1, stop_stiffness=0.0), None,
         "closed_form"),
        (StribeckFriction(), None, None, "taylor"),
        (CoulombFriction(), SPRING, None, "taylor"),
        (CoulombFriction(), None, 1e6, "stepping"),
    ],
)  # fmt: skip
def test_solver_is_the_fastest_that_applies(law, load, rate, solver):
    motion = parabolic_sawtooth(3, maximum_frequency=18500.0)
    found = predict(motion, SLIDER, law, load, 400, rate)
    assert found.solver == solver
    assert found.periods == 400


def test_indicators_of_a_free_run():
    motion = parabolic_sawtooth(2, maximum_frequency=18500.0)
    found = predict(motion, SLIDER, CoulombFriction())
    assert found.is_steady
    assert found.mean_velocity == pytest.approx(0.17544529452, rel=1e-9)
    # sliding throughout, reversing where rod and slider meet: equation (10)
    assert 0.04 < found.ripple < 0.05
    assert 0.0 < found.durability < 1.0
    assert found.force is None
    assert "no load" in found.reasons["force"]
    # some 200 of 9250 periods per second
    assert found.start_up_time == pytest.approx(0.0209, rel=0.02)


@pytest.mark.parametrize("n", [2, 3, 4])
@pytest.mark.parametrize("frequency", [2312.5, 18500.0])
def test_sampled_prediction_agrees_with_the_exact_one(n, frequency):
    motion = parabolic_sawtooth(n, maximum_frequency=frequency)
    exact = predict(motion, SLIDER, VelocityDependentFriction(), periods=400)
    sampled = predict(motion, SLIDER, VelocityDependentFriction(), periods=400, sample_rate=1e6)
    assert sampled.mean_velocity == pytest.approx(exact.mean_velocity, rel=1e-6)
    assert sampled.ripple == pytest.approx(exact.ripple, rel=1e-3)
    assert sampled.durability == pytest.approx(exact.durability, rel=1e-5)
    assert sampled.start_up_time == pytest.approx(exact.start_up_time, rel=1e-4)


def test_force_is_that_of_the_spring():
    motion = parabolic_sawtooth(4, maximum_frequency=9250.0)
    found = predict(motion, SLIDER, CoulombFriction(), SPRING)
    assert found.is_steady
    assert 0.2 < found.force < 0.4755 * 1.01 * 1.05
    assert abs(found.mean_velocity) < 1e-9
    assert found.ripple is None
    assert "does not move" in found.reasons["ripple"]
    assert found.start_up_time is None
    sampled = predict(motion, SLIDER, CoulombFriction(), SPRING, sample_rate=1e6)
    assert sampled.force == pytest.approx(found.force, rel=1e-5)


def test_sine_moves_nothing_on_the_average():
    found = predict(sine(5e-6, 4000.0), SLIDER, CoulombFriction(), periods=8000)
    assert found.ripple is None
    assert found.start_up_time is None
    stuck = predict(sine(1e-8, 100.0), SLIDER, CoulombFriction(), periods=100)
    assert stuck.durability is None or stuck.durability < 1e-6


def test_run_too_short_to_be_steady_is_said_so():
    motion = parabolic_sawtooth(2, maximum_frequency=18500.0)
    found = predict(motion, SLIDER, CoulombFriction(), periods=40)
    assert not found.is_steady
    assert "not steady" in found.reasons["mean_velocity"]
    one = predict(motion, SLIDER, CoulombFriction(), periods=1)
    assert not one.is_steady
    assert math.isfinite(one.mean_velocity)


@pytest.mark.parametrize("rate", [None, 1e6])
def test_no_periods_are_refused(rate):
    motion = parabolic_sawtooth(2, maximum_frequency=18500.0)
    with pytest.raises(BadInputError, match="periods"):
        predict(motion, SLIDER, CoulombFriction(), periods=0, sample_rate=rate)

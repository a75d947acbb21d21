"""LuGre friction: its steady law, its spring, and its stepper against an implicit solver."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from imotor_ros.core.friction import StribeckFriction
from imotor_ros.core.lugre import LuGreFriction, LuGreStepper
from imotor_ros.core.model import predict
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.signals import parabolic_sawtooth, sine
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.errors import BadInputError

RATE = 1e6
MASS = SliderParameters().mass


def follow(friction: LuGreFriction, rod_velocity, rod_acceleration, load=None):
    stepper = LuGreStepper(SliderParameters(), load or LoadParameters.free(), friction, RATE)
    return stepper.process(rod_velocity, rod_acceleration)


@pytest.mark.parametrize("stiffness", [5e6, 5e7, 5e8])
@pytest.mark.parametrize("static_force", [0.94, 1.2])
@pytest.mark.parametrize("amplitude", [0.3e-6, 1.2e-6, 4e-6])
def test_stepper_agrees_with_an_implicit_solver(
    stiffness: float, static_force: float, amplitude: float
) -> None:
    """Within 2e-4 of the largest velocity; the short steps are of second order."""
    friction = LuGreFriction(stiffness=stiffness, static_force=static_force)
    motion = sine(amplitude, 2000.0)
    time = np.arange(1200) / RATE

    def rates(t, y):
        w = float(motion.velocity(t)) - y[1]
        excess = friction.static_force - friction.sliding_force
        g = friction.sliding_force + excess * math.exp(-((w / friction.decay_velocity) ** 2))
        dz = w - friction.stiffness * abs(w) * y[2] / g
        force = friction.stiffness * y[2] + friction.damping * dz + friction.slope * w
        return [y[1], force / MASS, dz]

    found = follow(friction, motion.velocity(time), motion.acceleration(time))
    exact = solve_ivp(
        rates, (0.0, time[-1]), [0.0, 0.0, 0.0], method="LSODA", rtol=1e-8, atol=1e-13,
        t_eval=time, max_step=2e-6,
    )  # fmt: skip
    error = np.abs(found.velocity - exact.y[1]).max() / np.abs(exact.y[1]).max()
    assert error < 2e-4
    assert np.abs(found.position - exact.y[0]).max() < 1e-3 * amplitude


@pytest.mark.parametrize(
    ("speed", "static_force"), [(0.005, 0.94), (0.1, 0.94), (0.06, 1.2), (0.1, 1.2)]
)
def test_steady_sliding_follows_the_law(speed: float, static_force: float) -> None:
    """
    A spring holds the slider over a rod of constant velocity: its load is the friction.

    Speeds at which the force does not fall with the speed: there it would swing for ever.
    """
    friction = LuGreFriction(static_force=static_force, decay_velocity=0.02)
    law = StribeckFriction(static_force=static_force, decay_velocity=0.02)
    load = LoadParameters.free().replace(spring_stiffness=1e5, spring_position=0.0)
    found = follow(friction, np.full(60_000, speed), np.zeros(60_000), load)
    expected = float(law.force(speed))
    assert found.load_force[-20_000:].mean() == pytest.approx(expected, rel=2e-3)
    assert friction.force(speed) == pytest.approx(expected)


def test_slider_sticks_on_a_spring() -> None:
    """Below break-away: amplitude 1 / (1 - w^2 m / sigma_0) of the rod's, a resonator's answer."""
    friction = LuGreFriction(stiffness=5e7, damping=200.0)
    motion = sine(0.05e-6, 2000.0)
    time = np.arange(20_000) / RATE
    found = follow(friction, motion.velocity(time), motion.acceleration(time))
    ratio = found.velocity[-5000:].std() / motion.velocity(time[-5000:]).std()
    expected = 1.0 / (1.0 - (2.0 * math.pi * 2000.0) ** 2 * MASS / 5e7)
    assert ratio == pytest.approx(expected, rel=2e-3)
    assert found.is_sticking[-5000:].all()


def test_end_stop_pushes_and_never_pulls() -> None:
    load = LoadParameters(lower_stop=-1e-3, upper_stop=20e-6)
    velocity = np.full(30_000, 0.05)
    found = follow(LuGreFriction(), velocity, np.zeros(30_000), load)
    assert (found.load_force >= 0.0).all()
    expected = 0.94 + 2.213 * 0.05
    assert found.load_force[-5000:].mean() == pytest.approx(expected, rel=2e-3)


def test_blocks_make_no_difference() -> None:
    motion = sine(2e-6, 2000.0)
    time = np.arange(3000) / RATE
    velocity, acceleration = motion.velocity(time), motion.acceleration(time)
    whole = follow(LuGreFriction(), velocity, acceleration)
    stepper = LuGreStepper(SliderParameters(), LoadParameters.free(), LuGreFriction(), RATE)
    parts = []
    for first, last in ((0, 0), (0, 1), (1, 778), (778, 779), (779, 3000)):
        parts.append(stepper.process(velocity[first:last], acceleration[first:last]))
    for name in ("position", "velocity", "load_force", "friction_force", "is_sticking"):
        joined = np.concatenate([getattr(one, name) for one in parts])
        assert np.array_equal(joined, getattr(whole, name)), name


def test_motor_with_an_elastic_contact() -> None:
    mapping = {"friction": {"law": "lugre", "stiffness": 1e8}}
    parameters = MotorParameters.from_mapping(mapping)
    assert parameters.to_mapping()["friction"]["law"] == "lugre"
    motor = VirtualMotor(parameters, RATE, 1)
    response = motor.process(np.sin(2.0 * np.pi * 2000.0 * np.arange(4000) / RATE) * 20.0)
    assert np.isfinite(response.slider_velocity).all()
    assert np.abs(response.slider_velocity).max() > 1e-3


def test_models_refuse_a_law_with_memory() -> None:
    motion = parabolic_sawtooth(2, fundamental_frequency=4625.0)
    with pytest.raises(BadInputError, match="lugre"):
        predict(motion, SliderParameters(), LuGreFriction(), periods=4)


def test_impossible_inputs_are_refused() -> None:
    with pytest.raises(BadInputError, match="below the sliding force"):
        LuGreFriction(static_force=0.5)
    with pytest.raises(BadInputError, match="rod_acceleration"):
        follow(LuGreFriction(), np.zeros(3), np.zeros(2))
    with pytest.raises(BadInputError, match="rod_velocity"):
        follow(LuGreFriction(), np.array([0.0, np.nan]), np.zeros(2))

"""Force of a motor: plateau, critical stiffness and stall."""

import numpy as np
import pytest

from imotor_ros.core import taylor
from imotor_ros.core.force_potential import (
    Estimate,
    MeasuredForce,
    SpringForce,
    evaluate_measured,
    find_plateau,
    spring_force,
    sweep_springs,
    velocity_force_curve,
)
from imotor_ros.core.friction import CoulombFriction, VelocityDependentFriction
from imotor_ros.core.model import predict
from imotor_ros.core.signals import HarmonicMotion, parabolic_sawtooth, sine
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.errors import BadInputError

SLIDER = SliderParameters()
COULOMB = CoulombFriction()


def stall_by_time_shares(motion: HarmonicMotion) -> float:
    """Force on a slider that is held: F_0 times the time forward less the time backward."""
    velocity = motion.velocity(np.linspace(0.0, motion.period, 200_001)[:-1])
    return COULOMB.break_away * (2.0 * float(np.mean(velocity > 0.0)) - 1.0)


@pytest.mark.parametrize("harmonics", [2, 3, 4])
def test_fast_drive_stalls_at_the_force_on_a_held_slider(harmonics: int) -> None:
    # the faster the drive, the less the slider moves within a period
    motion = parabolic_sawtooth(harmonics, maximum_frequency=100e3)
    curve = velocity_force_curve(motion, SLIDER, COULOMB, 3)
    assert curve.stall_force.value == pytest.approx(stall_by_time_shares(motion), rel=2e-3)


def test_velocity_falls_steadily_from_free_run_to_stall() -> None:
    curve = velocity_force_curve(
        parabolic_sawtooth(3, maximum_frequency=9250.0), SLIDER, COULOMB, 5
    )
    assert np.all(np.diff(curve.mean_velocity) < 0.0)
    assert curve.load_force[-1] == curve.stall_force.value
    assert abs(curve.mean_velocity[-1]) < 1e-6 * curve.mean_velocity[0]


def test_soft_springs_feel_the_stall_force() -> None:
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    sweep = sweep_springs(motion, SLIDER, COULOMB, [1e3, 3e3, 1e4])
    stall = velocity_force_curve(motion, SLIDER, COULOMB, 2).stall_force
    # a spring of 10 N/mm already gives way to the slider's motion within a period
    assert sweep.plateau.value == pytest.approx(stall.value, rel=1e-3)
    assert sweep.critical_stiffness.reason


def test_critical_stiffness_is_where_the_force_is_five_percent_lower() -> None:
    motion = parabolic_sawtooth(4, maximum_frequency=4625.0)
    sweep = sweep_springs(motion, SLIDER, COULOMB, [3e2, 1e3, 2e3, 1e6])
    critical = sweep.critical_stiffness
    assert 2e3 < critical.value < 1e6
    assert 0.0 < critical.uncertainty < critical.value
    force = spring_force(motion, SLIDER, COULOMB, critical.value).force
    assert force == pytest.approx(0.95 * sweep.plateau.value, rel=5e-3)


def test_plateau_takes_the_softest_springs_that_agree() -> None:
    forces = [SpringForce(k, f, True, 500) for k, f in ((1, 1.0), (2, 1.004), (3, 0.998), (4, 0.5))]
    plateau = find_plateau(forces)
    assert plateau.value == 1.0
    assert plateau.uncertainty == pytest.approx(0.003)
    assert "at least 3 are needed" in find_plateau(forces[1:]).reason


def test_motor_that_does_not_move_forward_has_no_stall_force() -> None:
    curve = velocity_force_curve(sine(5e-6, 4000.0), SLIDER, COULOMB)
    assert "does not move forward" in curve.stall_force.reason


@pytest.mark.parametrize("stiffness", [0.0, -1.0, float("nan")])
def test_impossible_stiffness_is_refused(stiffness: float) -> None:
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    with pytest.raises(BadInputError, match="stiffness"):
        spring_force(motion, SLIDER, COULOMB, stiffness)


def test_mean_load_is_the_mean_friction_force() -> None:
    """Momentum: over a steady period the slider's velocity comes back to what it was."""
    motion, law = parabolic_sawtooth(2, maximum_frequency=9250.0), VelocityDependentFriction()
    for load in (
        LoadParameters.free().replace(spring_stiffness=2e4),
        LoadParameters(upper_stop=0.0, stop_stiffness=5e4, stop_damping=0.0),
        LoadParameters.free().replace(constant_force=0.1),
    ):
        table = taylor.simulate(motion, SLIDER, law, load=load, periods=400, record=True)
        assert table.trajectory is not None
        times = np.linspace(390.0, 400.0, 200_001)[:-1] * motion.period
        seen = table.trajectory.sample(times)
        push = seen.position * load.spring_stiffness + load.constant_force
        if load.stop_stiffness > 0.0:
            push = np.maximum(seen.position, 0.0) * load.stop_stiffness
        slip = seen.rod_velocity - seen.velocity
        sliding = np.sign(slip) * law.force(np.abs(slip))
        held = SLIDER.mass * motion.acceleration(times) + push
        friction = np.where(seen.is_sticking, held, sliding)
        mean = float(table.mean_load_force[390:].mean())
        assert float(push.mean()) == pytest.approx(mean, rel=1e-4)
        # samples miss where in a step of 11 ns sliding turns: some 1e-4 of the force each
        assert float(friction.mean()) == pytest.approx(mean, abs=2e-4), load


def test_stiff_spring_holds_the_slider() -> None:
    """Coulomb, held: 0.2285 of the friction force, the share of time the rod moves forward."""
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    velocity = motion.velocity(np.linspace(0.0, motion.period, 1_000_001)[:-1])
    held = CoulombFriction().sliding_force * (2.0 * float(np.mean(velocity > 0.0)) - 1.0)
    found = spring_force(motion, SLIDER, CoulombFriction(), 1e8)
    # after each turn the rod takes the spring along by 2 F / k: 2 us of 216 us at 1e4 m/s^2
    assert found.force == pytest.approx(held, rel=1e-2)


def test_load_below_stall_is_lifted_and_one_above_it_comes_down() -> None:
    motion, law = parabolic_sawtooth(3, maximum_frequency=9250.0), VelocityDependentFriction()
    stall = velocity_force_curve(motion, SLIDER, law, 2).stall_force.value
    for share, sign in ((0.98, 1), (1.02, -1)):
        load = LoadParameters.free().replace(constant_force=share * stall)
        assert sign * predict(motion, SLIDER, law, load).mean_velocity > 0.0


def measured(*values: float, uncertainty: float = 0.002) -> list[MeasuredForce]:
    """Return measured forces on springs of 1, 10, 100 ... kN/m."""
    return [
        MeasuredForce(10.0 ** (3 + i), Estimate(value, uncertainty))
        for i, value in enumerate(values)
    ]


def test_measured_plateau_and_critical_stiffness_have_the_uncertainty_of_the_forces() -> None:
    plateau, critical = evaluate_measured(measured(0.2, 0.202, 0.201, 0.18, 0.1))
    assert plateau.value == 0.201
    # half the range of the three, and their own
    assert plateau.uncertainty == pytest.approx(np.hypot(0.001, 0.002))
    # 0.95 * 0.201 lies at 48 % of the way from 0.201 to 0.18, in decades
    assert critical.value == pytest.approx(10 ** (5 + (0.201 - 0.95 * 0.201) / 0.021), rel=1e-9)
    assert 0.25 < critical.uncertainty / critical.value / np.log(10.0) < 0.5


def test_measured_forces_without_plateau_or_drop_say_so() -> None:
    plateau, critical = evaluate_measured(measured(0.1, 0.2, 0.3))
    assert "agree within 3%, at least 3 are needed" in plateau.reason
    assert critical.reason.startswith("there is no plateau")
    missing = MeasuredForce(1e6, Estimate(reason="out of range"))
    plateau, critical = evaluate_measured([*measured(0.2, 0.2, 0.2), missing])
    assert plateau.value == 0.2
    assert critical.reason == "up to 1e+05 N/m no force is 5% below the plateau"

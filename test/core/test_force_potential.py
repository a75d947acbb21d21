"""Force of a motor: plateau, critical stiffness and stall."""

import numpy as np
import pytest

from imotor_ros.core.force_potential import (
    SpringForce,
    find_plateau,
    spring_force,
    sweep_springs,
    velocity_force_curve,
)
from imotor_ros.core.friction import CoulombFriction
from imotor_ros.core.signals import HarmonicMotion, parabolic_sawtooth, sine
from imotor_ros.core.slider import SliderParameters
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
    assert "do not agree" in find_plateau(forces[1:]).reason


def test_motor_that_does_not_move_forward_has_no_stall_force() -> None:
    curve = velocity_force_curve(sine(5e-6, 4000.0), SLIDER, COULOMB)
    assert "does not move forward" in curve.stall_force.reason


@pytest.mark.parametrize("stiffness", [0.0, -1.0, float("nan")])
def test_impossible_stiffness_is_refused(stiffness: float) -> None:
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    with pytest.raises(BadInputError, match="stiffness"):
        spring_force(motion, SLIDER, COULOMB, stiffness)

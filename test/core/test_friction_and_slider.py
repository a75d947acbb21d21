"""Friction laws and slider parameters against the paper's numbers and their own bounds."""

import math

import numpy as np
import pytest

from imotor_ros.core.friction import (
    FRICTION_LAWS,
    CoulombFriction,
    FrictionLaw,
    StribeckFriction,
    VelocityDependentFriction,
)
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.errors import BadInputError


def test_models_1_and_2_are_those_of_the_paper():
    assert CoulombFriction().force([0.0, 0.5]) == pytest.approx([1.01, 1.01])
    speeds = np.array([0.0, 0.01, 0.4])
    assert VelocityDependentFriction().force(speeds) == pytest.approx(0.940 + 2.213 * speeds)


@pytest.mark.parametrize("name", FRICTION_LAWS)
def test_break_away_force_equals_the_force_at_rest_unless_given(name):
    law = FRICTION_LAWS[name]()
    assert isinstance(law, FrictionLaw)
    assert law.break_away == law.force(0.0)
    assert law.replace(break_away_force=2.5).break_away == 2.5
    assert law.replace(break_away_force=2.5).numbers.break_away == 2.5


@pytest.mark.parametrize("name", FRICTION_LAWS)
def test_break_away_force_below_the_sliding_force_is_refused(name):
    with pytest.raises(BadInputError, match="break_away_force"):
        FRICTION_LAWS[name](break_away_force=0.5)


def test_stribeck_force_falls_before_it_rises():
    law = StribeckFriction(sliding_force=1.0, static_force=1.5, slope=1.0, decay_velocity=0.01)
    assert law.force(0.0) == 1.5
    assert law.force(0.01) == pytest.approx(1.01 + 0.5 / math.e)
    assert law.force(0.5) == pytest.approx(1.5)
    with pytest.raises(BadInputError, match="static_force"):
        StribeckFriction(sliding_force=1.0, static_force=0.9)


def test_nominal_contact_force_leaves_friction_as_it_is():
    assert SliderParameters().friction_scale == 1.0


def test_contact_force_follows_equation_3():
    slider = SliderParameters(inclination=math.pi / 3, clamp_force=2.0, normal_force=0.5)
    assert slider.contact_force == pytest.approx(6.92e-3 * 9.81 * 0.5 + 2.5)
    assert slider.friction_scale == pytest.approx(slider.contact_force / (6.92e-3 * 9.81 + 2.0))
    assert slider.weight_along_rod == pytest.approx(6.92e-3 * 9.81 * math.sin(math.pi / 3))


def test_lifted_slider_is_refused():
    with pytest.raises(BadInputError, match="normal_force"):
        SliderParameters(normal_force=-6.0)


def test_stops_in_wrong_order_are_refused():
    with pytest.raises(BadInputError, match="lower_stop"):
        LoadParameters(lower_stop=1e-3, upper_stop=-1e-3)
    # without stiffness there are no stops, wherever they would be
    assert not LoadParameters(
        lower_stop=1e-3, upper_stop=-1e-3, stop_stiffness=0.0
    ).numbers.depends_on_position

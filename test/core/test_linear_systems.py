"""The analogue models of the filters against what is known of them."""

import numpy as np
import pytest

from imotor_ros.core.linear_systems import (
    LinearSystem,
    bessel_low_pass,
    first_order_high_pass,
    first_order_low_pass,
    resonator,
)
from imotor_ros.errors import BadInputError

CUT_OFF = 100e3


def test_bessel_low_pass_has_3_db_at_its_cut_off_frequency() -> None:
    gain = bessel_low_pass(CUT_OFF).frequency_response(CUT_OFF)
    assert abs(gain) == pytest.approx(np.sqrt(0.5), rel=1e-12)


def test_bessel_low_pass_is_as_data_sheets_of_vibrometers_state() -> None:
    """They state -100 degrees at the cut-off, -5 % at 0.4 and -15 % at 0.7 of it, rounded."""
    gains = bessel_low_pass(CUT_OFF).frequency_response(CUT_OFF * np.array([1.0, 0.4, 0.7]))
    assert np.angle(gains[0], deg=True) == pytest.approx(-99.48, abs=0.01)
    assert np.abs(gains[1:]) == pytest.approx([0.9510, 0.8518], abs=1e-4)


def test_bessel_low_pass_has_the_flattest_delay() -> None:
    """With unit delay H = 15 / (s^3 + 6 s^2 + 15 s + 15): its phase lacks w^3 and w^5."""
    system = bessel_low_pass(CUT_OFF)
    assert system.delay == pytest.approx(0.279424 / CUT_OFF, rel=1e-5)
    omega = 0.02 / system.delay
    late = -np.angle(system.response(1j * omega)) / omega
    assert late == pytest.approx(system.delay, rel=1e-9)


@pytest.mark.parametrize(
    "system",
    [
        bessel_low_pass(CUT_OFF),
        first_order_high_pass(20.0),
        bessel_low_pass(10e3) @ resonator(15e3, 0.02),
        first_order_low_pass(1e3) @ first_order_high_pass(20.0),
    ],
)
def test_linear_system_equals_the_sum_of_its_partial_fractions(system: LinearSystem) -> None:
    s = 2j * np.pi * np.array([1.0, 20.0, 4625.0, 18.5e3, 1e6])
    poles, residues = np.array(system.poles), np.array(system.residues())
    parts = system.feedthrough + (residues / (s[:, None] - poles)).sum(axis=1)
    assert parts == pytest.approx(system.response(s), rel=1e-10)


def test_resonator_peaks_by_its_damping_ratio() -> None:
    gains = resonator(15e3, 0.02).frequency_response(np.array([0.0, 15e3]))
    assert gains == pytest.approx([1.0, -25.0j], rel=1e-12)


def test_linear_system_refuses_what_it_cannot_split() -> None:
    with pytest.raises(BadInputError, match="coinciding"):
        first_order_low_pass(1e3) @ first_order_low_pass(1e3)
    with pytest.raises(BadInputError, match="zeros"):
        LinearSystem((0j,), (), 1.0)

"""The drive voltage for a wanted motion: inverse of any linear response."""

import numpy as np
import pytest

from imotor_ros.core.excitation import voltage_for_motion
from imotor_ros.core.signals import HarmonicMotion, parabolic_sawtooth
from imotor_ros.core.stator import StatorParameters
from imotor_ros.errors import BadInputError


def test_voltage_for_motion_inverts_the_response_of_each_harmonic() -> None:
    motion = parabolic_sawtooth(4, fundamental_frequency=4625.0)
    response = StatorParameters().frequency_response
    amplitudes, phases = voltage_for_motion(motion, response)
    voltages = np.array(amplitudes) * np.exp(1j * np.array(phases))
    moved = voltages * response(4625.0 * np.arange(1, 5))
    wanted = np.array(motion.amplitudes) * np.exp(1j * np.array(motion.phases))
    assert moved == pytest.approx(wanted, rel=1e-12)
    assert all(-np.pi < phase <= np.pi for phase in phases)


def test_voltage_for_motion_gives_the_amplitudes_of_table_1() -> None:
    """Its linear row: 37.44, 13.98, 5.75 V; the fourth harmonic has other modes than ours."""
    motion = parabolic_sawtooth(4, fundamental_frequency=4625.0)
    amplitudes, _ = voltage_for_motion(motion, StatorParameters().frequency_response)
    assert amplitudes[:3] == pytest.approx([37.44, 13.98, 5.75], rel=5e-3)


@pytest.mark.parametrize("gain", [0.0, np.nan, np.inf])
def test_voltage_for_motion_refuses_a_response_without_inverse(gain: float) -> None:
    motion = HarmonicMotion(1000.0, (1e-6, 1e-6), (0.0, 0.0))
    with pytest.raises(BadInputError, match="2000 Hz"):
        voltage_for_motion(motion, lambda frequency: np.where(frequency < 1500.0, 1e-7, gain))

"""What a channel's description tells of its response."""

import numpy as np
import pytest

from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.channel_response import channel_response
from imotor_ros.core.monitor import CurrentMonitorParameters, Monitor, VoltageMonitorParameters
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters

RATE = 1e6
FREQUENCIES = np.geomspace(100.0, 30e3, 30)


@pytest.mark.parametrize("cut_off_frequency", [50e3, 100e3, 250e3])
@pytest.mark.parametrize("high_pass_frequency", [0.0, 20.0])
def test_description_tells_the_response_of_a_vibrometer(
    cut_off_frequency: float, high_pass_frequency: float
) -> None:
    """Up to 30 kHz within 1e-3 and 0.06 degrees: what sampled filters have beside their model."""
    vibrometer = Vibrometer(
        VibrometerParameters(
            cut_off_frequency=cut_off_frequency, high_pass_frequency=high_pass_frequency
        ),
        RATE,
        1,
        "rod/velocity",
    )
    told = channel_response(vibrometer.channel, FREQUENCIES)
    assert told == pytest.approx(vibrometer.frequency_response(FREQUENCIES), abs=1e-3)


@pytest.mark.parametrize("parameters", [VoltageMonitorParameters(), CurrentMonitorParameters()])
def test_description_tells_the_response_of_a_monitor(
    parameters: VoltageMonitorParameters | CurrentMonitorParameters,
) -> None:
    monitor = Monitor(parameters, RATE, 1)
    told = channel_response(monitor.channel, FREQUENCIES)
    assert told == pytest.approx(monitor.frequency_response(FREQUENCIES), abs=1e-3)


def test_unknown_low_pass_is_a_delay() -> None:
    channel = ChannelDescription("rod/velocity", "velocity", "m/s", 1.0, bandwidth=1e3, delay=5e-6)
    assert channel_response(channel, 18.5e3) == pytest.approx(np.exp(-2j * np.pi * 18.5e3 * 5e-6))

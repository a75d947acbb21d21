"""The amplifier's monitors: response, delay and errors."""

from collections.abc import Callable

import numpy as np
import pytest

from imotor_ros.core.channel import CURRENT, VOLTAGE, SampleFlag
from imotor_ros.core.linear_systems import first_order_low_pass
from imotor_ros.core.monitor import CurrentMonitorParameters, Monitor, VoltageMonitorParameters
from imotor_ros.errors import BadInputError

Probe = Callable[..., complex]
RATE = 1e6
VOLTS = VoltageMonitorParameters(
    calibration_uncertainty=0.0, offset_uncertainty=0.0, noise_density=0.0
)
AMPERES = CurrentMonitorParameters(
    calibration_uncertainty=0.0, offset_uncertainty=0.0, noise_density=0.0
)


@pytest.mark.parametrize("frequency", [1e3, 18.5e3, 50e3])
def test_monitor_answers_as_its_analogue_filter(measured_gain: Probe, frequency: float) -> None:
    monitor = Monitor(VOLTS, RATE, 1)
    gain = measured_gain(lambda u: monitor.process(u)[0], frequency, RATE, amplitude=100.0)
    expected = first_order_low_pass(100e3).frequency_response(frequency)
    expected = expected * np.exp(-2j * np.pi * frequency / RATE)
    assert abs(gain - expected) < 2e-4


@pytest.mark.parametrize("parameters", [VOLTS, AMPERES])
def test_monitor_states_its_delay(
    measured_gain: Probe, parameters: VoltageMonitorParameters | CurrentMonitorParameters
) -> None:
    monitor = Monitor(parameters, RATE, 1, input_delay=0.5e-6)
    gain = measured_gain(lambda u: monitor.process(u)[0], 1e3, RATE, amplitude=8.0)
    late = -np.angle(gain) / (2.0 * np.pi * 1e3)
    # 16 bit steps leave some nanoseconds
    assert late + 0.5e-6 == pytest.approx(monitor.channel.delay, abs=20e-9)


def test_monitor_takes_its_name_from_what_it_measures() -> None:
    voltage, current = Monitor(VOLTS, RATE, 1).channel, Monitor(AMPERES, RATE, 1).channel
    assert (voltage.name, voltage.quantity, voltage.unit) == (VOLTAGE, "voltage", "V")
    assert (current.name, current.quantity, current.unit) == (CURRENT, "current", "A")
    assert voltage.resolution == 400.0 / 2**16
    assert current.range == 10.0


def test_monitor_noise_has_its_density_over_the_noise_bandwidth() -> None:
    """A first-order low-pass passes pi/2 of its cut-off frequency."""
    parameters = VOLTS.replace(noise_density=1e-3, cut_off_frequency=5e3)
    shown = Monitor(parameters, RATE, 1).process(np.zeros(400_000))[0]
    # correlated over 30 us: 13 000 independent samples know the rms to 0.6 %
    assert shown[1000:].std() == pytest.approx(1e-3 * np.sqrt(0.5 * np.pi * 5e3), rel=0.03)


def test_monitor_flags_what_exceeds_its_range() -> None:
    monitor = Monitor(AMPERES, RATE, 1)
    assert monitor.process(np.full(50, 9.9))[1] == SampleFlag(0)
    assert monitor.process(np.full(50, -10.1))[1] == SampleFlag.OVER_RANGE


def test_monitor_refuses_a_low_sample_rate() -> None:
    with pytest.raises(BadInputError, match=r"drive/voltage_monitor: cut_off_frequency"):
        Monitor(VOLTS, 199e3, 1)

"""The virtual force sensor: response, drift, delay, range and resolution."""

from collections.abc import Callable

import numpy as np
import pytest

from imotor_ros.core.channel import LOAD_FORCE, SampleFlag
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.force_sensor import ForceSensor, ForceSensorParameters
from imotor_ros.core.linear_systems import bessel_low_pass, resonator
from imotor_ros.errors import BadInputError

Probe = Callable[..., complex]
RATE = 1e6
IDEAL = ForceSensorParameters(
    calibration_uncertainty=0.0,
    offset_uncertainty=0.0,
    noise_density=0.0,
    drift_rate=0.0,
    drift_time_constant=0.0,
    digitiser=DigitiserParameters(bits=32),
)


@pytest.mark.parametrize("frequency", [500.0, 4625.0, 15e3])
def test_force_sensor_answers_as_resonance_and_low_pass(
    measured_gain: Probe, frequency: float
) -> None:
    sensor = ForceSensor(IDEAL, RATE, 1)
    gain = measured_gain(
        lambda force: sensor.process(force)[0], frequency, RATE, amplitude=0.1, settling_time=10e-3
    )
    system = bessel_low_pass(10e3) @ resonator(15e3, 0.02)
    expected = system.frequency_response(frequency) * np.exp(-2j * np.pi * frequency / RATE)
    assert abs(gain - expected) < 1e-5 * abs(expected) + 1e-8


def test_force_sensor_states_its_delay(measured_gain: Probe) -> None:
    sensor = ForceSensor(IDEAL, RATE, 1)
    gain = measured_gain(lambda f: sensor.process(f)[0], 50.0, RATE, settling_time=5e-3)
    late = -np.angle(gain) / (2.0 * np.pi * 50.0)
    assert late == pytest.approx(sensor.channel.delay, abs=1e-8)


def test_force_sensor_loses_a_constant_force_by_its_time_constant() -> None:
    sensor = ForceSensor(IDEAL.replace(drift_time_constant=1.0), RATE, 1)
    shown = np.concatenate([sensor.process(np.full(50_000, 0.5))[0] for _ in range(10)])
    time = np.arange(500_000) / RATE - sensor.channel.delay
    # the first sample counts as a ramp from zero: half a microsecond of the time constant
    np.testing.assert_allclose(shown[10_000:], 0.5 * np.exp(-time[10_000:]), rtol=1e-5)
    assert sensor.channel.high_pass_frequency == pytest.approx(1.0 / (2.0 * np.pi))


def test_force_sensor_drifts_at_the_rate_drawn() -> None:
    parameters = IDEAL.replace(drift_rate=0.1)
    slopes = []
    for seed in range(50):
        shown = ForceSensor(parameters, RATE, seed).process(np.zeros(20_000))[0]
        slopes.append((shown[-1] - shown[0]) / (19_999 / RATE))
    assert np.std(slopes) == pytest.approx(0.1, rel=0.4)
    assert {-1.0, 1.0} == set(np.sign(slopes))


def test_force_sensor_shows_the_forces_of_the_motor_well() -> None:
    """0.2 N within the stated uncertainties: gain 1 %, offset 1 mN, drift 2 mN/s, noise 1 mN."""
    shown, flags = ForceSensor(ForceSensorParameters(), RATE, 4).process(np.full(100_000, 0.2))
    assert flags == SampleFlag(0)
    assert shown[20_000:].mean() == pytest.approx(0.2, abs=4 * np.hypot(0.002, 0.001))
    # the resonance raises the noise of the 10 kHz low-pass
    assert 0.5e-3 < shown[20_000:].std() < 5e-3


def test_force_sensor_saturates_at_its_range() -> None:
    sensor = ForceSensor(IDEAL.replace(resonance_frequency=0.0), RATE, 1)
    assert sensor.channel.range == 5.0
    shown, flags = sensor.process(np.full(2000, 8.0))
    assert flags == SampleFlag.OVER_RANGE
    assert shown[-1] == pytest.approx(5.0, rel=1e-6)
    assert sensor.process(np.zeros(10))[1] == SampleFlag.OVER_RANGE
    sensor.process(np.zeros(2000))
    assert sensor.process(np.zeros(10))[1] == SampleFlag(0)


def test_force_sensor_describes_its_channel() -> None:
    channel = ForceSensor(ForceSensorParameters(), RATE, 1).channel
    assert (channel.name, channel.quantity, channel.unit) == (LOAD_FORCE, "force", "N")
    assert channel.resolution == 10.0 / 2**16
    assert channel.noise_density == 1e-5


def test_force_sensor_refuses_a_low_sample_rate() -> None:
    with pytest.raises(BadInputError, match=r"load/force: resonance_frequency"):
        ForceSensor(ForceSensorParameters(), 25e3, 1)

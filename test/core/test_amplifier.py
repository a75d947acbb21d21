"""The amplifier: linear path, and each of its limits against closed forms."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from imotor_ros.core.amplifier import Amplifier, AmplifierParameters
from imotor_ros.core.channel import SampleFlag
from imotor_ros.errors import BadInputError

RATE = 1e6
Probe = Callable[..., complex]


def amplifier(capacitance: float = 1e-6, **changes: float) -> Amplifier:
    return Amplifier(AmplifierParameters(**changes), RATE, load_capacitance=capacitance)


@pytest.mark.parametrize("frequency", [1e3, 18.5e3, 50e3])
def test_amplifier_answers_as_it_says_and_nearly_as_its_model(
    measured_gain: Probe, frequency: float
) -> None:
    driven = amplifier()
    gain = measured_gain(lambda u: driven.process(u)[0], frequency, RATE, amplitude=10.0)
    assert abs(gain - driven.frequency_response(frequency)) < 1e-9
    model = driven.parameters.frequency_response(frequency)
    # linear interpolation takes off (pi f / rate)^2 / 3
    expected = (math.pi * frequency / RATE) ** 2 / 3.0
    assert abs(gain / model - 1.0) == pytest.approx(expected, rel=0.1)


def test_amplifier_follows_a_ramp_late_by_its_time_constant() -> None:
    """Closed form: s (t - tau (1 - exp(-t/tau)))."""
    tau, slope = 1.0 / (2.0 * math.pi * 100e3), 1e5
    time = np.arange(200) / RATE
    output, flags = amplifier().process(slope * time)
    expected = slope * (time - tau * (1.0 - np.exp(-time / tau)))
    assert output == pytest.approx(expected, rel=1e-11, abs=1e-15)
    assert flags == SampleFlag(0)


def test_amplifier_limits_that_are_not_reached_change_nothing() -> None:
    voltage = 50.0 + 40.0 * np.sin(np.arange(20_000) * 0.116)
    voltage[:1000] *= np.linspace(0.0, 1.0, 1000)
    free, _ = amplifier(slew_rate=1e15, current_limit=1e9, highest_voltage=1e9).process(voltage)
    # of the lag's slope only what the signal needs: 4.7 V/us
    output, flags = amplifier(slew_rate=4.8e6).process(voltage)
    assert np.array_equal(output, free)
    assert flags == SampleFlag(0)
    assert amplifier(slew_rate=4.0e6).process(voltage)[1] == SampleFlag.SLEW_LIMITED


def test_amplifier_clips_to_its_range() -> None:
    """Slow enough that the lag does not matter: 1e-3 V at 600 V/s behind a lag of 1.6 us."""
    time = np.arange(500_000) / RATE
    wanted = 50.0 - 200.0 * np.cos(2.0 * np.pi * 2.0 * time)
    output, flags = amplifier().process(wanted)
    assert flags == SampleFlag.VOLTAGE_CLIPPED
    late = np.clip(wanted, -20.0, 120.0)
    assert np.abs(output[1000:] - late[1000:]).max() < 5e-3
    assert output.max() <= 120.0
    assert output.min() >= -20.0


@pytest.mark.parametrize(
    ("changes", "slope", "flag"),
    [
        ({"slew_rate": 2e6}, 2e6, SampleFlag.SLEW_LIMITED),
        ({"current_limit": 3.0}, 3e6, SampleFlag.CURRENT_LIMITED),
        ({"current_limit": 3.0, "slew_rate": 2.5e6}, 2.5e6, SampleFlag.SLEW_LIMITED),
    ],
)
def test_amplifier_answers_a_step_with_its_largest_slope(
    changes: dict[str, float], slope: float, flag: SampleFlag
) -> None:
    """Straight at `slope`, until the lag needs less; then exponential, from that very instant."""
    driven = amplifier(capacitance=1e-6, **changes)
    assert driven.largest_slope == pytest.approx(slope)
    driven.process(np.zeros(5))
    output, flags = driven.process(np.full(100, 80.0))
    assert flags == flag
    # in the first sample the lag starts free; from then on the slope is the limit
    tau = 1.0 / (2.0 * math.pi * 100e3)
    straight = output[0] + slope / RATE * np.arange(100)
    turning = (80.0 - slope * tau - output[0]) / slope
    time = np.arange(100) / RATE
    tail = 80.0 - slope * tau * np.exp(-(time - turning) / tau)
    expected = np.where(time < turning, straight, tail)
    assert output == pytest.approx(expected, rel=1e-12)


def test_amplifier_equals_a_fine_integration_of_its_equation() -> None:
    """Fast signals into every limit; steps of 1/2000 sample leave some 1e-3 V."""
    rng = np.random.default_rng(3)
    wanted = np.cumsum(rng.normal(0.0, 15.0, 200)) + rng.normal(0.0, 10.0, 200)
    parameters = AmplifierParameters(slew_rate=8e6, bandwidth=150e3)
    output, _ = Amplifier(parameters, RATE, load_capacitance=1e-6).process(wanted)
    clipped = np.concatenate([[0.0], np.clip(wanted, -20.0, 120.0)])
    tau, limit, parts = RATE / (2.0 * math.pi * 150e3), 8.0, 2000
    u, expected = 0.0, []
    for start, end in pairwise(clipped):
        for i in range(parts):
            c = start + (end - start) * (i + 0.5) / parts
            u += min(max((c - u) / tau, -limit), limit) / parts
        expected.append(u)
    assert np.abs(output - expected).max() < 2e-3


def test_amplifier_keeps_within_its_current() -> None:
    """Charge per sample never above what the limit allows, whatever is wanted."""
    wanted = np.random.default_rng(1).uniform(-100.0, 200.0, 5000)
    output, flags = amplifier(capacitance=2e-6, current_limit=4.0).process(wanted)
    current = 2e-6 * np.diff(output) * RATE
    assert np.abs(current).max() <= 4.0 * (1.0 + 1e-12)
    assert flags == SampleFlag.CURRENT_LIMITED | SampleFlag.VOLTAGE_CLIPPED


def test_amplifier_refuses_bad_numbers() -> None:
    with pytest.raises(BadInputError, match="drive voltage, sample 1"):
        amplifier().process([0.0, np.nan])
    with pytest.raises(BadInputError, match="load_capacitance"):
        amplifier(capacitance=0.0)
    with pytest.raises(BadInputError, match="sample_rate"):
        Amplifier(AmplifierParameters(), -1.0, load_capacitance=1e-6)
    with pytest.raises(BadInputError, match="lowest_voltage"):
        AmplifierParameters(lowest_voltage=10.0)

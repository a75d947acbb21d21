"""Filters on streams against the analogue responses and against closed forms in time."""

from collections.abc import Callable

import numpy as np
import pytest

from imotor_ros.core.filters import StreamFilter
from imotor_ros.core.linear_systems import (
    LinearSystem,
    bessel_low_pass,
    first_order_high_pass,
    first_order_low_pass,
    resonator,
)
from imotor_ros.errors import BadInputError

Probe = Callable[..., complex]
RATE = 1e6
CUT_OFF = 100e3


@pytest.mark.parametrize("delay", [1e-6, 4e-6, 4.3e-6, 7.9e-6])
def test_stream_filter_keeps_the_analogue_response(delay: float) -> None:
    """At 1 MS/s, to 2e-4 up to 50 kHz and 3e-6 up to 18.5 kHz, in amplitude and angle alike."""
    system = bessel_low_pass(CUT_OFF)
    sampled = StreamFilter(system, RATE, delay=delay)
    for frequency, tolerance in ((4625.0, 2e-8), (18.5e3, 3e-6), (50e3, 2e-4)):
        analogue = system.frequency_response(frequency) * np.exp(-2j * np.pi * frequency * delay)
        ratio = complex(sampled.frequency_response(frequency) / analogue)
        assert abs(ratio - 1.0) < tolerance


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
@pytest.mark.parametrize("frequency", [1e3, 18.5e3, 50e3, 230e3])
def test_stream_filter_does_what_it_says_of_its_response(
    measured_gain: Probe, interpolation: str, frequency: float
) -> None:
    sampled = StreamFilter(
        bessel_low_pass(CUT_OFF), RATE, delay=4.3e-6, interpolation=interpolation
    )
    gain = measured_gain(sampled.process, frequency, RATE)
    assert abs(gain - sampled.frequency_response(frequency)) < 1e-9


@pytest.mark.parametrize("delay", [0.0, 4e-6, 4.3e-6])
def test_stream_filter_delays_a_ramp_by_its_delay(delay: float) -> None:
    """A ramp comes out as the same ramp, late by the delay at frequency zero."""
    system = bessel_low_pass(CUT_OFF)
    sampled = StreamFilter(system, RATE, delay=delay, interpolation="linear")
    time = np.arange(400) / RATE
    late = time - sampled.process(time)
    assert late[-1] == pytest.approx(sampled.delay, rel=1e-9)
    assert sampled.delay == pytest.approx(delay + system.delay, rel=1e-12)


def test_cubic_interpolation_needs_one_sample_of_delay() -> None:
    system = bessel_low_pass(CUT_OFF)
    assert StreamFilter(system, RATE, delay=0.3e-6).delay == pytest.approx(
        1.0 / RATE + system.delay, rel=1e-12
    )


def test_linear_interpolation_is_exact_for_a_ramp() -> None:
    """Closed form: t - tau (1 - exp(-t/tau)) behind a first-order low-pass."""
    system = first_order_low_pass(30e3)
    tau = system.delay
    time = np.arange(200) / RATE
    expected = time - tau * (1.0 - np.exp(-time / tau))
    output = StreamFilter(system, RATE, interpolation="linear").process(time)
    assert output == pytest.approx(expected, rel=1e-11, abs=1e-18)


def test_cubic_interpolation_is_exact_for_a_cubic() -> None:
    """Closed form behind a lag tau: t^3 - 3 tau t^2 + 6 tau^2 t - 6 tau^3, once it has settled."""
    system = first_order_low_pass(30e3)
    delay, tau = 4.3e-6, system.delay
    time = np.arange(2000) / RATE
    late = time - delay
    expected = late**3 - 3 * tau * late**2 + 6 * tau**2 * late - 6 * tau**3
    output = StreamFilter(system, RATE, delay=delay).process(time**3)
    assert output[1000:] == pytest.approx(expected[1000:], rel=1e-10)


def test_high_pass_lets_a_constant_decay() -> None:
    """Closed form exp(-t/tau), from the middle of the ramp in front of the first sample."""
    tau = 30.0
    sampled = StreamFilter(
        first_order_high_pass(1.0 / (2.0 * np.pi * tau)), RATE, interpolation="linear"
    )
    output = sampled.process(np.ones(300_000))
    time = (np.arange(300_000) + 0.5) / RATE
    # a million steps from 1 each lose some 1e-16
    np.testing.assert_allclose(output, np.exp(-time / tau), rtol=1e-10)


def test_noise_gain_is_what_white_noise_shows() -> None:
    sampled = StreamFilter(bessel_low_pass(CUT_OFF), RATE, delay=4e-6)
    noise = np.random.default_rng(1).standard_normal(400_000)
    # correlated over some 5 samples: the standard deviation is known to 0.25 %, here 4 of that
    assert sampled.process(noise).std() == pytest.approx(sampled.noise_gain, rel=0.01)


def test_noise_gain_is_that_of_the_noise_bandwidth() -> None:
    """A first-order low-pass passes pi/2 of its cut-off frequency; white reaches to RATE/2.

    What the filter passes above RATE/2, 1e-3 of its noise bandwidth, samples do not have.
    """
    sampled = StreamFilter(first_order_low_pass(1e3), RATE)
    expected = np.sqrt(0.5 * np.pi * 1e3 / (0.5 * RATE))
    assert sampled.noise_gain == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(
    "system", [bessel_low_pass(CUT_OFF), resonator(15e3, 0.02) @ bessel_low_pass(10e3)]
)
def test_settling_tells_when_a_step_is_answered(system: LinearSystem) -> None:
    sampled = StreamFilter(system, RATE, delay=4e-6)
    error = np.abs(sampled.process(np.ones(10_000)) - 1.0)
    last = int(np.flatnonzero(error > 0.01)[-1])
    assert last < sampled.settling < 2.0 * last + 20


def test_stream_filter_refuses_poles_beyond_the_sample_rate() -> None:
    with pytest.raises(BadInputError, match="sample_rate"):
        StreamFilter(bessel_low_pass(1e6), 1e6)


def test_stream_filter_names_the_bad_sample() -> None:
    sampled = StreamFilter(bessel_low_pass(CUT_OFF), RATE)
    sampled.process(np.zeros(10))
    with pytest.raises(BadInputError, match="sample 13"):
        sampled.process([0.0, 0.0, 0.0, np.nan])

"""The virtual vibrometer: response, delay, noise, calibration, range and drop-outs."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.linear_systems import bessel_low_pass
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters
from imotor_ros.errors import BadInputError

Probe = Callable[..., complex]
RATE = 1e6
IDEAL = VibrometerParameters(
    calibration_uncertainty=0.0,
    offset_uncertainty=0.0,
    noise_density=0.0,
    digitiser=DigitiserParameters(bits=32),
)


def measure(parameters: VibrometerParameters, velocity: NDArray[np.float64], seed: int = 1):
    return Vibrometer(parameters, RATE, seed, "rod/velocity").process(velocity)


@pytest.mark.parametrize("frequency", [1e3, 9250.0, 18.5e3, 37e3, 50e3])
@pytest.mark.parametrize("decoder_delay", [4e-6, 5.37e-6])
def test_vibrometer_answers_as_its_analogue_filter(
    measured_gain: Probe, frequency: float, decoder_delay: float
) -> None:
    """Within 2e-4 up to 50 kHz: what cubic interpolation at 20 samples per period leaves."""
    parameters = IDEAL.replace(decoder_delay=decoder_delay)
    gain = measured_gain(lambda v: measure(parameters, v)[0], frequency, RATE)
    expected = bessel_low_pass(100e3).frequency_response(frequency)
    expected = expected * np.exp(-2j * np.pi * frequency * decoder_delay)
    assert abs(gain - expected) < 2e-4


@pytest.mark.parametrize("cut_off_frequency", [20e3, 100e3, 500e3])
@pytest.mark.parametrize("decoder_delay", [0.0, 4e-6, 12.34e-6])
def test_vibrometer_states_its_delay(
    measured_gain: Probe, cut_off_frequency: float, decoder_delay: float
) -> None:
    """At 1 kHz the phase tells the delay; 1e-9 s covers the Bessel filter's own dispersion."""
    parameters = IDEAL.replace(cut_off_frequency=cut_off_frequency, decoder_delay=decoder_delay)
    vibrometer = Vibrometer(parameters, RATE, 1, "rod/velocity")
    gain = measured_gain(lambda v: vibrometer.process(v)[0], 1e3, RATE)
    late = -np.angle(gain) / (2.0 * np.pi * 1e3)
    assert late == pytest.approx(vibrometer.channel.delay, abs=1e-9)
    model = max(decoder_delay, 1.0 / RATE) + bessel_low_pass(cut_off_frequency).delay
    assert late == pytest.approx(model, abs=1e-9)


def test_vibrometer_shows_a_mean_velocity_only_if_dc_coupled() -> None:
    velocity = np.full(200_000, 0.1)
    assert measure(IDEAL, velocity)[0][-1] == pytest.approx(0.1, rel=1e-6)
    shown = measure(IDEAL.replace(high_pass_frequency=20.0), velocity)[0]
    assert abs(shown[-1]) < 1e-6


def test_vibrometer_noise_has_its_density_over_the_noise_bandwidth() -> None:
    """White in front of the low-pass: rms = density times root of the filter's noise bandwidth."""
    density = 1e-6
    noise = measure(IDEAL.replace(noise_density=density), np.zeros(400_000))[0]
    frequency = np.linspace(0.0, RATE, 200_001)
    power = np.abs(bessel_low_pass(100e3).frequency_response(frequency)) ** 2
    bandwidth = np.trapezoid(power, frequency)
    # the interpolation takes off 1 % near the cut-off, statistics know the rms to 0.25 %
    assert noise[100:].std() == pytest.approx(density * np.sqrt(bandwidth), rel=0.02)
    # and far below the cut-off the density itself shows
    spectrum = np.abs(np.fft.rfft(noise)) ** 2 * 2.0 / (RATE * len(noise))
    assert np.sqrt(spectrum[10:4000].mean()) == pytest.approx(density, rel=0.05)


def test_vibrometer_calibration_error_is_fixed_and_has_its_spread() -> None:
    parameters = VibrometerParameters()
    gains = [Vibrometer(parameters, RATE, seed, "rod/velocity").gain for seed in range(400)]
    # mean and spread of 400 draws of 1 %, to four standard deviations
    assert np.mean(gains) == pytest.approx(1.0, abs=0.002)
    assert np.std(gains) == pytest.approx(0.01, rel=0.15)
    vibrometer = Vibrometer(IDEAL.replace(calibration_uncertainty=0.01), RATE, 5, "rod/velocity")
    shown = vibrometer.process(np.full(1000, 0.2))[0]
    assert shown[-1] == pytest.approx(0.2 * vibrometer.gain, rel=1e-6)
    assert vibrometer.gain == Vibrometer(parameters, RATE, 5, "rod/velocity").gain


def test_vibrometer_offset_is_added() -> None:
    vibrometer = Vibrometer(IDEAL.replace(offset_uncertainty=1e-3), RATE, 5, "rod/velocity")
    assert vibrometer.offset != 0.0
    assert vibrometer.process(np.zeros(10))[0] == pytest.approx(vibrometer.offset, rel=1e-5)


def test_vibrometers_of_one_run_err_independently() -> None:
    rod, slider = (Vibrometer(VibrometerParameters(), RATE, 1, f"{x}/velocity") for x in "rs")
    assert rod.gain != slider.gain
    shown = [vibrometer.process(np.zeros(100_000))[0] for vibrometer in (rod, slider)]
    assert abs(np.corrcoef(*shown)[0, 1]) < 0.03


def test_vibrometer_flags_what_exceeds_its_range_until_it_has_settled() -> None:
    vibrometer = Vibrometer(IDEAL, RATE, 1, "rod/velocity")
    assert vibrometer.channel.range == 1.25
    assert vibrometer.process(np.full(100, 1.2))[1] == SampleFlag(0)
    shown, flags = vibrometer.process(np.full(100, 2.0))
    assert flags == SampleFlag.OVER_RANGE
    assert shown.max() <= 1.25
    assert vibrometer.process(np.zeros(5))[1] == SampleFlag.OVER_RANGE
    vibrometer.process(np.zeros(100))
    assert vibrometer.process(np.zeros(5))[1] == SampleFlag(0)


def test_vibrometer_drop_outs_hold_the_value_and_come_at_their_rate() -> None:
    """A ramp that is held shows steps; their number and length follow from the parameters."""
    parameters = IDEAL.replace(
        drop_out_rate=500.0, drop_out_duration=50e-6, cut_off_frequency=500e3, velocity_range=1.0
    )
    velocity = np.linspace(0.0, 1.0, 2_000_000)
    shown, flags = measure(parameters, velocity)
    assert flags == SampleFlag.DROP_OUT
    is_held = np.abs(np.diff(shown)) < 1e-9
    starts = np.count_nonzero(np.diff(is_held.astype(int)) == 1)
    # the signal is good for 1/500 s on average, then held for 51 us: 975 expected in 2 s
    assert starts == pytest.approx(975, abs=4 * np.sqrt(975))
    assert is_held.mean() == pytest.approx(975 * 47e-6 / 2.0, rel=0.2)
    error = velocity[:-20] - shown[20:]
    assert error[~np.isclose(error, error[0], atol=1e-5)].min() > -1e-4


def test_vibrometer_flags_only_the_blocks_that_a_drop_out_spoils() -> None:
    parameters = IDEAL.replace(drop_out_rate=200.0)
    vibrometer = Vibrometer(parameters, RATE, 3, "slider/velocity")
    ideal = Vibrometer(IDEAL, RATE, 3, "slider/velocity")
    blocks = np.split(np.sin(np.arange(200_000) * 0.03), 2000)
    flagged = 0
    for block in blocks:
        shown, flags = vibrometer.process(block)
        expected, _ = ideal.process(block)
        flagged += bool(flags)
        if not flags:
            # what the low-pass still shows of a drop-out after its settling time
            assert np.abs(shown - expected).max() < 0.02
    assert 20 < flagged < 400


def test_vibrometer_describes_its_channel() -> None:
    channel = Vibrometer(VibrometerParameters(), RATE, 1, "slider/velocity").channel
    assert (channel.name, channel.quantity, channel.unit) == ("slider/velocity", "velocity", "m/s")
    assert channel.resolution == 2 * 1.25 / 2**16
    assert channel.gain_uncertainty == 0.01
    assert channel.bandwidth == 100e3
    assert channel.is_simulated


def test_vibrometer_refuses_a_low_sample_rate_and_bad_samples() -> None:
    with pytest.raises(BadInputError, match=r"rod/velocity: cut_off_frequency.*half the sample"):
        Vibrometer(VibrometerParameters(), 150e3, 1, "rod/velocity")
    with pytest.raises(BadInputError, match="rod/velocity, sample 2"):
        measure(VibrometerParameters(), np.array([0.0, 0.0, np.inf]))

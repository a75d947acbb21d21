"""Harmonics of a steady motion by least squares."""

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.channel import BESSEL_3, ChannelDescription
from imotor_ros.core.channel_response import channel_response
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.harmonic_fit import PARTS, HarmonicFit, fit_harmonics, window_length
from imotor_ros.errors import BadInputError

RATE = 1e6
IDEAL = ChannelDescription("rod/velocity", "velocity", "m/s", 1.25)
AMPLITUDES, PHASES = (0.18, 0.14, 0.09, 0.04), (0.5, -2.0, 3.0, 1.0)


def drive(frequency: float, hold_time: float = 40e-3) -> DriveProgram:
    return steady_drive(
        run_id="test", epoch=0, sample_rate=RATE, fundamental_frequency=frequency, offset=0.0,
        amplitudes=AMPLITUDES, phases=PHASES, hold_time=hold_time, ramp_periods=1.7,
    )  # fmt: skip


def fit(
    samples: NDArray[np.float64], program: DriveProgram, channel: ChannelDescription = IDEAL
) -> HarmonicFit:
    return fit_harmonics(samples, channel, program, "hold", settling_time=5e-3, count=4)


@pytest.mark.parametrize("frequency", [578.125, 1156.25, 4625.0, 6166.6666667, 9250.0])
def test_fit_finds_the_harmonics_of_the_drive(frequency: float) -> None:
    """With the cycles of the program, wherever the ramp ends between samples."""
    program = drive(frequency)
    found = fit(program.render(0, program.length), program)
    expected = np.array(AMPLITUDES) * np.exp(1j * np.array(PHASES))
    assert found.phasors == pytest.approx(expected, abs=1e-12)
    assert np.all(found.uncertainties < 1e-12)


def test_fit_takes_the_channel_out() -> None:
    channel = ChannelDescription(
        "rod/velocity", "velocity", "m/s", 1.25, bandwidth=50e3, delay=9e-6, low_pass=BESSEL_3
    )
    program = drive(4625.0)
    gains = channel_response(channel, 4625.0 * np.arange(1, 5))
    shown = steady_drive(
        run_id="test", epoch=0, sample_rate=RATE, fundamental_frequency=4625.0, offset=0.0,
        amplitudes=np.abs(gains) * AMPLITUDES, phases=np.angle(gains) + PHASES, hold_time=40e-3,
        ramp_periods=1.7,
    )  # fmt: skip
    found = fit(shown.render(0, shown.length), program, channel)
    expected = np.array(AMPLITUDES) * np.exp(1j * np.array(PHASES))
    assert found.phasors == pytest.approx(expected, abs=1e-12)


def test_uncertainty_is_that_of_white_noise() -> None:
    """Standard deviation sqrt(2/n) of the noise's; its estimate has 14 degrees of freedom each."""
    program = drive(4625.0)
    clean = program.render(0, program.length)
    draws = np.random.default_rng(5)
    errors, claimed = [], []
    for _ in range(30):
        found = fit(clean + draws.normal(0.0, 1e-3, len(clean)), program)
        errors.append(found.phasors - np.array(AMPLITUDES) * np.exp(1j * np.array(PHASES)))
        claimed.append(found.uncertainties)
    length = 35e-3 * RATE
    expected = 1e-3 * np.sqrt(2.0 / length)
    # 240 numbers: 5 % standard error; the window ends up to eight periods early
    assert np.sqrt(np.mean(np.square(claimed))) == pytest.approx(expected, rel=0.15)
    assert np.sqrt(0.5 * np.mean(np.abs(errors) ** 2)) == pytest.approx(expected, rel=0.15)


def test_higher_harmonics_and_offset_do_not_leak() -> None:
    """Over whole periods they are orthogonal, but for the fraction of a sample at the ends."""
    program = drive(4625.0)
    index = np.arange(program.length)
    turns = program.cycles("hold", index.astype(float))
    disturbed = program.render(0, program.length) + 0.02 + 0.05 * np.sin(2 * np.pi * 8 * turns)
    expected = np.array(AMPLITUDES) * np.exp(1j * np.array(PHASES))
    assert fit(disturbed, program).phasors == pytest.approx(expected, abs=2e-5)


def test_window_length_is_what_a_fit_needs() -> None:
    for frequency in (578.125, 4625.0, 9250.0):
        length = window_length(frequency, RATE, 20e-3)
        assert length >= 20e-3 * RATE
        assert length <= 20e-3 * RATE + PARTS * RATE / frequency + 1
        program = drive(frequency, hold_time=5e-3 + (length + 2) / RATE)
        fit(program.render(0, program.length), program)


def test_segment_that_is_too_short_is_refused() -> None:
    program = drive(578.125, hold_time=15e-3)
    with pytest.raises(BadInputError, match="too short"):
        fit(program.render(0, program.length), program)
    program = drive(4625.0)
    with pytest.raises(BadInputError, match="too short"):
        fit(program.render(0, program.length - 20_000), program)

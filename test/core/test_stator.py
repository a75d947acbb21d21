"""The stator: closed forms of its motion, conservation of charge and energy."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from imotor_ros.core.hysteresis import NoHysteresis
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.stator import Stator, StatorParameters
from imotor_ros.errors import BadInputError

RATE = 1e6
LINEAR = StatorParameters.linear()
Probe = Callable[..., complex]


@pytest.mark.parametrize("frequency", [1e3, 18.5e3, 37e3, 60e3])
def test_stator_answers_as_it_says_and_nearly_as_its_model(
    measured_gain: Probe, frequency: float
) -> None:
    stator = Stator(LINEAR, RATE)
    gain = measured_gain(lambda u: stator.process(u).position, frequency, RATE, settling_time=10e-3)
    assert abs(gain / stator.frequency_response(frequency) - 1.0) < 1e-8
    model = stator.parameters.frequency_response(frequency)
    # linear interpolation takes off (pi f / rate)^2 / 3
    assert abs(gain / model - 1.0) < 1.1 * (math.pi * frequency / RATE) ** 2 / 3.0


def test_stator_fits_the_linear_model_of_table_1() -> None:
    """Displacement over linear-model voltage of harmonics 1 to 3; the fourth has other modes."""
    displacement = np.array([6.230, 2.432, 1.073]) * 1e-6
    voltage = np.array([37.44, 13.98, 5.75])
    gains = np.abs(LINEAR.frequency_response(4625.0 * np.arange(1, 4)))
    assert gains == pytest.approx(displacement / voltage, rel=5e-3)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.02, 0.5])
def test_stator_answers_a_ramp_in_closed_form(damping_ratio: float) -> None:
    """x = g s (t - 2 zeta/w0 + exp(-zeta w0 t) (2 zeta/w0 cos + (2 zeta^2 - 1)/wd sin)(wd t))."""
    parameters = LINEAR.replace(damping_ratio=damping_ratio)
    omega = 2.0 * math.pi * parameters.resonance_frequency
    zeta, damped = damping_ratio, omega * math.sqrt(1.0 - damping_ratio**2)
    slope, time = 1e5, np.arange(1000) / RATE
    ringing = 2 * zeta / omega * np.cos(damped * time)
    ringing += (2 * zeta**2 - 1) / damped * np.sin(damped * time)
    lag = time - 2 * zeta / omega + np.exp(-zeta * omega * time) * ringing
    velocity_lag = np.gradient(lag, time, edge_order=2)
    response = Stator(parameters, RATE).process(slope * time)
    scale = parameters.static_gain * slope
    assert response.position == pytest.approx(scale * lag, rel=1e-9, abs=1e-19)
    # second-order differences of a 41 kHz ringing: (w0 T)^2 / 6
    assert response.velocity[1:-1] == pytest.approx(scale * velocity_lag[1:-1], abs=0.02 * scale)
    residual = (
        response.acceleration
        + 2 * zeta * omega * response.velocity
        + omega**2 * (response.position - scale * time)
    )
    assert np.abs(residual).max() < 1e-9 * omega**2 * scale * time[-1]


def test_stator_motion_is_consistent_between_its_samples() -> None:
    """The cubic through velocity and acceleration, integrated, is the position."""
    voltage = 40.0 * np.sin(np.arange(5000) * 2.0 * np.pi * 18.5e3 / RATE)
    rod = Stator(LINEAR, RATE).process(voltage)
    step = 1.0 / RATE
    moved = step / 2 * (rod.velocity[1:] + rod.velocity[:-1])
    moved += step**2 / 12 * (rod.acceleration[:-1] - rod.acceleration[1:])
    # the remainder is T^5/720 of the fourth derivative of the velocity, largest at resonance
    error = np.diff(rod.position) - moved
    bound = (2.0 * np.pi * 41e3 * step) ** 4 / 720.0 * step * np.abs(rod.velocity).max()
    assert np.abs(error).max() < bound


def test_stator_at_rest_follows_its_static_gain_and_capacitance() -> None:
    parameters = LINEAR
    voltage = np.concatenate([np.linspace(0.0, 50.0, 5000), np.full(45_000, 50.0)])
    rod = Stator(parameters, RATE).process(voltage)
    assert rod.position[-1] == pytest.approx(50.0 * parameters.static_gain, rel=1e-9)
    assert rod.velocity[-1] == pytest.approx(0.0, abs=1e-9)
    charge = rod.current.sum() / RATE
    assert charge == pytest.approx(50.0 * parameters.free_capacitance, rel=1e-9)


def test_stator_current_is_the_charge_that_flowed() -> None:
    """Sum of i T = C u + alpha x at every sample, for any voltage."""
    parameters = LINEAR
    voltage = np.random.default_rng(2).uniform(-20.0, 120.0, 3000)
    rod = Stator(parameters, RATE).process(voltage)
    charge = np.cumsum(rod.current) / RATE
    expected = parameters.clamped_capacitance * voltage + parameters.force_factor * rod.position
    assert charge == pytest.approx(expected, rel=1e-10, abs=1e-15)


def test_stator_conserves_energy() -> None:
    """Electrical work = energy in capacitor, mass and spring + loss in the damping.

    The trapezium rule at 20 MS/s leaves (w0 T)^2 / 12, 1e-5 of what flows.
    """
    rate, parameters = 20e6, LINEAR
    time = np.arange(20_000) / rate
    voltage = 50.0 * np.sin(2.0 * np.pi * 30e3 * time) ** 2
    rod = Stator(parameters, rate).process(voltage)
    omega = 2.0 * math.pi * parameters.resonance_frequency
    mass = parameters.stiffness / omega**2
    damping = 2.0 * parameters.damping_ratio * omega * mass
    mean_voltage = 0.5 * (voltage[1:] + voltage[:-1])
    work = np.sum(mean_voltage * rod.current[1:]) / rate
    loss = damping * np.trapezoid(rod.velocity**2, dx=1.0 / rate)
    stored = (
        0.5 * parameters.clamped_capacitance * voltage[-1] ** 2
        + 0.5 * parameters.stiffness * rod.position[-1] ** 2
        + 0.5 * mass * rod.velocity[-1] ** 2
    )
    assert loss > 0.1 * stored
    assert work == pytest.approx(stored + loss, rel=1e-4)


def test_stator_needs_about_three_amperes_per_microfarad_for_the_fastest_signal() -> None:
    """n = 2, f_1 = 9250 Hz, 15 um."""
    motion = parabolic_sawtooth(2, fundamental_frequency=9250.0)
    parameters = LINEAR
    time = np.arange(30_000) / RATE
    rod = Stator(parameters, RATE)
    orders = np.arange(1, 3)
    gains = rod.frequency_response(orders * 9250.0)
    voltage = sum(
        a / abs(h) * np.sin(2.0 * np.pi * k * 9250.0 * time + p - np.angle(h))
        for k, a, p, h in zip(orders, motion.amplitudes, motion.phases, gains, strict=True)
    )
    current = rod.process(voltage).current[20_000:]
    assert np.abs(current).max() * 1e-6 / parameters.free_capacitance == pytest.approx(3.0, rel=0.2)


def test_stator_refuses_what_it_cannot_show() -> None:
    with pytest.raises(BadInputError, match="resonance_frequency"):
        Stator(LINEAR, 80e3)
    with pytest.raises(BadInputError, match="stator voltage, sample 0"):
        Stator(LINEAR, RATE).process([np.inf])


PAPER = StatorParameters()


def test_paper_stator_passes_through_the_linear_row_of_table_1() -> None:
    """Voltages of the linear model within the 0.005 V to which they are printed."""
    motion = parabolic_sawtooth(4, fundamental_frequency=4625.0)
    gains = np.abs(PAPER.frequency_response(4625.0 * np.arange(1, 5)))
    assert np.array(motion.amplitudes) / gains == pytest.approx(
        [37.44, 13.98, 5.75, 2.05], abs=0.005
    )


def test_paper_stator_has_the_phases_of_table_1() -> None:
    """
    Voltage phases of the linear row, cosine convention, relative to the first harmonic.

    Displacement lags by the hysteresis, the same at all frequencies, and the modes.
    """
    motion = parabolic_sawtooth(4, fundamental_frequency=4625.0)
    orders = np.arange(1, 5)
    lag = np.angle(PAPER.frequency_response(4625.0 * orders)) - math.radians(9.5)
    voltage = np.array(motion.phases) - np.pi / 2 - lag
    relative = np.degrees(np.angle(np.exp(1j * (voltage - orders * voltage[0]))))
    assert relative[1:] == pytest.approx([-73.1, -152.1, 126.1], abs=0.4)


def test_paper_stator_has_no_resonance_below_18_5_kilohertz() -> None:
    gains = np.abs(PAPER.frequency_response(np.linspace(0.0, 18.5e3, 200)))
    assert gains.max() < 1.2 * PAPER.static_gain
    assert gains.min() > 0.99 * PAPER.static_gain


@pytest.mark.parametrize("frequency", [1e3, 18.5e3, 19.89e3, 36.21e3])
def test_two_modes_answer_as_they_say(measured_gain: Probe, frequency: float) -> None:
    parameters = PAPER.replace(hysteresis=NoHysteresis())
    stator = Stator(parameters, RATE)
    gain = measured_gain(lambda u: stator.process(u).position, frequency, RATE, settling_time=20e-3)
    assert abs(gain / stator.frequency_response(frequency) - 1.0) < 1e-8


@pytest.mark.parametrize("amplitude", [5.0, 37.44])
@pytest.mark.parametrize("frequency", [1e3, 4625.0, 18.5e3])
def test_stator_with_hysteresis_answers_a_sine_as_it_says(
    amplitude: float, frequency: float
) -> None:
    """Corners of the loop between samples are left out: 2e-4 with 54 samples a period."""
    stator = Stator(PAPER, RATE)
    time = np.arange(100_000) / RATE
    voltage = amplitude * np.sin(2.0 * np.pi * frequency * time)
    turn = np.exp(-2j * np.pi * frequency * time[-40_000:])
    position = stator.process(voltage).position[-40_000:]
    gain = np.mean(position * turn) / np.mean(voltage[-40_000:] * turn)
    assert abs(gain / stator.sine_response(frequency, amplitude) - 1.0) < 5e-4


def test_lag_of_hysteresis_does_not_depend_on_the_frequency() -> None:
    """Over the decade from 2 to 20 kHz: what the modes leave is the same to 0.05 degrees."""
    stator = Stator(PAPER, RATE)
    frequencies = np.geomspace(2e3, 20e3, 20)
    lag = np.angle(
        stator.sine_response(frequencies, 37.44) / stator.frequency_response(frequencies)
    )
    assert np.degrees(lag) == pytest.approx(-8.8, abs=0.05)


def test_capacitance_grows_with_the_amplitude() -> None:
    """By up to 70 % from small to large signals, and 0.3 to 1.8 uF at small ones."""
    charges = []
    for amplitude in (0.5, 70.0):
        time = np.arange(40_000) / RATE
        voltage = amplitude * np.sin(2.0 * np.pi * 100.0 * time)
        current = Stator(PAPER, RATE).process(voltage).current
        charge = np.cumsum(current)[10_000:] / RATE
        charges.append(np.ptp(charge) / (2.0 * amplitude))
    assert 0.3e-6 < charges[0] < 1.8e-6
    assert 1.4 < charges[1] / charges[0] < 1.7
    assert charges[1] < PAPER.largest_capacitance


def test_hysteresis_takes_energy() -> None:
    """Electrical work over closed periods of a slow sine: loss per period is the loop's area."""
    rate, period = 1e6, 20_000
    time = np.arange(3 * period) / rate
    voltage = 37.44 * np.sin(2.0 * np.pi * 50.0 * time)
    current = Stator(PAPER, rate).process(voltage).current[2 * period :]
    mean_voltage = 0.5 * (voltage[2 * period - 1 : -1] + voltage[2 * period :])
    work = np.sum(mean_voltage * current) / rate
    follows = PAPER.hysteretic_share * PAPER.clamped_capacitance + PAPER.moved_capacitance
    gain = PAPER.hysteresis_model.describing_function(37.44)
    # area of an ellipse: the work of the fundamental is all there is under a sine
    assert work == pytest.approx(-math.pi * 37.44**2 * follows * gain.imag, rel=1e-3)

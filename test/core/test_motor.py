"""The virtual motor: wanted motion, truth and monitors."""

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.amplifier import AmplifierParameters
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.excitation import voltage_for_motion
from imotor_ros.core.friction import CoulombFriction
from imotor_ros.core.monitor import CurrentMonitorParameters, VoltageMonitorParameters
from imotor_ros.core.motor import MotorParameters, MotorResponse, VirtualMotor
from imotor_ros.core.signals import HarmonicMotion, parabolic_sawtooth, sine
from imotor_ros.core.slider import LoadParameters
from imotor_ros.core.stator import StatorParameters
from imotor_ros.core.stepping import SliderStepper
from imotor_ros.errors import BadInputError

RATE = 1e6
FREE = MotorParameters(load=LoadParameters.free(), stator=StatorParameters.linear())


def program_for(motion: HarmonicMotion, hold_time: float = 0.02) -> DriveProgram:
    """Return a run that drives the default motor to `motion`."""
    motor = VirtualMotor(FREE, RATE, 1)
    amplitudes, phases = voltage_for_motion(motion, motor.displacement_response)
    return steady_drive(
        run_id="test",
        epoch=0,
        sample_rate=RATE,
        fundamental_frequency=motion.fundamental_frequency,
        offset=50.0,
        amplitudes=amplitudes,
        phases=phases,
        hold_time=hold_time,
    )


def drive(
    motion: HarmonicMotion,
    parameters: MotorParameters = FREE,
    *,
    hold_time: float = 0.02,
    seed: int = 1,
) -> tuple[MotorResponse, slice]:
    """Return the response to a run, and the samples of its last whole periods while it holds."""
    program = program_for(motion, hold_time)
    response = VirtualMotor(parameters, RATE, seed).process(program.render(0, program.length))
    _, end = program.span("hold")
    periods = math.floor(0.5 * hold_time * motion.fundamental_frequency)
    return response, slice(end - round(periods * RATE * motion.period), end)


@pytest.mark.parametrize(
    "motion",
    [
        parabolic_sawtooth(2, fundamental_frequency=9250.0),
        parabolic_sawtooth(4, fundamental_frequency=4625.0),
        parabolic_sawtooth(3, maximum_frequency=2312.5),
        sine(1e-6, 2000.0),
    ],
)
def test_rod_moves_as_wanted_in_steady_state(motion: HarmonicMotion) -> None:
    """The voltage is found from the sampled response: only the ringing that is left shows."""
    response, steady = drive(motion, hold_time=0.03)
    program = program_for(motion, 0.03)
    hold, _ = program.span("hold")
    ramp, _ = program.span("ramp_up")
    # cycles start with ramp_up, whose length is rounded to samples
    start = (hold - ramp) / RATE
    time = (np.arange(len(response.rod_position)) - hold) / RATE + start
    offset = 50.0 * FREE.stator.static_gain
    error = response.rod_position[steady] - offset - motion.position(time[steady])
    assert np.abs(error).max() < 1e-6 * motion.stroke
    assert response.flags == SampleFlag(0)
    velocity = motion.velocity(time[steady])
    # the drive is linear between samples: velocity 0.1 % off at 18.5 kHz, less below
    error = response.rod_velocity[steady] - velocity
    assert np.abs(error).max() < 1e-3 * np.abs(velocity).max()


def test_slider_moves_as_on_the_ideal_rod() -> None:
    """Mean velocity as with the wanted motion given to the slider at once."""
    motion = parabolic_sawtooth(2, fundamental_frequency=9250.0)
    response, steady = drive(motion, hold_time=0.06)
    time = np.arange(90_000) / RATE
    ideal = SliderStepper(FREE.slider, FREE.load, FREE.friction, RATE).process(
        motion.velocity(time), motion.acceleration(time)
    )
    expected = ideal.velocity[-round(200 * RATE * motion.period) :].mean()
    assert response.slider_velocity[steady].mean() == pytest.approx(expected, rel=1e-3)


def test_truth_depends_on_neither_seed_nor_monitors() -> None:
    motion = parabolic_sawtooth(3, fundamental_frequency=4625.0)
    other = FREE.replace(
        voltage_monitor=VoltageMonitorParameters(noise_density=1.0, range=10.0),
        current_monitor=CurrentMonitorParameters(cut_off_frequency=10e3),
    )
    one, _ = drive(motion)
    two, _ = drive(motion, other, seed=2)
    monitored = {"voltage_monitor", "current", "voltage_monitor_flags", "current_flags"}
    for field in dataclasses.fields(MotorResponse):
        is_equal = np.array_equal(getattr(one, field.name), getattr(two, field.name))
        is_monitored = field.name in monitored
        assert is_equal is not is_monitored or field.name == "current_flags"


def test_monitors_repeat_by_seed() -> None:
    motion = sine(1e-6, 2000.0)
    one, two = drive(motion)[0], drive(motion)[0]
    assert np.array_equal(one.voltage_monitor, two.voltage_monitor)
    assert np.array_equal(one.current, two.current)


def test_monitors_show_voltage_and_current_late_by_their_delay() -> None:
    """Within their calibration (3 standard deviations), and bandwidth, 100 kHz first order."""
    motion = sine(5e-6, 4625.0)
    response, steady = drive(motion)
    motor = VirtualMotor(FREE, RATE, 1)
    voltage, current = motor.channels
    pairs = (
        (response.voltage_monitor, response.stator_voltage, voltage, 0.0),
        (response.current, response.stator_current, current, 0.5 / RATE),
    )
    time = np.arange(steady.start, steady.stop) / RATE
    turn = np.exp(-2j * np.pi * 4625.0 * time)
    for shown, true, channel, is_late in pairs:
        ratio = np.mean(shown[steady] * turn) / np.mean(true[steady] * turn)
        assert abs(ratio) == pytest.approx(1.0, abs=3 * channel.gain_uncertainty + 0.002)
        lag = -np.angle(ratio) / (2.0 * np.pi * 4625.0)
        # a first-order lag disperses: (2 pi f tau)^2 / 3 of its 1.6 us, here 1 ns
        assert lag + is_late == pytest.approx(channel.delay, abs=5e-9)


def test_current_monitor_has_the_delay_of_the_stator_current() -> None:
    """Mean current over a sample is half a sample late; current leads the voltage by a quarter."""
    motion = sine(5e-6, 1000.0)
    response, steady = drive(motion, hold_time=0.05)
    time = np.arange(steady.start, steady.stop) / RATE
    turn = np.exp(-2j * np.pi * 1000.0 * time)
    ratio = np.mean(response.stator_current[steady] * turn) / np.mean(
        response.stator_voltage[steady] * turn
    )
    late = (np.pi / 2 - np.angle(ratio)) / (2.0 * np.pi * 1000.0)
    # the moved share of the charge lags with the rod, by 2 zeta / w0
    stator = FREE.stator
    moved = stator.force_factor * stator.static_gain / stator.free_capacitance
    lag = 2.0 * stator.damping_ratio / (2.0 * np.pi * stator.resonance_frequency)
    assert late == pytest.approx(0.5 / RATE + moved * lag, abs=1e-9)
    assert abs(ratio) == pytest.approx(
        2.0 * np.pi * 1000.0 * FREE.stator.free_capacitance, rel=1e-3
    )


def test_spring_is_pulled_and_shows_a_positive_load_force() -> None:
    load = LoadParameters(spring_stiffness=2000.0, stop_stiffness=0.0, stop_damping=0.0)
    parameters = FREE.replace(load=load, friction=CoulombFriction())
    response, steady = drive(
        parabolic_sawtooth(2, fundamental_frequency=4625.0), parameters, hold_time=0.1
    )
    assert response.slider_position[steady].mean() > 0.0
    assert response.load_force == pytest.approx(2000.0 * response.slider_position, rel=1e-9)
    # stall force with Coulomb friction, slider held: 0.2285 F0
    assert response.load_force[steady].mean() == pytest.approx(0.2285 * 1.01, rel=0.03)


def test_slider_sticks_under_a_small_sine() -> None:
    """Up to A w^2 = F0/m: 0.86 um at 2 kHz with friction model 2."""
    response, steady = drive(sine(0.7e-6, 2000.0), hold_time=0.05)
    assert response.is_sticking[steady].all()
    assert response.slider_velocity[steady] == pytest.approx(response.rod_velocity[steady])
    response, steady = drive(sine(1.2e-6, 2000.0), hold_time=0.05)
    assert 0.0 < response.is_sticking[steady].mean() < 1.0


@pytest.mark.parametrize(
    ("amplifier", "flag"),
    [
        (AmplifierParameters(highest_voltage=60.0), SampleFlag.VOLTAGE_CLIPPED),
        (AmplifierParameters(slew_rate=1e6), SampleFlag.SLEW_LIMITED),
        (AmplifierParameters(current_limit=1.0), SampleFlag.CURRENT_LIMITED),
    ],
)
def test_motor_flags_what_the_amplifier_cannot_follow(
    amplifier: AmplifierParameters, flag: SampleFlag
) -> None:
    motion = parabolic_sawtooth(2, fundamental_frequency=9250.0)
    response, _ = drive(motion, FREE.replace(amplifier=amplifier))
    assert response.flags == response.voltage_monitor_flags == response.current_flags == flag


def test_motor_at_rest_stays_at_rest() -> None:
    response = VirtualMotor(MotorParameters(), RATE, 1).process(np.zeros(1000))
    for values in (response.rod_position, response.slider_velocity, response.load_force):
        assert np.array_equal(values, np.zeros(1000))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_motor_names_the_bad_sample(value: float) -> None:
    motor = VirtualMotor(MotorParameters(), RATE, 1)
    motor.process(np.zeros(100))
    voltage: NDArray[np.float64] = np.zeros(10)
    voltage[7] = value
    with pytest.raises(BadInputError, match="drive voltage, sample 107"):
        motor.process(voltage)


@pytest.mark.parametrize("sample_rate", [0.0, -1e6, np.nan, np.inf, 1e4])
def test_motor_refuses_a_bad_sample_rate(sample_rate: float) -> None:
    with pytest.raises(BadInputError):
        VirtualMotor(MotorParameters(), sample_rate, 1)


def test_motor_refuses_a_bad_seed() -> None:
    with pytest.raises(BadInputError, match="seed"):
        VirtualMotor(MotorParameters(), RATE, -1)

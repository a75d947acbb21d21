"""Voltages of the steps, corrected on a stator with hysteresis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from imotor_ros.core.channel import ROD_VELOCITY, ChannelDescription
from imotor_ros.core.drive_setting import DriveSetting
from imotor_ros.core.identification.excitation import correct_steps
from imotor_ros.core.identification.harmonics import measure_harmonics
from imotor_ros.core.identification.stepped_sine import (
    SteppedSineParameters,
    stepped_drive,
    steps_of,
)
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.stator import StatorParameters
from imotor_ros.core.trial import Recording, Trial, carry_out
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters
from imotor_ros.errors import DriveLimitError

RATE = 1e6
STEPS = SteppedSineParameters(steps=6, lowest_amplitude=0.5e-6)
HEAD = VibrometerParameters(calibration_uncertainty=0.0)


def corrected(parameters: SteppedSineParameters, motor: MotorParameters) -> tuple[Any, list[Trial]]:
    """Carry out the procedure; return the voltages and the trials."""
    trials: list[Trial] = []

    def play(trial: Trial) -> Recording:
        trials.append(trial)
        program = trial.program
        head = Vibrometer(HEAD, RATE, 1, ROD_VELOCITY)
        moved = VirtualMotor(motor, RATE, 1).process(program.render(0, program.length))
        velocity, flags = head.process(moved.rod_velocity)
        channels = {ROD_VELOCITY: head.channel}
        return Recording(program, {ROD_VELOCITY: velocity}, channels, {ROD_VELOCITY: int(flags)})

    setting = DriveSetting("test", 0, RATE, parameters.offset, 5e-3, motor.drive_limits)
    return carry_out(correct_steps(setting, parameters), play), trials


def true_motion(voltages: Any, parameters: SteppedSineParameters, motor: MotorParameters) -> Any:
    """Return amplitude (m) of every step, and its largest unwanted harmonic of velocity."""
    program = stepped_drive(parameters, voltages, run_id="run", epoch=0, sample_rate=RATE)
    rod = VirtualMotor(motor, RATE, 1).process(program.render(0, program.length))
    assert rod.flags == 0
    truth = ChannelDescription(ROD_VELOCITY, "velocity", "m/s", 1.0)
    found = [
        measure_harmonics(
            rod.rod_velocity, truth, start=step.start + 8000, periods=20, frequency=2000.0,
            sample_rate=RATE, count=20,
        ).phasors
        for step in steps_of(program)
    ]  # fmt: skip
    amplitudes = [abs(one[0]) / (2.0 * np.pi * 2000.0) for one in found]
    return np.array(amplitudes), np.array([np.abs(one[1:] / one[0]).max() for one in found])


def test_rod_comes_to_sines_of_the_wanted_amplitudes() -> None:
    """Both ways, although only the rising steps are tried: hysteresis forgets what was larger."""
    motor = MotorParameters()
    voltages, trials = corrected(STEPS, motor)
    assert len(voltages) == 12
    assert [one.stage for one in trials][-STEPS.corrections :] == [
        f"correction {k + 1}" for k in range(STEPS.corrections)
    ]
    amplitudes, unwanted = true_motion(voltages, STEPS, motor)
    assert amplitudes == pytest.approx(STEPS.amplitudes, rel=2e-3)
    assert unwanted.max() < 0.01
    before = true_motion(corrected(STEPS.replace(corrections=0), motor)[0], STEPS, motor)
    assert np.abs(before[0] / STEPS.amplitudes - 1.0).max() > 0.05
    assert before[1].max() > 0.05


def test_linear_stator_is_left_alone() -> None:
    motor = MotorParameters(stator=StatorParameters.linear())
    voltages, _ = corrected(STEPS.replace(corrections=1), motor)
    amplitudes, unwanted = true_motion(voltages, STEPS, motor)
    assert amplitudes == pytest.approx(STEPS.amplitudes, rel=2e-3)
    assert unwanted.max() < 2e-3


def test_first_harmonics_have_one_phase() -> None:
    """Else the voltage would jump from step to step."""
    voltages, _ = corrected(STEPS, MotorParameters())
    assert [phases[0] for _, phases in voltages] == [0.0] * 12


def test_amplitudes_out_of_reach_are_refused() -> None:
    """20 um need 120 V of amplitude about 50 V."""
    with pytest.raises(DriveLimitError):
        corrected(STEPS.replace(highest_amplitude=20e-6), MotorParameters())

"""
Voltages of a stepped sine, corrected from the measured rod motion: section 6 for all steps at once.

Hysteresis lets gain, phase and harmonics of the rod's motion change with the amplitude, so that
every step needs a correction of its own. All steps are played in one trial; what the rod did in
each of them tells how its voltage has to change, and a few such trials make sines of them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.channel import ROD_VELOCITY
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.drive_setting import DriveSetting
from imotor_ros.core.identification.harmonics import measure_harmonics, whole_periods
from imotor_ros.core.identification.stepped_sine import (
    DriveStep,
    SteppedSineParameters,
    Voltage,
    stepped_drive,
    steps_of,
)
from imotor_ros.core.response_by_steps import measure_steps
from imotor_ros.core.response_estimate import refuse_overload
from imotor_ros.core.trial import Procedure, Recording, Trial
from imotor_ros.errors import BadInputError

Complex = NDArray[np.complex128]

_SETTLING_TIME = 8e-3
_MEASURING_TIME = 10e-3
_FEWEST_PERIODS = 4
_MOST_HARMONICS = 40

# Relative change of the voltage over that of the motion: the gain of a ceramic grows with both.
_GROWTH = 0.8

# A harmonic below so many standard deviations is noise, which must not be brought to rest.
_SIGNIFICANT = 4.0


def correct_steps(
    setting: DriveSetting, parameters: SteppedSineParameters
) -> Procedure[tuple[Voltage, ...]]:
    """
    Return the procedure that finds the voltages of all steps.

    Parameters
    ----------
    setting : DriveSetting
        How trials are driven.
    parameters : SteppedSineParameters
        The steps, and how often and up to what frequency they are corrected.

    Returns
    -------
    Procedure
        Its trials need the channel "rod/velocity". It returns amplitudes (V) and sine phases
        (rad) of the harmonics of every step, both ways.

    Raises
    ------
    DriveLimitError
        If a step needs more than motor and amplifier allow.
    BadInputError
        If the response at a harmonic cannot be measured.

    """
    frequency = parameters.frequency
    count = max(1, min(math.floor(parameters.corrected_frequency / frequency), _MOST_HARMONICS))
    response = yield from measure_steps(
        setting,
        [k * frequency for k in range(1, count + 1)],
        0.0,
        settling_time=_SETTLING_TIME,
        measuring_time=_MEASURING_TIME,
    )
    gains = np.array(response.small.gains)
    wanted = np.array(parameters.amplitudes[: parameters.steps])
    voltages = np.zeros((parameters.steps, count), dtype=np.complex128)
    voltages[:, 0] = wanted / abs(response.large.gains[0])
    for cycle in range(parameters.corrections):
        program = _program(setting, parameters, voltages, f"steps-{cycle}")
        recording = yield Trial(program, f"correction {cycle + 1}", cycle)
        moved, noise = _displacements(recording, count)
        voltages = _corrected(voltages, moved, noise, wanted, gains)
    _program(setting, parameters, voltages, "steps")
    rising = tuple(_voltage(row) for row in voltages)
    return (*rising, *reversed(rising))


def _voltage(phasors: Complex) -> Voltage:
    return np.abs(phasors).tolist(), np.angle(phasors).tolist()


def _program(
    setting: DriveSetting, parameters: SteppedSineParameters, voltages: Complex, name: str
) -> DriveProgram:
    """Return the program of a trial, checked: the rising steps alone, no longer than needed."""
    time = _SETTLING_TIME + max(_MEASURING_TIME, (_FEWEST_PERIODS + 3) / parameters.frequency)
    trial = parameters.replace(
        step_time=max(time, 12.0 / parameters.frequency),
        rest_time=0.0,
        offset=setting.offset,
        bias_time=setting.bias_time,
    )
    program = stepped_drive(
        trial,
        [_voltage(row) for row in voltages],
        run_id=f"{setting.run_id}.{name}",
        epoch=setting.epoch,
        sample_rate=setting.sample_rate,
    )
    setting.limits.check_program(program)
    return program


def _displacements(recording: Recording, count: int) -> tuple[Complex, NDArray[np.float64]]:
    """Return the rod displacement (m) of every step by harmonic, phases as the drive's; noise."""
    refuse_overload(recording, ROD_VELOCITY)
    samples, channel = recording.channel(ROD_VELOCITY)
    program = recording.program
    rate, frequency = program.sample_rate, program.fundamental_frequency
    orders = np.arange(1, count + 1)
    omega = np.asarray(2.0 * np.pi * frequency * orders, dtype=np.float64)

    def measure(step: DriveStep) -> tuple[Complex, NDArray[np.float64]]:
        start = step.start + round(_SETTLING_TIME * rate)
        periods = whole_periods(start, step.end, rate / frequency, channel.delay * rate)
        if periods < _FEWEST_PERIODS:
            raise BadInputError(
                "is too short to be measured", where=f"{program.run_id}: step {step.number}",
                value=periods, bound=f">= {_FEWEST_PERIODS} whole periods",
            )  # fmt: skip
        found = measure_harmonics(
            samples, channel, start=start, periods=periods, frequency=frequency,
            sample_rate=rate, count=count,
        )  # fmt: skip
        # v = Re V exp(i k theta) from the start of the first period; sine phases, and the drive's
        turns = program.cycles(f"step {step.number}", np.array([float(start)]))[0]
        phasors = found.phasors * np.exp(-2j * np.pi * orders * turns)
        return np.asarray(phasors / omega), np.asarray(found.noise / omega)

    pairs = [measure(step) for step in steps_of(program)]
    return np.array([one for one, _ in pairs]), np.array([noise for _, noise in pairs])


def _corrected(
    voltages: Complex,
    moved: Complex,
    noise: NDArray[np.float64],
    wanted: NDArray[np.float64],
    gains: Complex,
) -> Complex:
    """
    Return the voltages to be tried next.

    The first harmonic of the rod is to have the wanted amplitudes (m), whatever its phase: that of
    the voltage stays 0, so that nothing jumps from step to step. Its gain changes with the
    amplitude, so that the voltage is scaled. The others are to be brought to rest; their gain is
    taken as that at small signals, scaled as the first one's is.
    """
    unwanted = np.where(np.abs(moved) < _SIGNIFICANT * noise, 0.0, moved)
    scale = np.abs(moved[:, :1] / (voltages[:, :1] * gains[0]))
    following = voltages - unwanted / (gains * scale)
    following[:, 0] = voltages[:, 0] * (wanted / np.abs(moved[:, 0])) ** _GROWTH
    return np.asarray(following)

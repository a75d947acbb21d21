"""Runs with a stepped sine on a motor whose stator is linear, measured by realistic heads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core import closed_form, taylor
from imotor_ros.core.channel import ROD_VELOCITY, SLIDER_VELOCITY
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.excitation import voltage_for_motion
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.identification.identification import identify
from imotor_ros.core.identification.records import ChannelRecord, IdentificationParameters
from imotor_ros.core.identification.results import Identification
from imotor_ros.core.identification.stepped_sine import (
    SteppedSineParameters,
    linear_voltages,
    stepped_drive,
)
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.parameters import Parameters
from imotor_ros.core.signals import HarmonicMotion, sine
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.stator import StatorParameters
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters

Array = NDArray[np.float64]

RATE = 1e6
MASS = SliderParameters().mass

SHORT = SteppedSineParameters(steps=14)
"""Half a second of stream: 28 steps, two of which stick at 2 kHz, two do both."""

HEADS = VibrometerParameters(
    calibration_uncertainty=0.0, digitiser=DigitiserParameters(bits=14), noise_density=0.5e-6
)
"""Realistic instruments; the calibration error is a matter of its own."""


@dataclass(frozen=True)
class TrueRun:
    """What rod and slider truly do in a run."""

    program: DriveProgram
    rod_velocity: Array
    slider_velocity: Array

    def records(
        self, seed: int, rod: VibrometerParameters = HEADS, slider: VibrometerParameters = HEADS
    ) -> tuple[ChannelRecord, ChannelRecord]:
        """Return what the heads make of it."""
        pairs = (
            (ROD_VELOCITY, rod, self.rod_velocity),
            (SLIDER_VELOCITY, slider, self.slider_velocity),
        )
        records = []
        for name, parameters, velocity in pairs:
            head = Vibrometer(parameters, self.program.sample_rate, seed, name)
            samples, _ = head.process(velocity)
            records.append(ChannelRecord(head.channel, samples))
        return records[0], records[1]

    def identify(self, seed: int = 1, **settings: Any) -> Identification:
        """Identify the friction from it."""
        rod, slider = self.records(seed)
        return identify(self.program, rod, slider, MASS, IdentificationParameters(**settings))


@cache
def _true_run(
    friction: Parameters, steps: SteppedSineParameters, slider: SliderParameters
) -> TrueRun:
    parameters = MotorParameters(
        friction=friction,
        slider=slider,
        stator=StatorParameters.linear(),
        load=LoadParameters.free(),
    )
    motor = VirtualMotor(parameters, RATE, 1)
    inverse = partial(voltage_for_motion, response=motor.displacement_response)
    program = stepped_drive(
        steps, linear_voltages(steps, inverse), run_id="test", epoch=0, sample_rate=RATE
    )
    response = motor.process(program.render(0, program.length))
    assert response.flags == 0
    return TrueRun(program, response.rod_velocity, response.slider_velocity)


@pytest.fixture(scope="session")
def true_run() -> Callable[..., TrueRun]:
    """Return a function that gives the true motion for a friction law."""

    def make(
        friction: Parameters,
        steps: SteppedSineParameters = SHORT,
        slider: SliderParameters | None = None,
    ) -> TrueRun:
        return _true_run(friction, steps, slider or SliderParameters())

    return make


@dataclass(frozen=True)
class TruePeriod:
    """A settled period without noise: phasors (m/s), mean sliding force (N) or m mean |a|."""

    rod: NDArray[np.complex128]
    slider: NDArray[np.complex128]
    force: float
    mean_relative_speed: float
    stick_share: float


def _true_period(
    friction: FrictionLaw,
    motion: HarmonicMotion | float,
    frequency: float = 2000.0,
    count: int = 25,
) -> TruePeriod:
    """Solve for the settled period in continuous time; an amplitude (m) is that of a sine."""
    if not isinstance(motion, HarmonicMotion):
        motion = sine(motion, frequency)
    points, periods = 16384, 60
    solver = closed_form if closed_form.applies(friction) else taylor
    table = solver.simulate(motion, SliderParameters(), friction, periods=periods, record=True)
    assert table.trajectory is not None
    time = (periods - 1 + np.arange(points) / points) * motion.period
    found = table.trajectory.sample(time)
    spectra = [
        2.0 * np.fft.rfft(one)[1 : count + 1] / points
        for one in (found.rod_velocity, found.velocity)
    ]
    share = float(table.stick_share[-1])
    if share == 0.0:
        # the force is smooth between its zeros: its mean is exact
        force = float(friction.force(np.abs(found.rod_velocity - found.velocity)).mean())
    else:
        travel = np.abs(np.diff(found.velocity, append=found.velocity[0])).sum()
        force = MASS * motion.fundamental_frequency * float(travel)
    return TruePeriod(spectra[0], spectra[1], force, float(table.mean_relative_speed[-1]), share)


@pytest.fixture(scope="session")
def true_period() -> Callable[..., TruePeriod]:
    """Return a function that solves for a settled period under a sine, or any motion."""
    return _true_period

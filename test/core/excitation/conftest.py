"""The virtual motor with its instruments, as procedures meet it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from imotor_ros.core.channel import ROD_VELOCITY, VOLTAGE
from imotor_ros.core.drive_setting import DriveSetting
from imotor_ros.core.motor import MotorParameters, MotorResponse, VirtualMotor
from imotor_ros.core.trial import Recording, Trial
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters

MOTORS = Path(__file__).parents[3] / "params" / "motors"
RATE = 1e6


class Rig:
    """
    A motor with a vibrometer at its rod, and a voltage monitor.

    Attributes
    ----------
    played : list of (Trial, MotorResponse)
        What was played, and what truly happened.

    """

    def __init__(
        self,
        motor: MotorParameters,
        seed: int = 1,
        vibrometer: VibrometerParameters | None = None,
    ) -> None:
        self.motor = motor
        self.seed = seed
        self.vibrometer = vibrometer or VibrometerParameters()
        self.played: list[tuple[Trial, MotorResponse]] = []

    @property
    def setting(self) -> DriveSetting:
        """Drive about the middle of the range."""
        limits = self.motor.drive_limits
        middle = 0.5 * (limits.lowest_voltage + limits.highest_voltage)
        return DriveSetting("test", 0, RATE, middle, 5e-3, limits)

    @property
    def calibration(self) -> tuple[float, float]:
        """Gains of vibrometer and voltage monitor over those that they state."""
        head = Vibrometer(self.vibrometer, RATE, self.seed, ROD_VELOCITY)
        motor = VirtualMotor(self.motor, RATE, self.seed)
        return head.gain, motor._voltage_monitor.gain

    def play(self, trial: Trial) -> Recording:
        """Play a trial on a fresh motor."""
        program = trial.program
        motor = VirtualMotor(self.motor, program.sample_rate, self.seed)
        head = Vibrometer(self.vibrometer, program.sample_rate, self.seed, ROD_VELOCITY)
        response = motor.process(program.render(0, program.length))
        velocity, flags = head.process(response.rod_velocity)
        self.played.append((trial, response))
        return Recording(
            program,
            {ROD_VELOCITY: velocity, VOLTAGE: response.voltage_monitor},
            {channel.name: channel for channel in (head.channel, *motor.channels)},
            {ROD_VELOCITY: int(flags), VOLTAGE: int(response.voltage_monitor_flags)},
        )


def load_motor(name: str) -> MotorParameters:
    text = (MOTORS / f"{name}.yaml").read_text(encoding="utf-8")
    return MotorParameters.from_mapping(yaml.safe_load(text))


@pytest.fixture
def make_rig() -> Callable[..., Rig]:
    """Return a function that makes a rig of a motor file, or of parameters."""

    def make(
        motor: str | MotorParameters,
        seed: int = 1,
        vibrometer: VibrometerParameters | None = None,
    ) -> Rig:
        return Rig(load_motor(motor) if isinstance(motor, str) else motor, seed, vibrometer)

    return make

"""From a point to all that a bench needs: run id, drive program, folder, provenance."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.driver import Driver
from imotor_ros.campaign.point import DriveParameters, PointParameters
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.drive_limits import DriveLimits
from imotor_ros.core.excitation import Excitation, voltage_for_motion
from imotor_ros.core.identification.stepped_sine import (
    SteppedSineParameters,
    Voltage,
    linear_voltages,
    stepped_drive,
)
from imotor_ros.core.motor import VirtualMotor
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.errors import RecordingError

VIRTUAL_EPOCH = 946_684_800 * 1_000_000_000
"""Time of sample 0 of a run on the virtual stand: 2000-01-01 UTC (ns since 1970).

A fixed time, so that the same seed gives the same messages byte for byte; when the run really
took place stands in its provenance.
"""

_VOLTAGE_ROUNDS = 20


@dataclass(frozen=True)
class RunPlan:
    """
    One run, ready to be carried out by any bench.

    Attributes
    ----------
    name : str
        Name of the point.
    parameters : PointParameters
        The point.
    program : DriveProgram
        What to play.
    directory : Path
        Folder for the bag and the logs of this run.
    provenance : mapping
        Versions, host and start of the run, for the bag.
    excitation : Excitation or None
        How the voltage of a steady drive was found; None where it was computed, or measured for
        a drive of another kind.
    driver : Driver
        What it is measured with.

    """

    name: str
    parameters: PointParameters
    program: DriveProgram
    directory: Path
    provenance: Mapping[str, Any] = field(default_factory=dict)
    excitation: Excitation | None = None
    driver: Driver = field(default_factory=Driver)

    @property
    def bag_path(self) -> Path:
        """Folder of the run's bag."""
        return self.directory / "bag"

    @property
    def run_info(self) -> dict[str, Any]:
        """All that is needed to repeat the run, as plain JSON."""
        return {
            "run_id": self.program.run_id,
            "point": self.name,
            "parameters": self.parameters.to_mapping(),
            **self.driver.to_mapping(),
            "excitation": None if self.excitation is None else self.excitation.to_mapping(),
        }

    @property
    def run_info_json(self) -> str:
        """The same as text; equal for equal runs."""
        return json.dumps(self.run_info, sort_keys=True)

    @property
    def limits(self) -> DriveLimits:
        """What the generator may send."""
        return self.parameters.stand.motor.drive_limits

    def prepare_folder(self) -> None:
        """
        Make the run's folder, and remove the bag of an earlier attempt from it.

        Raises
        ------
        RecordingError
            If the file system does not let it be.

        """
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            if self.bag_path.exists():
                shutil.rmtree(self.bag_path)
        except OSError as error:
            cause = error.strerror or str(error)
            raise RecordingError(f"{self.directory}: cannot be written: {cause}") from error


def run_id_of(point: NamedPoint) -> str:
    """Return the run's id: the point's name and a digest of its parameters and its driver's."""
    content = {**point.parameters.to_mapping(), **point.driver.to_mapping()}
    text = json.dumps(content, sort_keys=True)
    return f"{point.name}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def plan_run(
    point: NamedPoint, directory: Path, provenance: Mapping[str, Any] | None = None
) -> RunPlan:
    """
    Return the plan of a point's run, before its voltage is measured.

    The drive voltage is that which gives the wanted rod motion with the response of the motor's
    linear dynamics, as its parameters have it; `excite_run` replaces it by one that was found on
    the bench.

    Raises
    ------
    BadInputError
        If the motion cannot be driven.

    """
    return RunPlan(
        point.name,
        point.parameters,
        drive_program(point.parameters, run_id_of(point)),
        directory,
        provenance or {},
        driver=point.driver,
    )


def drive_program(parameters: PointParameters, run_id: str) -> DriveProgram:
    """Return the drive program of a point; see `plan_run`."""
    rate = parameters.stand.sample_rate
    motor = VirtualMotor(parameters.stand.motor, rate, parameters.seed)
    if isinstance(parameters.drive, SteppedSineParameters):
        voltages = linear_voltages(parameters.drive, partial(_sine_voltage, motor))
    else:
        voltages = (voltage_for_motion(parameters.signal.motion, motor.displacement_response),)
    return program_of(parameters, run_id, voltages)


def program_of(
    parameters: PointParameters, run_id: str, voltages: Sequence[Voltage]
) -> DriveProgram:
    """
    Return the drive program of a point for voltages that are known.

    Parameters
    ----------
    parameters : PointParameters
        The point.
    run_id : str
        Name of the run.
    voltages : sequence of Voltage
        Amplitudes (V) and sine phases (rad) by harmonic: of the steady drive, or of every step.

    """
    drive, rate = parameters.drive, parameters.stand.sample_rate
    if isinstance(drive, SteppedSineParameters):
        return stepped_drive(drive, voltages, run_id=run_id, epoch=VIRTUAL_EPOCH, sample_rate=rate)
    assert isinstance(drive, DriveParameters)
    motion = parameters.signal.motion
    amplitudes, phases = voltages[0]
    return steady_drive(
        run_id=run_id,
        epoch=VIRTUAL_EPOCH,
        sample_rate=rate,
        fundamental_frequency=motion.fundamental_frequency,
        offset=drive.offset,
        amplitudes=amplitudes,
        phases=phases,
        hold_time=drive.hold_time,
        bias_time=drive.bias_time,
        ramp_periods=drive.ramp_periods,
        motion_amplitudes=motion.amplitudes,
        motion_phases=motion.phases,
    )


def _sine_voltage(motor: VirtualMotor, motion: HarmonicMotion) -> Voltage:
    """
    Return the voltage of a step by the motor's parameters.

    The gain of a stator with hysteresis depends on the voltage, so that it is asked for again.
    """
    amplitudes, phases = voltage_for_motion(motion, motor.displacement_response)
    for _ in range(_VOLTAGE_ROUNDS):
        response = partial(motor.sine_response, amplitude=amplitudes[0])
        amplitudes, phases = voltage_for_motion(motion, response)
    return amplitudes, phases

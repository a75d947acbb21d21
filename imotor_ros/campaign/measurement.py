"""Procedures on a bench: each trial is a run with a bag, whose content decides on the next."""

from __future__ import annotations

import shutil
from collections.abc import Generator
from dataclasses import replace
from typing import TypeVar

from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.bench import Bench, ExcitationAdvanced, RunEvent, TrialPlayer
from imotor_ros.campaign.plan import VIRTUAL_EPOCH, RunPlan
from imotor_ros.campaign.point import DriveParameters
from imotor_ros.core.channel import ROD_VELOCITY, VOLTAGE
from imotor_ros.core.drive_setting import DriveSetting
from imotor_ros.core.identification.stepped_sine import SteppedSineParameters
from imotor_ros.core.trial import Procedure, Recording, Steps, Trial

T = TypeVar("T")

_CHANNELS = (ROD_VELOCITY, VOLTAGE)


def setting_of(plan: RunPlan, run_id: str) -> DriveSetting:
    """Return how trials on the stand of a run are driven; `run_id` names them."""
    drive = plan.parameters.drive
    assert isinstance(drive, (DriveParameters, SteppedSineParameters))
    return DriveSetting(
        run_id=run_id,
        epoch=VIRTUAL_EPOCH,
        sample_rate=plan.parameters.stand.sample_rate,
        offset=drive.offset,
        bias_time=drive.bias_time,
        limits=plan.limits,
    )


def measure(
    bench: Bench, plan: RunPlan, procedure: Procedure[T], *, keeps_bags: bool = True
) -> Generator[RunEvent, None, T]:
    """
    Carry out a procedure on a bench, yield what happens, and return its result.

    Parameters
    ----------
    bench : Bench
        Where.
    plan : RunPlan
        Which stand, and the folder below which each trial has one of its own.
    procedure : Procedure
        What to carry out, fresh.
    keeps_bags : bool
        Whether the bags of the trials stay. If not, and the procedure needs nothing but the rod
        velocity, a bench that can plays them without.

    Raises
    ------
    DriveLimitError
        If a limit is in the way.
    ExcitationError
        If the procedure cannot use what was measured.
    RunError
        If a trial does not reach its end.

    """
    step = Steps(procedure)
    while step.trial is not None:
        trial = step.trial
        yield ExcitationAdvanced(trial.stage, trial.amplitude_error, trial.phase_error)
        if not keeps_bags and isinstance(bench, TrialPlayer):
            step.send(bench.play(trial, plan))
            continue
        run = _plan_of(trial, plan)
        yield from bench.run(run)
        recording = read_recording(run)
        if not keeps_bags:
            shutil.rmtree(run.directory)
        step.send(recording)
    return step.result


def _plan_of(trial: Trial, plan: RunPlan) -> RunPlan:
    """Return the plan of a trial: no provisional indicators, for there are none."""
    return replace(
        plan,
        parameters=plan.parameters.replace(report_interval=0.0),
        program=trial.program,
        directory=plan.directory / "trials" / trial.program.run_id.rpartition(".")[2],
        excitation=None,
    )


def read_recording(plan: RunPlan) -> Recording:
    """
    Return what the bag of a trial holds.

    Raises
    ------
    UnreadableFileError
        If it cannot be read.

    """
    samples, flags = {}, {}
    with RunBag(plan.bag_path) as bag:
        for name in _CHANNELS:
            samples[name], _, _ = bag.samples(name)
            flags[name] = int(bag.stream_counts[name]["flags"])
        channels = {name: bag.channels[name] for name in _CHANNELS}
    return Recording(plan.program, samples, channels, flags)

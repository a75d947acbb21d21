"""The voltage of a run, found on the bench before the run."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

from imotor_ros.campaign.bench import Bench, PhaseEntered, RunEvent
from imotor_ros.campaign.measurement import measure, setting_of
from imotor_ros.campaign.plan import VIRTUAL_EPOCH, RunPlan, program_of
from imotor_ros.campaign.point import DriveParameters
from imotor_ros.core.correction import ExcitationRequest
from imotor_ros.core.identification.excitation import correct_steps
from imotor_ros.core.identification.stepped_sine import SteppedSineParameters

CORRECTED = "corrected"


def excite_run(plan: RunPlan, bench: Bench) -> Generator[RunEvent, None, RunPlan]:
    """
    Find the voltage of a run on a bench, yield what happens, and return the plan with it.

    Parameters
    ----------
    plan : RunPlan
        The run.
    bench : Bench
        Where it is to be carried out.

    Raises
    ------
    BadInputError
        If the motion needs more than motor, amplifier or vibrometer allow.
    ExcitationError
        If no voltage moves the rod as wanted.

    """
    yield PhaseEntered("excitation")
    drive, run_id = plan.parameters.drive, plan.program.run_id
    if isinstance(drive, SteppedSineParameters):
        procedure = correct_steps(setting_of(plan, f"{run_id}.excitation"), drive)
        voltages = yield from measure(bench, plan, procedure, keeps_bags=False)
        program = program_of(plan.parameters, run_id, voltages)
        plan.limits.check_program(program)
        return replace(plan, program=program)
    excitation = yield from bench.excite(plan, request_of(plan))
    voltages = ((excitation.amplitudes, excitation.phases),)
    program = program_of(plan.parameters, run_id, voltages)
    plan.limits.check_program(program)
    return replace(plan, program=program, excitation=excitation)


def request_of(plan: RunPlan) -> ExcitationRequest:
    """Return what the point of a run with a steady drive asks of the search for its voltage."""
    parameters = plan.parameters
    drive = parameters.drive
    assert isinstance(drive, DriveParameters)
    return ExcitationRequest(
        run_id=f"{plan.program.run_id}.excitation",
        epoch=VIRTUAL_EPOCH,
        sample_rate=parameters.stand.sample_rate,
        motion=parameters.signal.motion,
        offset=drive.offset,
        bias_time=drive.bias_time,
        ramp_periods=drive.ramp_periods,
        is_corrected=parameters.excitation == CORRECTED,
        parameters=parameters.correction,
    )

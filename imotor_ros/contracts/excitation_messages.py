"""The action drive/correct in objects: its goal, feedback and result, and back."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from imotor_ros.contracts.blocks import NANOSECONDS
from imotor_ros.contracts.messages import MessageTypes, message_time
from imotor_ros.core.correction import CorrectionParameters, Excitation, ExcitationRequest
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.trial import Trial
from imotor_ros.errors import DriveLimitError

CORRECT_ACTION = "drive/correct"
"""Name of the action, relative to the stand's namespace."""

_PARAMETERS = tuple(one.name for one in fields(CorrectionParameters))
_RESULT_LISTS = (
    "response_gains",
    "response_phases",
    "linear_amplitudes",
    "linear_phases",
    "amplitudes",
    "phases",
    "amplitude_errors",
    "phase_errors",
    "uncertainties",
    "unwanted_velocities",
    "largest_amplitude_errors",
    "largest_phase_errors",
)


def request_fields(types: MessageTypes, request: ExcitationRequest) -> dict[str, Any]:
    """Return the fields of the action's goal."""
    seconds, nanoseconds = divmod(request.epoch, NANOSECONDS)
    stamp = types.message("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return {
        "header": types.message("std_msgs/msg/Header", stamp=stamp, frame_id=CORRECT_ACTION),
        "run_id": request.run_id,
        "sample_rate": request.sample_rate,
        "fundamental_frequency": request.motion.fundamental_frequency,
        "motion_amplitudes": types.floats(request.motion.amplitudes),
        "motion_phases": types.floats(request.motion.phases),
        "offset": request.offset,
        "bias_time": request.bias_time,
        "ramp_periods": request.ramp_periods,
        "is_corrected": request.is_corrected,
        **{name: getattr(request.parameters, name) for name in _PARAMETERS},
    }


def request_from_message(message: Any) -> ExcitationRequest:
    """
    Return what an action's goal asks for.

    Raises
    ------
    BadInputError
        If a number makes no sense.

    """
    return ExcitationRequest(
        run_id=message.run_id,
        epoch=message_time(message),
        sample_rate=float(message.sample_rate),
        motion=HarmonicMotion(
            float(message.fundamental_frequency),
            tuple(float(value) for value in message.motion_amplitudes),
            tuple(float(value) for value in message.motion_phases),
        ),
        offset=float(message.offset),
        bias_time=float(message.bias_time),
        ramp_periods=float(message.ramp_periods),
        is_corrected=bool(message.is_corrected),
        parameters=CorrectionParameters(**{name: getattr(message, name) for name in _PARAMETERS}),
    )


def feedback_fields(trial: Trial) -> dict[str, Any]:
    """Return the fields of the action's feedback."""
    return {
        "stage": trial.stage,
        "cycle": trial.cycle,
        "amplitude_error": trial.amplitude_error,
        "phase_error": trial.phase_error,
    }


def excitation_fields(types: MessageTypes, excitation: Excitation) -> dict[str, Any]:
    """Return the fields of the action's result that hold an excitation."""
    lists = {name: types.floats(getattr(excitation, name)) for name in _RESULT_LISTS}
    return {**lists, "cycles": excitation.cycles}


def excitation_from_message(request: ExcitationRequest, message: Any) -> Excitation:
    """Return the excitation in an action's result."""
    lists = {name: tuple(float(x) for x in getattr(message, name)) for name in _RESULT_LISTS}
    return Excitation(
        fundamental_frequency=request.motion.fundamental_frequency,
        motion_amplitudes=request.motion.amplitudes,
        motion_phases=request.motion.phases,
        cycles=int(message.cycles),
        **lists,
    )


def refusal_to_message(types: MessageTypes, error: DriveLimitError) -> Any:
    """Return a DriveLimit message."""
    return types.message(
        "imotor_msgs/msg/DriveLimit",
        where=error.where,
        quantity=error.quantity,
        unit=error.unit,
        needed=error.needed,
        allowed=error.allowed,
    )


def refusal_from_message(message: Any) -> DriveLimitError:
    """Return the error in a DriveLimit message."""
    return DriveLimitError(
        message.where,
        message.quantity,
        float(message.needed),
        float(message.allowed),
        message.unit,
    )

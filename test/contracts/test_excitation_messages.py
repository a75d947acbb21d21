"""What the action drive/correct carries comes out of it the same."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import pytest

from imotor_ros.contracts.excitation_messages import (
    excitation_fields,
    excitation_from_message,
    feedback_fields,
    refusal_from_message,
    refusal_to_message,
    request_fields,
    request_from_message,
)
from imotor_ros.core.correction import CorrectionParameters, Excitation, ExcitationRequest
from imotor_ros.core.drive import DriveProgram, DriveSegment
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.trial import Trial
from imotor_ros.errors import BadInputError, DriveLimitError

REQUEST = ExcitationRequest(
    run_id="point-1a2b.excitation",
    epoch=946_684_800 * 10**9 + 7,
    sample_rate=1e6,
    motion=parabolic_sawtooth(4, fundamental_frequency=4625.0),
    offset=50.0,
    bias_time=5e-3,
    ramp_periods=1.5,
    is_corrected=False,
    parameters=CorrectionParameters(0.02, 0.03, 4, 3, 30e3, 0.1, 20.0, 6e-3, 15e-3),
)
NUMBERS = (0.1, -1.0 / 3.0, 5e-324)
EXCITATION = Excitation(
    fundamental_frequency=REQUEST.motion.fundamental_frequency,
    motion_amplitudes=REQUEST.motion.amplitudes,
    motion_phases=REQUEST.motion.phases,
    cycles=2,
    **{
        one.name: tuple(i + number for number in NUMBERS)
        for i, one in enumerate(dataclasses.fields(Excitation))
        if one.name not in ("fundamental_frequency", "motion_amplitudes", "motion_phases", "cycles")
    },
)


def goal_type() -> Any:
    return pytest.importorskip(
        "imotor_msgs.action", reason="needs the interfaces"
    ).CorrectExcitation


def test_request_round_trip(types: Any) -> None:
    message = SimpleNamespace(**request_fields(types, REQUEST))
    assert request_from_message(message) == REQUEST


def test_request_fits_the_goal_of_the_action() -> None:
    from imotor_ros.nodes.message_types import RclpyTypes

    goal = goal_type().Goal(**request_fields(RclpyTypes(), REQUEST))
    assert request_from_message(goal) == REQUEST
    assert set(goal.get_fields_and_field_types()) == set(request_fields(RclpyTypes(), REQUEST))


def test_excitation_round_trip(types: Any) -> None:
    message = SimpleNamespace(**excitation_fields(types, EXCITATION))
    assert excitation_from_message(REQUEST, message) == EXCITATION


def test_excitation_fits_the_result_of_the_action() -> None:
    from imotor_ros.nodes.message_types import RclpyTypes

    result = goal_type().Result(**excitation_fields(RclpyTypes(), EXCITATION))
    assert excitation_from_message(REQUEST, result) == EXCITATION
    others = {"outcome", "refusals"}
    named = set(excitation_fields(RclpyTypes(), EXCITATION)) | others
    assert set(result.get_fields_and_field_types()) == named


def test_feedback_fits_the_action() -> None:
    segment = DriveSegment("hold", 10, 1e3, 1e3)
    trial = Trial(DriveProgram("run", 0, 1e6, 1e3, (segment,)), "cycle 1", 1, 0.02, 0.1)
    feedback = goal_type().Feedback(**feedback_fields(trial))
    assert (feedback.stage, feedback.cycle) == ("cycle 1", 1)
    assert (feedback.amplitude_error, feedback.phase_error) == (0.02, 0.1)
    first = goal_type().Feedback(
        **feedback_fields(dataclasses.replace(trial, phase_error=math.nan))
    )
    assert math.isnan(first.phase_error)


def test_refusal_round_trip(types: Any) -> None:
    error = DriveLimitError("hold", "voltage", 131.2, 120.0, "V")
    back = refusal_from_message(refusal_to_message(types, error))
    assert (back.quantity, back.needed, back.allowed, back.unit) == ("voltage", 131.2, 120.0, "V")
    assert str(back) == str(error) == (
        "hold: needs a voltage of 131.2 V, expected at most 120 V"
    )  # fmt: skip


def test_request_that_makes_no_sense_is_refused(types: Any) -> None:
    fields = request_fields(types, REQUEST)
    for name, value in (("amplitude_tolerance", -1.0), ("fundamental_frequency", 0.0)):
        with pytest.raises(BadInputError, match=name):
            request_from_message(SimpleNamespace(**{**fields, name: value}))

"""The drive program of a stepped sine, and its steps found again."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from imotor_ros.core.drive import DriveSegment, steady_drive
from imotor_ros.core.identification.stepped_sine import (
    FALLING,
    RISING,
    SteppedSineParameters,
    stepped_drive,
    stepped_sine_drive,
    steps_of,
)
from imotor_ros.errors import BadInputError

RATE = 1e6
PARAMETERS = SteppedSineParameters(steps=3)


def program(parameters: SteppedSineParameters = PARAMETERS):
    return stepped_sine_drive(
        parameters,
        lambda motion: ((motion.amplitudes[0] * 6e6,), (0.4,)),
        run_id="test",
        epoch=0,
        sample_rate=RATE,
    )


def test_amplitudes_rise_and_fall_in_equal_steps() -> None:
    default = SteppedSineParameters()
    assert len(default.amplitudes) == 80
    assert default.amplitudes[0] == default.amplitudes[-1] == 0.1e-6
    assert default.amplitudes[39] == default.amplitudes[40] == 8e-6
    assert default.amplitudes == default.amplitudes[::-1]


def test_steps_are_found_in_the_program() -> None:
    found = steps_of(program())
    assert [one.number for one in found] == [1, 2, 3, 4, 5, 6]
    assert [one.branch for one in found] == [RISING] * 3 + [FALLING] * 3
    assert all(one.end - one.start == 20_000 for one in found)
    assert found[0].start == 5_000 + 10_000 + 2_000


def test_voltage_is_a_sine_of_the_step_s_amplitude_without_a_jump() -> None:
    drive = program()
    voltage = drive.render(0, drive.length) - 50.0
    for step, amplitude in zip(steps_of(drive), PARAMETERS.amplitudes, strict=True):
        part = voltage[step.start : step.end]
        assert np.abs(part).max() == pytest.approx(6e6 * amplitude, rel=1e-4)
        # one frequency and one phase throughout: what is left after half a period is nothing
        assert np.abs(part[250:] + part[:-250]).max() < 1e-6
    slope = 2.0 * np.pi * 2000.0 * 48.0 / RATE
    inside = voltage[5_000 : drive.length - 5_000]
    assert np.abs(np.diff(inside)).max() < 1.02 * slope


def test_rest_comes_before_the_first_step() -> None:
    drive = program()
    start, end = drive.span("rest")
    assert np.ptp(drive.render(start, end - start)) == 0.0
    without = program(PARAMETERS.replace(rest_time=0.0))
    assert "rest" not in [segment.label for segment in without.segments]


def test_stopped_program_keeps_the_steps_so_far() -> None:
    drive = program()
    steps = steps_of(drive)
    stopped = steps_of(drive.stopped_at(steps[2].start + 100))
    assert stopped[:2] == steps[:2]
    assert stopped[2].end == steps[2].start + 100


def test_corrected_voltages_of_both_steps_at_the_top_may_differ() -> None:
    voltages = [((one,), (0.0,)) for one in (1.0, 5.0, 9.0, 9.004, 5.0, 1.0)]
    drive = stepped_drive(PARAMETERS, voltages, run_id="test", epoch=0, sample_rate=RATE)
    assert [one.branch for one in steps_of(drive)] == [RISING] * 3 + [FALLING] * 3


def test_program_without_steps_is_refused() -> None:
    drive = steady_drive(
        run_id="other", epoch=0, sample_rate=RATE, fundamental_frequency=2000.0, offset=50.0,
        amplitudes=(1.0,), phases=(0.0,), hold_time=0.01,
    )  # fmt: skip
    with pytest.raises(BadInputError, match="other: has no steps"):
        steps_of(drive)


def test_step_that_is_not_steady_is_refused() -> None:
    drive = program()
    bent = [
        replace(one, end_amplitudes=(1.0,)) if one.label == "step 2" else one
        for one in drive.segments
    ]
    with pytest.raises(BadInputError, match="step 2: is not a steady drive"):
        steps_of(replace(drive, segments=tuple(bent)))


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"lowest_amplitude": 8e-6}, "lowest_amplitude"),
        ({"step_time": 5e-3}, "step_time"),
        ({"steps": 1}, "steps"),
    ],
)
def test_steps_that_lead_nowhere_are_refused(changes: dict[str, float], where: str) -> None:
    with pytest.raises(BadInputError, match=where):
        SteppedSineParameters(**changes)


def test_segments_follow_each_other_without_a_step_of_amplitude() -> None:
    segments = program().segments
    for before, after in pairwise(segments):
        assert isinstance(before, DriveSegment)
        assert before.end_amplitudes == after.start_amplitudes
        assert before.end_offset == after.start_offset

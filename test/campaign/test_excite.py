"""The voltage of a run, found on the bench: what the plan, the bag and the run info hold of it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.bench import Bench, ExcitationAdvanced, PhaseEntered, RunEvent
from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.excite import excite_run, request_of
from imotor_ros.campaign.measurement import measure, setting_of
from imotor_ros.campaign.plan import RunPlan, plan_run
from imotor_ros.campaign.point import PointParameters
from imotor_ros.campaign.sim_bench import SimBench, play_trial
from imotor_ros.core.correction import Excitation
from imotor_ros.core.drive_limits import program_demand
from imotor_ros.core.response_measurement import ResponseParameters, measure_response
from imotor_ros.core.trial import carry_out
from imotor_ros.errors import DriveLimitError, ExcitationError

T = TypeVar("T")

SHORT = {"drive.hold_time": 0.03, "stand.motor.load.upper_stop": 1e-3, "report_interval": 0.0}


def plan_of(folder: Path, **leaves: Any) -> RunPlan:
    point = NamedPoint("p", PointParameters.from_leaves({**SHORT, **leaves}))
    return plan_run(point, folder / "p")


def finish(steps: Generator[RunEvent, None, T]) -> tuple[list[RunEvent], T]:
    """Return the events of a generator and its result."""
    events = []
    while True:
        try:
            events.append(next(steps))
        except StopIteration as end:
            return events, end.value


def excited(plan: RunPlan, bench: Bench | None = None) -> tuple[list[RunEvent], RunPlan]:
    return finish(excite_run(plan, bench or SimBench()))


def test_corrected_run_has_the_voltage_that_was_found(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    events, found = excited(plan)
    assert isinstance(events[0], PhaseEntered)
    stages = [one.stage for one in events if isinstance(one, ExcitationAdvanced)]
    assert stages[2] == "linear model"
    assert stages[-1].startswith("cycle")
    excitation = found.excitation
    assert isinstance(excitation, Excitation)
    start, _ = found.program.span("hold")
    hold = next(one for one in found.program.segments if one.label == "hold")
    assert (hold.end_amplitudes, hold.phases) == (excitation.amplitudes, excitation.phases)
    assert found.program.run_id == plan.program.run_id
    assert found.program.length == plan.program.length
    assert found.program.motion_amplitudes == plan.program.motion_amplitudes
    assert start == plan.program.span("hold")[0]


def test_bag_and_run_info_hold_the_voltage(tmp_path: Path) -> None:
    _, found = excited(plan_of(tmp_path))
    assert found.excitation is not None
    list(SimBench().run(found))
    with RunBag(found.bag_path) as bag:
        told = Excitation.from_mapping(bag.run_info["excitation"])
        assert bag.program == found.program
        voltage, _, _ = bag.samples("drive/voltage")
    assert told == found.excitation
    assert np.array_equal(voltage, found.program.render(0, found.program.length))


def test_linear_excitation_is_measured_but_not_corrected(tmp_path: Path) -> None:
    events, found = excited(plan_of(tmp_path, excitation="linear"))
    assert found.excitation is not None
    assert found.excitation.cycles == 0
    assert found.excitation.amplitudes == found.excitation.linear_amplitudes
    assert not any(isinstance(e, ExcitationAdvanced) and "cycle" in e.stage for e in events)


def test_excitation_is_that_of_the_core(tmp_path: Path) -> None:
    """The bench adds blocks, roles and limits, and no bit of its own."""
    plan = plan_of(tmp_path, **{"stand.block_length": 777})
    _, found = excited(plan)
    other = plan_of(tmp_path)
    procedure = request_of(other).procedure(other.limits)
    direct = carry_out(procedure, lambda trial: play_trial(trial, other))
    assert found.excitation is not None
    # the run ids differ with the block length; what was found does not
    assert found.excitation == direct


@pytest.mark.parametrize(
    ("leaves", "reason"),
    [
        ({"signal.stroke": 25e-6}, r"needs a voltage of .* V, expected at most 120 V"),
        ({"stand.motor.amplifier.lowest_voltage": 0.0, "signal.stroke": 19e-6},
         r"needs a voltage of -.* V, expected at least 0 V"),
        ({"stand.motor.amplifier.slew_rate": 1e6},
         r"needs a slew rate of .* V/s, expected at most 1e\+06 V/s"),
        ({"stand.motor.amplifier.current_limit": 1.0}, r"needs a current of .* A, .* at most 1 A"),
        ({"stand.rod_vibrometer.velocity_range": 0.025},
         r"needs a velocity of .* m/s, expected at most 0\.25 m/s"),
    ],
)  # fmt: skip
def test_motion_beyond_the_limits_is_refused(
    tmp_path: Path, leaves: dict[str, Any], reason: str
) -> None:
    with pytest.raises(DriveLimitError, match=reason):
        excited(plan_of(tmp_path, **leaves))


@pytest.mark.parametrize(
    ("limit", "quantity"), [("highest_voltage", "voltage"), ("slew_rate", "slew rate")]
)
def test_run_beyond_the_limits_is_refused_before_its_first_sample(
    tmp_path: Path, limit: str, quantity: str
) -> None:
    """Also one whose voltage does not come from a search."""
    plan = plan_of(tmp_path)
    demand = program_demand(plan.program)
    needed = demand.highest if limit == "highest_voltage" else demand.slope
    stand = plan.parameters.stand
    amplifier = stand.motor.amplifier.replace(**{limit: 0.999 * needed})
    parameters = plan.parameters.replace(
        stand=stand.replace(motor=stand.motor.replace(amplifier=amplifier))
    )
    with pytest.raises(DriveLimitError, match=f"needs a {quantity}"):
        list(SimBench().run(replace(plan, parameters=parameters)))
    assert not plan.bag_path.exists()


def test_motion_that_is_not_reached_is_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(ExcitationError, match="after 0 corrections harmonic"):
        excited(plan_of(tmp_path, **{"correction.cycle_limit": 0}))


def test_procedure_over_bags_finds_the_same_as_in_memory(tmp_path: Path) -> None:
    """Any bench that records can measure a response, and the bags stay as evidence."""
    plan = plan_of(tmp_path)
    settings = ResponseParameters(points=4, settling_time=3e-3, measuring_time=4e-3)
    procedure = measure_response(setting_of(plan, "response"), settings)
    events, response = finish(measure(SimBench(), plan, procedure))
    assert [e.stage for e in events if isinstance(e, ExcitationAdvanced)] == [
        "response: probe",
        "response: sweep",
    ]
    assert min(response.coherences) > 0.9999
    bags = sorted(path.parent.name for path in (plan.directory / "trials").glob("*/bag"))
    assert bags == ["probe-1", "sweep-1"]
    with RunBag(plan.directory / "trials" / "sweep-1" / "bag") as bag:
        assert bag.end_state == "completed"


def test_stepped_sine_has_the_voltages_that_were_measured(tmp_path: Path) -> None:
    leaves = {"drive.kind": "stepped_sine", "drive.steps": 3, "drive.hold_time": None}
    plan = plan_of(
        tmp_path, **{**leaves, "stand.motor.load.upper_stop": 10e-3, "drive.lowest_amplitude": 2e-6}
    )
    _, found = excited(plan)
    assert found.excitation is None
    assert found.program != plan.program
    assert found.program.length == plan.program.length
    assert not (plan.directory / "trials" / "sweep-1").exists(), "no bags are left"

"""
The requirements on a driver, on records of drivers that are right and of drivers that are not.

The record of the one that is right comes from the virtual motor and its instruments. Each of the
others is that record with one thing made wrong, and has to fail by the requirement that names it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from imotor_ros.campaign.conformance.flow_checks import (
    check_acknowledged_when_put_out,
    check_flow,
)
from imotor_ros.campaign.conformance.programs import (
    CheckParameters,
    ProgramBuilder,
    characterising_program,
    short_program,
)
from imotor_ros.campaign.conformance.record import (
    MEASURED,
    Acknowledgement,
    Description,
    Published,
    RunRecord,
)
from imotor_ros.campaign.conformance.report import has_passed, to_junit, to_mapping
from imotor_ros.campaign.conformance.requirements import (
    REQUIREMENTS,
    Findings,
    Result,
    Verdict,
    conclude,
)
from imotor_ros.campaign.conformance.signal_checks import (
    RunSignals,
    check_alignment,
    check_clock,
    check_identity,
    check_voltage,
)
from imotor_ros.campaign.conformance.stop_checks import (
    clipping_defects,
    fault_defects,
    ramp_defects,
)
from imotor_ros.campaign.conformance.stream_checks import check_channels, check_streams
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    SampleFlag,
)
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.drive_limits import DriveLimits
from imotor_ros.core.force_sensor import ForceSensor
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.stand import StandParameters
from imotor_ros.core.vibrometer import Vibrometer
from imotor_ros.errors import BadInputError

RATE, BLOCK = 1e6, 10_000
SETTINGS = CheckParameters()


def make_record(
    program: DriveProgram, motor_parameters: MotorParameters, voltage: Any = None
) -> RunRecord:
    """Return what a driver without fault does with a program, or with other voltage (V)."""
    stand = StandParameters(motor=motor_parameters)
    motor = VirtualMotor(stand.motor, RATE, 1)
    asked = program.render(0, program.length) if voltage is None else voltage
    does = motor.process(asked)
    rod = Vibrometer(stand.rod_vibrometer, RATE, 1, ROD_VELOCITY)
    slider = Vibrometer(stand.slider_vibrometer, RATE, 1, SLIDER_VELOCITY)
    force = ForceSensor(stand.force_sensor, RATE, 1)
    measured = {
        ROD_VELOCITY: (rod.process(does.rod_velocity)[0], rod.channel),
        SLIDER_VELOCITY: (slider.process(does.slider_velocity)[0], slider.channel),
        LOAD_FORCE: (force.process(does.load_force)[0], force.channel),
        VOLTAGE: (does.voltage_monitor, motor.channels[0]),
        CURRENT: (does.current, motor.channels[1]),
    }
    record = RunRecord(program, voltage=[asked], sent=len(asked))
    for name, (samples, channel) in measured.items():
        record.descriptions[name] = Description(program.run_id, program.epoch, channel)
        record.blocks[name] = cut(program, name, channel.unit, samples)
    for published in record.blocks[VOLTAGE]:
        end = published.block.end_index
        stamp = sample_time(program.epoch, end, RATE)
        record.progress.append(Acknowledgement(published.moment + 1000, end, stamp, end, 0, ""))
    return record


def cut(program: DriveProgram, name: str, unit: str, samples: Any) -> list[Published]:
    """Return samples as blocks, published 10 ms apart."""
    made = []
    for number, first in enumerate(range(0, len(samples), BLOCK)):
        time = sample_time(program.epoch, first, RATE)
        piece = np.array(samples[first : first + BLOCK])
        block = SampleBlock(name, program.run_id, time, number, first, RATE, unit, 0, piece)
        made.append(Published(10_000_000 * number, block))
    return made


@pytest.fixture(scope="module")
def right() -> RunRecord:
    return make_record(characterising_program(SETTINGS, "right"), MotorParameters())


@pytest.fixture
def record(right: RunRecord) -> RunRecord:
    """Return a copy that a test may spoil."""
    return deepcopy(right)


def check(record: RunRecord, *, has_signals: bool = True) -> tuple[Result, ...]:
    """Return the verdicts of all checks on a run, with those on its signals or without."""
    findings = Findings()
    check_streams(record, MEASURED, findings)
    check_channels(record, MEASURED, findings)
    check_flow(record, findings)
    check_acknowledged_when_put_out(record, findings)
    if has_signals and record.is_complete(MEASURED):
        signals = RunSignals(record)
        check_voltage(signals, findings)
        check_identity(signals, findings)
        check_alignment(signals, MEASURED, findings, SETTINGS.alignment_tolerance)
        check_clock(signals, MEASURED, findings)
    return conclude(findings, "not part of this test")


def failures(record: RunRecord, *, has_signals: bool = True) -> dict[str, str]:
    """Return the evidence of all requirements that failed."""
    results = check(record, has_signals=has_signals)
    return {one.requirement.id: one.evidence for one in results if one.verdict is Verdict.FAIL}


def change_block(record: RunRecord, name: str, number: int, **changes: Any) -> None:
    """Replace fields of one block."""
    blocks = record.blocks[name]
    blocks[number] = replace(blocks[number], block=replace(blocks[number].block, **changes))


def change_samples(record: RunRecord, name: str, change: Callable[[Any], Any]) -> None:
    """Replace all samples of a stream."""
    unit = record.descriptions[name].channel.unit
    record.blocks[name] = cut(record.program, name, unit, change(record.samples(name)))


def change_channel(record: RunRecord, name: str, **changes: Any) -> None:
    """Replace what is said of a channel."""
    described = record.descriptions[name]
    record.descriptions[name] = replace(described, channel=replace(described.channel, **changes))


# ---- a driver that is right ------------------------------------------------------------------


@pytest.mark.parametrize("motor", ["paper", "small_stack"])
def test_driver_without_fault_passes(motor: str) -> None:
    import yaml

    text = (Path(__file__).parents[2] / "params" / "motors" / f"{motor}.yaml").read_text("utf-8")
    parameters = MotorParameters.from_mapping(yaml.safe_load(text), motor)
    record = make_record(characterising_program(SETTINGS, "right"), parameters)
    results = {one.requirement.id: one for one in check(record)}
    for name in ("C1", "C2", "C3", "D1", "D2", "D3", "D4", "D5", "F1", "F2", "V1", "S1"):
        assert results[name].verdict is Verdict.PASS, results[name]
    for name in ("A1", "A2", "A3"):
        assert results[name].verdict is Verdict.PASS, results[name]


def test_lags_are_found_as_they_are(record: RunRecord) -> None:
    """Of channels that are made late by whole samples."""
    program = record.program
    lags = check_alignment(RunSignals(record), MEASURED, Findings(), 1e-3)
    for samples in (3, 7):
        late = deepcopy(record)
        for name in (ROD_VELOCITY, CURRENT):
            change_samples(late, name, lambda x, n=samples: np.concatenate((x[:n], x[:-n])))
        found = check_alignment(RunSignals(late), MEASURED, Findings(), 1e-3)
        for name in (ROD_VELOCITY, CURRENT):
            # what is in a window is shifted too, by samples that have settled less
            moved = found[name].value - lags[name].value
            assert moved == pytest.approx(samples / program.sample_rate, abs=1e-7)
        # the slider now leads the rod by as much, up to the 0.1 us by which its lag is known
        assert found[SLIDER_VELOCITY].value - lags[SLIDER_VELOCITY].value == pytest.approx(
            -samples / program.sample_rate, abs=3e-7
        )


@pytest.mark.parametrize("settings", [SETTINGS, CheckParameters(offset=60.0, amplitude=30.0)])
def test_programs_are_within_the_limits_of_the_paper_motor(settings: CheckParameters) -> None:
    for program in (characterising_program(settings, "a"), short_program(settings, "b")):
        DriveLimits().check_program(program)
        assert program.render(program.length - 1, 1)[0] == pytest.approx(0.0, abs=0.1)


def test_sines_beyond_the_range_are_refused() -> None:
    with pytest.raises(BadInputError, match="offset and amplitude: reaches beyond the range"):
        CheckParameters(offset=110.0)


# ---- drivers that are wrong ------------------------------------------------------------------


def _swap(record: RunRecord) -> None:
    rod, slider = (record.samples(name) for name in (ROD_VELOCITY, SLIDER_VELOCITY))
    change_samples(record, ROD_VELOCITY, lambda _: slider)
    change_samples(record, SLIDER_VELOCITY, lambda _: rod)


def _renumber_after_a_loss(record: RunRecord) -> None:
    """Lose a sample and put one in at the end, so that every index is there."""
    change_samples(record, CURRENT, lambda x: np.concatenate((x[:50_000], x[50_001:], x[-1:])))


def _lose(record: RunRecord) -> None:
    block = record.blocks[SLIDER_VELOCITY][3].block
    change_block(record, SLIDER_VELOCITY, 3, samples=block.samples[:-1])


def _stamp_by_clock(record: RunRecord) -> None:
    for number, one in enumerate(record.blocks[ROD_VELOCITY]):
        now = 1_700_000_000_000_000_000 + one.moment
        record.blocks[ROD_VELOCITY][number] = replace(one, moment=now + 1000)
        change_block(record, ROD_VELOCITY, number, time=now)


def _acknowledge_ahead(record: RunRecord) -> None:
    record.progress = [
        replace(one, consumed=min(one.consumed + BLOCK, record.sent), moment=one.moment)
        for one in record.progress
    ]


def _acknowledge_on_receipt(record: RunRecord) -> None:
    record.progress = [replace(one, moment=one.moment - 4_000_000) for one in record.progress]


def _no_delays(record: RunRecord) -> None:
    for name in MEASURED:
        change_channel(record, name, delay=0.0, low_pass="")


def _spoil(name: str, value: float) -> Callable[[RunRecord], None]:
    def spoil(record: RunRecord) -> None:
        record.blocks[name][4].block.samples[17] = value

    return spoil


def _scale(name: str, factor: float) -> Callable[[RunRecord], None]:
    """Publish in another unit than is said; the range is said in that unit too."""

    def scale(record: RunRecord) -> None:
        change_samples(record, name, lambda x: factor * x)
        change_channel(record, name, range=1e6, offset_uncertainty=0.0)

    return scale


def _label(name: str, **changes: Any) -> Callable[[RunRecord], None]:
    return lambda record: change_block(record, name, 2, **changes)


def _say(name: str, **changes: Any) -> Callable[[RunRecord], None]:
    return lambda record: change_channel(record, name, **changes)


def _forget(name: str) -> Callable[[RunRecord], None]:
    return lambda record: record.descriptions.pop(name) and None


def _never(record: RunRecord) -> None:
    record.progress.clear()


def _take_back(record: RunRecord) -> None:
    record.progress[3] = replace(record.progress[3], consumed=5)


WRONG: dict[str, tuple[Callable[[RunRecord], Any], str, str]] = {
    "unit of blocks": (_label(ROD_VELOCITY, unit="mm/s"), "D4", "wrong unit: 'mm/s'"),
    "unit of channel": (_say(LOAD_FORCE, unit="mN"), "C2", "wrong unit: 'mN', expected 'N'"),
    "rod in mm/s": (_scale(ROD_VELOCITY, 1e3), "A1", "is the unit wrong?"),
    "slider in mm/s": (_scale(SLIDER_VELOCITY, 1e3), "A1", "wrong unit of slider/velocity"),
    "slider in km/s": (_scale(SLIDER_VELOCITY, 1e-3), "A1", "friction does not do"),
    "current in mA": (_scale(CURRENT, 1e3), "A1", "no stack has"),
    "monitor in mV": (_scale(VOLTAGE, 1e3), "V1", "monitor shows"),
    "monitor of half": (_scale(VOLTAGE, 0.5), "V1", "monitor shows"),
    "swapped channels": (_swap, "A1", "channels swapped"),
    "rod's sign": (_scale(ROD_VELOCITY, -1.0), "A1", "wrong sign: the rod"),
    "slider's sign": (_scale(SLIDER_VELOCITY, -1.0), "A1", "wrong sign: -"),
    "current's sign": (_scale(CURRENT, -1.0), "A1", "wrong sign: it flows"),
    "sample missing": (_lose, "D1", "slider/velocity: 1 sample(s) missing: block 4"),
    "sample missing, renumbered": (_renumber_after_a_loss, "A3", "drive/current -1.00"),
    "rate said": (_label(CURRENT, sample_rate=5e5), "D3", "wrong rate: sample_rate is 500000 Hz"),
    "clock": (_stamp_by_clock, "D2", "it is the time of the clock, not of the sample"),
    "stamp off by 1 ns": (
        lambda r: change_block(r, CURRENT, 1, time=r.blocks[CURRENT][1].block.time + 1),
        "D2", "(off by 1 ns)",
    ),
    "no delays": (_no_delays, "A2", "rod/velocity"),
    "rod's delay": (_say(ROD_VELOCITY, delay=0.0, low_pass=""), "A2", "lags the voltage by more"),
    "slider's delay": (_say(SLIDER_VELOCITY, delay=0.0, low_pass=""), "A2", "slider/velocity"),
    "too much delay": (_say(CURRENT, delay=2e-5), "A2", "it leads the voltage"),
    "never acknowledges": (_never, "F1", "never acknowledges"),
    "acknowledges ahead": (_acknowledge_ahead, "F2", "acknowledges too early: 20000 samples"),
    "acknowledges on receipt": (_acknowledge_on_receipt, "S1", "acknowledges too early: 9 of 9"),
    "takes back": (_take_back, "F2", "takes back"),
    "NaN": (_spoil(SLIDER_VELOCITY, np.nan), "D5", "sample 40017 is nan"),
    "inf": (_spoil(LOAD_FORCE, np.inf), "D5", "load/force: sample 40017 is inf"),
    "over range": (_spoil(ROD_VELOCITY, 9.0), "D5", "shows 9 without FLAG_OVER_RANGE"),
    "no description": (_forget(CURRENT), "C1", "drive/current is published, but not described"),
    "range of zero": (_say(CURRENT, range=0.0), "C3", "drive/current: range is 0"),
    "frame": (_label(CURRENT, stream="current"), "D4", "frame_id is 'current'"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_driver_with_a_fault_is_caught(record: RunRecord, what: str) -> None:
    spoil, requirement, text = WRONG[what]
    spoil(record)
    found = failures(record, has_signals=requirement[0] in "AV")  # these take their time
    assert requirement in found, found
    assert text in found[requirement]


def test_wrong_rate_of_the_samples_is_caught(right: RunRecord) -> None:
    """A card that runs slow by 2 %: every field is right, but not the frequencies."""
    program = right.program
    at = np.arange(program.length) * 0.98
    voltage = program.render(0, program.length + 1)
    slow = make_record(
        program, MotorParameters(), np.interp(at, np.arange(program.length + 1), voltage)
    )
    slow.voltage = right.voltage
    assert {"V1", "A3"} & set(failures(slow))


def test_samples_beyond_the_program_are_too_many(record: RunRecord) -> None:
    extra = np.zeros(100)
    change_samples(record, CURRENT, lambda x: np.concatenate((x, extra)))
    length = record.program.length
    assert (
        f"too many samples: {length + 100} of {length}" in failures(record, has_signals=False)["D1"]
    )


# ---- stops -----------------------------------------------------------------------------------


def stopped_run(ramp: int, *, flag: int = int(SampleFlag.RAMPED_DOWN), end: float = 0.0) -> Any:
    """Return a run that a driver ended by itself at sample 20000, by a ramp of so many samples."""
    program = short_program(SETTINGS, "stopped", 40e-3)
    done = program.render(0, 20_000)
    down = np.linspace(done[-1], end, ramp + 1)[1:]
    voltage = np.concatenate((done, down, np.full(500, end)))
    record = make_record(program, MotorParameters(), voltage)
    record.sent, record.voltage = 20_000, [done]
    record.progress = record.progress[:2]
    last = record.progress[-1]
    record.progress.append(replace(last, fault="driver: stopped", flags=flag))
    for number in range(2, len(record.blocks[VOLTAGE])):
        change_block(record, VOLTAGE, number, flags=flag)
    return record


def test_ramp_of_the_driver_passes() -> None:
    record = stopped_run(20_000)
    assert [*ramp_defects(record, MEASURED), *fault_defects(record, "stopped")] == []


@pytest.mark.parametrize(
    ("record", "text"),
    [
        (lambda: stopped_run(20_000, end=30.0), "the voltage stays on"),
        (lambda: stopped_run(60_000), "the ramp takes 60.5 ms"),
        (lambda: stopped_run(4), "the voltage jumps by"),
        (lambda: stopped_run(20_000, flag=0), "no block of the monitor has FLAG_RAMPED_DOWN"),
    ],
    ids=["on", "slow", "jump", "no flag"],
)
def test_ramp_that_is_wrong_is_caught(record: Callable[[], RunRecord], text: str) -> None:
    assert text in " ".join(ramp_defects(record(), MEASURED))


def test_streams_that_end_apart_are_caught() -> None:
    record = stopped_run(20_000)
    record.blocks[LOAD_FORCE].pop()
    assert "the streams end at different samples" in " ".join(ramp_defects(record, MEASURED))


def test_report_of_a_fault() -> None:
    record = stopped_run(20_000)
    told = record.progress[-1]
    assert "does not say 'voltage'" in " ".join(fault_defects(record, "voltage"))
    record.progress.append(replace(told, fault=""))
    assert [*fault_defects(record)] == ["goes on acknowledging after its fault"]
    record.progress[-2:] = [replace(told, consumed=told.consumed + 10)]
    assert "acknowledges samples with its fault" in " ".join(fault_defects(record))
    record.progress.pop()
    assert [*fault_defects(record)] == ["no fault is told on drive/progress"]


def test_voltage_out_of_range_has_to_be_held_back_and_told() -> None:
    builder = ProgramBuilder(SETTINGS)
    builder.level(140.0, 10e-3, "beyond")
    builder.level(0.0, 10e-3, "release")
    record = make_record(builder.build("range"), MotorParameters())
    assert "neither a fault" in " ".join(clipping_defects(record, -20.0, 120.0))
    record.progress[0] = replace(record.progress[0], flags=int(SampleFlag.VOLTAGE_CLIPPED))
    assert [*clipping_defects(record, -20.0, 120.0)] == []
    assert "beyond the range of -20 to 100 V" in " ".join(clipping_defects(record, -20.0, 100.0))


# ---- report ----------------------------------------------------------------------------------


def test_verdicts_outweigh_each_other() -> None:
    findings = Findings()
    findings.passes("D1", "fine")
    findings.fails("D1", "not so")
    findings.skips("D2 D3", "no samples")
    findings.passes("D3", "fine")
    found = {one.requirement.id: one for one in conclude(findings, "it ended")}
    assert (found["D1"].verdict, found["D1"].evidence) == (Verdict.FAIL, "not so")
    assert (found["D2"].verdict, found["D2"].evidence) == (Verdict.NOT_APPLICABLE, "no samples")
    assert found["D3"].verdict is Verdict.PASS
    assert found["A1"].evidence == "not reached: it ended"


def test_reports_say_the_same(right: RunRecord, record: RunRecord) -> None:
    _swap(record)
    results = check(record)
    assert has_passed(check(right))
    assert not has_passed(results)
    content = to_mapping("mutant", results, 1.5)
    json.dumps(content, allow_nan=False)
    assert content["passed"] is False
    assert [one["id"] for one in content["requirements"]] == [one.id for one in REQUIREMENTS]
    suite = ElementTree.fromstring(to_junit("mutant", results, 1.5)).find("testsuite")
    assert suite is not None
    assert suite.get("failures") == str(content["counts"]["fail"])
    assert suite.get("skipped") == str(content["counts"]["not applicable"])
    messages = [one.get("message", "") for one in suite.iter("failure")]
    assert any("channels swapped" in message for message in messages)


def test_specification_explains_every_requirement() -> None:
    text = (Path(__file__).parents[2] / "docs" / "driver_specification.md").read_text("utf-8")
    plain = " ".join(text.split())
    for one in REQUIREMENTS:
        is_there = f"**{one.id}** {one.title}" in plain or f"| {one.id} |" in plain
        assert is_there, f"{one.id} {one.title}"

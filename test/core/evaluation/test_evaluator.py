"""The evaluator on runs known on paper: values, refusals, blocks, and what arrives wrongly."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    MEASURED_CHANNELS,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    ChannelDescription,
    SampleFlag,
)
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.evaluator import EvaluatorParameters, RunEvaluator
from imotor_ros.core.evaluator_parameters import PlausibilityParameters
from imotor_ros.core.indicators import UNITS, Performance, StreamCount
from imotor_ros.errors import BadInputError

UNCHECKED = EvaluatorParameters(plausibility=PlausibilityParameters(is_checked=False))
"""Formulas that are independent of each other contradict each other."""

Array = NDArray[np.float64]
Run = Any  # PaperRun of conftest.py

VELOCITY_INDICATORS = ("mean_velocity", "start_up_time", "ripple", "durability", "efficiency")


def reasons(performance: Performance) -> dict[str, str]:
    return {one.name: one.reason for one in performance.indicators}


def assert_agrees(performance: Performance, known: dict[str, float], *names: str) -> None:
    """Within three standard uncertainties: one in 400 by chance, and the seeds are fixed."""
    for name in names or tuple(UNITS):
        one = performance.indicator(name)
        assert one.is_available, f"{name}: {one.reason}"
        assert abs(one.value - known[name]) < 3.0 * one.uncertainty, name
        assert one.uncertainty < 0.1 * abs(known[name]), name


# ---------------------------------------------------------------------- values


def test_all_indicators_of_a_run_agree_with_what_is_known(paper_run: Run) -> None:
    performance = paper_run.evaluate()
    assert performance.is_final
    assert_agrees(performance, paper_run.known)
    assert tuple(one.name for one in performance.indicators) == tuple(UNITS)
    assert all(one.unit == UNITS[one.name] for one in performance.indicators)
    assert not performance.warnings
    assert performance.end_index == paper_run.program.length


@pytest.mark.parametrize(
    "changes",
    [
        {"frequency": 578.0, "hold_time": 0.1, "contact": 0.06, "time_constant": 4e-3},
        {"frequency": 9250.0},
        {"frequency": 4623.71},
        {"mean": -0.05},
        {"missing_at_start": -0.4},
        {"force_offset": -1.0},
        {"ramp_periods": 7.5},
        {"sample_rate": 250e3, "delays": (6e-6, 7.3e-6, 40e-6, 1e-6, 2.5e-6)},
    ],
    ids=str,
)
def test_indicators_agree_in_other_runs(paper_run: Run, changes: dict[str, Any]) -> None:
    run = paper_run.replace(**changes)
    assert_agrees(run.evaluate(), run.known)


def test_windows_are_where_the_slider_runs_free_and_pushes(paper_run: Run) -> None:
    performance = paper_run.evaluate()
    start = paper_run.program.span("ramp_up")[0]
    free, load = performance.window("free_run"), performance.window("load")
    assert free is not None
    assert load is not None
    # from 0.1 % on, 6.9 time constants after the start, to contact less the guard
    assert free.start == pytest.approx(start + 6.9e3, abs=300)
    assert start + 35_000 - 4 * 217 < free.end < start + 35_000
    assert load.start > start + 35_000
    assert load.end <= paper_run.program.span("ramp_down")[0]
    assert free.periods == pytest.approx((free.end - free.start) * 4625e-6, abs=0.01)


def test_delays_taken_out_are_stated(paper_run: Run) -> None:
    delays = dict(paper_run.evaluate().delays)
    assert delays == dict(zip(MEASURED_CHANNELS, paper_run.delays, strict=True))


def test_delays_matter_and_are_taken_out(paper_run: Run) -> None:
    quiet = paper_run.replace(velocity_noise=0.0, delays=(30e-6, 0.0, 0.0, 0.0, 0.0))
    assert quiet.evaluate().indicator("durability").value == pytest.approx(
        quiet.known["durability"], rel=1e-4
    )
    ignored = quiet.replace(changes={ROD_VELOCITY: {"delay": 0.0}})
    wrong = ignored.evaluate().indicator("durability").value
    assert abs(wrong / quiet.known["durability"] - 1.0) > 1e-3


def test_quiet_run_is_evaluated_exactly(paper_run: Run) -> None:
    quiet = paper_run.replace(velocity_noise=0.0, missing_at_start=0.0, contact=None)
    performance = quiet.evaluate((SLIDER_VELOCITY, ROD_VELOCITY))
    # the interpolation is good to 2e-9 of the swing at 97 kHz; durability: see its kinks
    for name, tolerance in (("mean_velocity", 1e-9), ("ripple", 1e-6), ("durability", 1e-5)):
        value = performance.indicator(name).value
        assert value == pytest.approx(quiet.known[name], rel=tolerance), name


def test_calibration_and_offset_enter_the_uncertainty(paper_run: Run) -> None:
    channel = {"gain_uncertainty": 0.01, "offset_uncertainty": 2e-4}
    plain = paper_run.evaluate()
    doubted = paper_run.replace(changes={SLIDER_VELOCITY: channel}).evaluate()
    for name, wanted in (
        ("mean_velocity", math.hypot(0.01 * 0.05, 2e-4)),
        ("ripple", paper_run.known["ripple"] * 2e-4 / 0.05),  # the gain cancels
        ("efficiency", math.hypot(0.01, 2e-4 / 0.05) * paper_run.known["efficiency"]),
    ):
        before, after = plain.indicator(name), doubted.indicator(name)
        added = math.sqrt(after.uncertainty**2 - before.uncertainty**2)
        assert after.value == before.value
        assert added == pytest.approx(wanted, rel=1e-2), name


def test_decay_of_the_force_is_made_up_for(paper_run: Run) -> None:
    cut_off = 1.0 / (2 * math.pi * 0.5)  # decays to 1/e in 0.5 s
    run = paper_run.replace(changes={LOAD_FORCE: {"high_pass_frequency": cut_off}})
    force = run.samples(LOAD_FORCE) - run.force_offset
    # y' = F' - y / tau, sample by sample
    shown, last, value = np.empty_like(force), 0.0, 0.0
    keep = math.exp(-1e-6 / 0.5)
    for i, now in enumerate(force):
        value = keep * value + now - last
        shown[i], last = value, now
    result = run.evaluate(load_force=shown + run.force_offset).indicator("force")
    ignored = paper_run.evaluate(load_force=shown + run.force_offset).indicator("force")
    assert result.value == pytest.approx(0.3, rel=1e-3)
    assert ignored.value < 0.3 * (1 - 1.5e-2)


def test_force_from_before_the_drive_is_offset_or_load(paper_run: Run) -> None:
    run = paper_run.replace(force_offset=0.1)
    assert run.evaluate().indicator("force").value == pytest.approx(0.3, rel=1e-2)
    doubted = run.replace(changes={LOAD_FORCE: {"offset_uncertainty": 1e-3}}).evaluate()
    assert doubted.indicator("force").value == pytest.approx(0.4, rel=1e-2)
    assert any("taken as load" in text for text in doubted.warnings)


# ---------------------------------------------------------------------- what is not there


def test_run_without_contact_has_no_force_and_all_else(paper_run: Run) -> None:
    performance = paper_run.replace(contact=None).evaluate()
    assert "no contact" in performance.indicator("force").reason
    assert_agrees(performance, paper_run.known, *VELOCITY_INDICATORS)
    assert performance.window("load") is None


@pytest.mark.parametrize(
    ("missing", "lost"),
    [
        (LOAD_FORCE, {"force"}),
        (ROD_VELOCITY, {"durability"}),
        (VOLTAGE, {"efficiency"}),
        (CURRENT, {"efficiency"}),
        (SLIDER_VELOCITY, set(VELOCITY_INDICATORS)),
    ],
)
def test_channel_that_is_absent_costs_what_rests_on_it(
    paper_run: Run, missing: str, lost: set[str]
) -> None:
    performance = paper_run.evaluate([n for n in MEASURED_CHANNELS if n != missing])
    found = reasons(performance)
    assert {name for name, reason in found.items() if reason} == lost
    assert all(found[name] == f"the run has no channel {missing}" for name in lost)
    assert_agrees(performance, paper_run.known, *(set(UNITS) - lost))


def test_contact_is_seen_by_velocity_without_a_force_channel(paper_run: Run) -> None:
    with_force = paper_run.evaluate().window("free_run")
    without = paper_run.evaluate([SLIDER_VELOCITY]).window("free_run")
    assert with_force is not None
    assert without is not None
    assert abs(with_force.end - without.end) <= 3 * 217


def test_sticking_slider_has_zero_velocity_and_no_ripple(paper_run: Run) -> None:
    performance = paper_run.replace(sticks=True, contact=None).evaluate()
    found = reasons(performance)
    velocity = performance.indicator("mean_velocity")
    assert abs(velocity.value) < 3.0 * velocity.uncertainty
    for name in ("start_up_time", "ripple"):
        assert "is not different from zero" in found[name]
    assert "move together" in found["durability"]
    assert abs(performance.indicator("efficiency").value) < 1e-5


def test_calibration_error_does_not_pass_for_sliding(paper_run: Run) -> None:
    run = paper_run.replace(sticks=True, contact=None)
    gains = {"gain_uncertainty": 0.01}
    doubted = run.replace(changes={SLIDER_VELOCITY: gains, ROD_VELOCITY: gains})
    wrong = 1.01 * run.samples(SLIDER_VELOCITY)
    assert "move together" in reasons(doubted.evaluate(slider_velocity=wrong))["durability"]
    assert "move together" not in reasons(run.evaluate(slider_velocity=wrong))["durability"]


@pytest.mark.parametrize(
    ("changes", "name", "reason"),
    [
        ({"contact": 1.5e-3}, "mean_velocity", "whole drive periods are left, at least 5"),
        ({"contact": 0.0}, "mean_velocity", "only 0 whole drive periods"),
        ({"time_constant": 0.05, "contact": 0.049}, "mean_velocity", "has not settled"),
        ({"time_constant": 0.05, "contact": None}, "ripple", "has not settled"),
        ({"missing_at_start": 0.0}, "start_up_time", "noise"),
        ({"contact": None}, "force", "no contact"),
        ({"force_time_constant": 0.05}, "force", "has not settled"),
        ({"contact": 0.0496}, "force", "whole drive periods are left"),
        ({"bias_time": 5e-5}, "force", "offset of the force is unknown"),
        ({"voltages": (0.0,)}, "efficiency", "drive/voltage_monitor shows no signal"),
        ({"currents": (0.0,)}, "efficiency", "drive/current shows no signal"),
        ({"mean": 1e-7, "contact": None}, "ripple", "is not different from zero"),
        (
            {"changes": {SLIDER_VELOCITY: {"high_pass_frequency": 0.5}}},
            "mean_velocity",
            "is AC-coupled",
        ),
        (
            {"changes": {LOAD_FORCE: {"high_pass_frequency": 5.0}}},
            "force",
            "decays during the run",
        ),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_indicator_is_refused_with_its_reason(
    paper_run: Run, changes: dict[str, Any], name: str, reason: str
) -> None:
    one = paper_run.replace(**changes).evaluate().indicator(name)
    assert reason in one.reason
    assert math.isnan(one.value)
    assert math.isnan(one.uncertainty)


def test_program_without_hold_is_counted_but_not_evaluated(paper_run: Run) -> None:
    program = paper_run.program
    evaluator = RunEvaluator(UNCHECKED)
    evaluator.begin(dataclasses.replace(program, segments=program.segments[:2]))
    evaluator.add_channel(paper_run.channel(SLIDER_VELOCITY))
    evaluator.add_samples(SLIDER_VELOCITY, 0, np.zeros(5000))
    evaluator.add_samples(SLIDER_VELOCITY, 5000, np.zeros(216))
    performance = evaluator.performance()
    assert performance.is_final
    assert all("no steady drive" in reason for reason in reasons(performance).values())
    assert performance.streams == (StreamCount(SLIDER_VELOCITY, 5216, 0, 0),)


# ---------------------------------------------------------------------- what arrives wrongly


def broken(paper_run: Run, name: str, *edits: tuple[int, Any, int, float | None]) -> Performance:
    """Evaluate a run in which `name` comes in blocks (first index, samples, flags, rate)."""
    evaluator = paper_run.evaluator([n for n in MEASURED_CHANNELS if n != name])
    evaluator.add_channel(paper_run.channel(name))
    for first, samples, flags, rate in edits:
        evaluator.add_samples(name, first, samples, flags, rate)
    return evaluator.performance()


def test_gap_makes_what_rests_on_the_channel_unavailable(paper_run: Run) -> None:
    samples, length = paper_run.samples(SLIDER_VELOCITY), paper_run.program.length
    performance = broken(
        paper_run, SLIDER_VELOCITY,
        (0, samples[:20_000], 0, None), (20_012, samples[20_012:], 0, None),
    )  # fmt: skip
    found = reasons(performance)
    for name in VELOCITY_INDICATORS:
        assert found[name] == f"12 of {length} samples of slider/velocity are missing"
    assert performance.is_final
    assert StreamCount(SLIDER_VELOCITY, length - 12, 12, 0) in performance.streams
    # the force still has its own channel, only its sign cannot be known
    assert_agrees(performance, paper_run.known, "force")
    assert any("direction of motion is unknown" in text for text in performance.warnings)


def test_late_start_of_a_stream_is_a_gap(paper_run: Run) -> None:
    samples = paper_run.samples(ROD_VELOCITY)
    performance = broken(paper_run, ROD_VELOCITY, (100, samples[100:], 0, None))
    assert "100 of" in reasons(performance)["durability"]
    assert_agrees(performance, paper_run.known, "mean_velocity", "ripple", "force")


def test_gap_of_the_force_leaves_contact_to_the_velocity(paper_run: Run) -> None:
    samples = paper_run.samples(LOAD_FORCE)
    performance = broken(
        paper_run, LOAD_FORCE, (0, samples[:999], 0, None), (1000, samples[1000:], 0, None)
    )
    assert "1 of" in reasons(performance)["force"]
    assert_agrees(performance, paper_run.known, *VELOCITY_INDICATORS)
    assert any("by the slider velocity alone" in text for text in performance.warnings)


@pytest.mark.parametrize(
    ("first", "flags", "rate", "reason"),
    [
        (29_990, 0, None, "10 of 60432 samples of slider/velocity came twice"),
        (30_000, SampleFlag.GAP, None, "are missing, as its source says"),
        (30_000, SampleFlag.OVER_RANGE, None, "was over its range"),
        (30_000, 0, 2e6, "sampled at 2000000 Hz, but the drive program says 1000000 Hz"),
    ],
)
def test_block_that_is_wrong_makes_the_channel_unusable(
    paper_run: Run, first: int, flags: int, rate: float | None, reason: str
) -> None:
    samples = paper_run.samples(SLIDER_VELOCITY)
    assert samples.size == 60_432
    performance = broken(
        paper_run, SLIDER_VELOCITY,
        (0, samples[:30_000], 0, 1e6), (first, samples[first:], flags, rate),
    )  # fmt: skip
    assert all(reason in reasons(performance)[name] for name in VELOCITY_INDICATORS)
    assert_agrees(performance, paper_run.known, "force")


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_samples_that_are_not_finite_make_the_channel_unusable(paper_run: Run, bad: float) -> None:
    samples = paper_run.samples(SLIDER_VELOCITY)
    samples[[20_000, 30_000]] = bad
    performance = paper_run.evaluate(slider_velocity=samples)
    assert "2 of 60432 samples of slider/velocity are not finite" in reasons(performance)["ripple"]


def test_samples_at_the_end_of_the_range_are_noticed_without_flag(paper_run: Run) -> None:
    digitised = {"range": 0.0525, "resolution": 1e-4}
    run = paper_run.replace(changes={SLIDER_VELOCITY: digitised})
    clipped = np.clip(run.samples(SLIDER_VELOCITY), -0.0525, 0.0524)
    reason = reasons(run.evaluate(slider_velocity=clipped))["mean_velocity"]
    assert "are at the end of its range, 0.0525 m/s" in reason


def test_drop_outs_are_left_out_with_a_warning(paper_run: Run) -> None:
    samples = paper_run.samples(SLIDER_VELOCITY)
    for start in (20_000, 25_000, 33_000):
        samples[start : start + 40] = 0.0
    blocks = ((0, samples[:30_000], 0, None), (30_000, samples[30_000:], SampleFlag.DROP_OUT, None))
    performance = broken(paper_run, SLIDER_VELOCITY, *blocks)
    assert_agrees(performance, paper_run.known)
    assert any("3 of" in text and "are left out" in text for text in performance.warnings)
    spoiled = paper_run.evaluate(slider_velocity=samples).indicator("durability")
    assert spoiled.uncertainty > 2.0 * performance.indicator("durability").uncertainty


def test_too_many_drop_outs_are_refused(paper_run: Run) -> None:
    run = paper_run.replace(hold_time=0.012, contact=None, time_constant=5e-4)
    parameters = EvaluatorParameters(minimum_periods=40)
    samples = run.samples(SLIDER_VELOCITY)
    for start in range(9_000, 17_000, 648):  # every third period
        samples[start : start + 60] = 0.0
    evaluator = run.evaluator([], parameters=parameters)
    evaluator.add_channel(run.channel(SLIDER_VELOCITY))
    evaluator.add_samples(SLIDER_VELOCITY, 0, samples, SampleFlag.DROP_OUT)
    assert "drop-outs of slider/velocity spoil" in reasons(evaluator.performance())["ripple"]


@pytest.mark.parametrize(
    ("flag", "text"),
    [
        (SampleFlag.VOLTAGE_CLIPPED, "clipped the voltage"),
        (SampleFlag.SLEW_LIMITED, "slew rate"),
        (SampleFlag.CURRENT_LIMITED, "limited the current"),
    ],
)
def test_limits_of_the_amplifier_are_warnings(paper_run: Run, flag: int, text: str) -> None:
    performance = broken(paper_run, VOLTAGE, (0, paper_run.samples(VOLTAGE), flag, None))
    assert_agrees(performance, paper_run.known)
    assert any(text in warning for warning in performance.warnings)
    assert StreamCount(VOLTAGE, paper_run.program.length, 0, flag) in performance.streams


def test_narrow_bandwidth_is_a_warning_and_widens_the_uncertainty(paper_run: Run) -> None:
    narrow = {name: {"bandwidth": 15e3} for name in (SLIDER_VELOCITY, VOLTAGE)}
    performance = paper_run.replace(changes=narrow).evaluate()
    plain = paper_run.evaluate()
    text = " ".join(performance.warnings)
    assert "beyond half the bandwidth of slider/velocity" in text
    assert "different bandwidths" in text
    assert "hides about" in text
    for name in ("ripple", "efficiency"):
        wider, before = performance.indicator(name), plain.indicator(name)
        assert wider.uncertainty > 3.0 * before.uncertainty


def test_samples_past_the_end_are_ignored(paper_run: Run) -> None:
    evaluator = paper_run.evaluator([SLIDER_VELOCITY])
    before = evaluator.performance()
    evaluator.add_samples(SLIDER_VELOCITY, paper_run.program.length, np.full(100, 9.0))
    assert evaluator.performance() == before


# ---------------------------------------------------------------------- blocks and order


def cut(run: Run, block: int, seed: int) -> RunEvaluator:
    """Give the samples in blocks of random lengths up to `block`, channels taking turns at random.

    Some channels are described after their first samples.
    """
    rng = np.random.default_rng(seed)
    evaluator = RunEvaluator(UNCHECKED)
    evaluator.begin(run.program)
    samples = {name: run.samples(name) for name in MEASURED_CHANNELS}
    position = dict.fromkeys(MEASURED_CHANNELS, 0)
    described: set[str] = set()
    while position:
        name = str(rng.choice(list(position)))
        first, count = position[name], int(rng.integers(1, block + 1))
        evaluator.add_samples(name, first, samples[name][first : first + count])
        if name not in described and rng.random() < 0.5:
            evaluator.add_channel(run.channel(name))
            described.add(name)
        position[name] += count
        if position[name] >= run.program.length:
            del position[name]
    for name in set(MEASURED_CHANNELS) - described:
        evaluator.add_channel(run.channel(name))
    return evaluator


@pytest.mark.parametrize("block", [30_000, 2_000, 777, 97])
def test_result_does_not_depend_on_blocks_to_the_last_bit(paper_run: Run, block: int) -> None:
    whole = paper_run.evaluator(block=10**9)
    parts = cut(paper_run, block, seed=block)
    assert parts.performance() == whole.performance()
    for until in (4_000, 5_100, 12_345, 30_000, 41_000, 50_000):
        assert parts.performance(until) == whole.performance(until)
        assert not parts.performance(until).is_final


def test_result_does_not_depend_on_single_samples(paper_run: Run) -> None:
    run = paper_run.replace(hold_time=0.008, contact=None, time_constant=3e-4, bias_time=1e-3)
    singly = run.evaluator(block=1)
    assert singly.performance() == run.evaluator(block=10**9).performance()
    assert singly.performance().indicator("mean_velocity").is_available


def test_provisional_result_looks_at_no_later_sample(paper_run: Run) -> None:
    whole = paper_run.evaluator()
    for until in (3_000, 11_000, 33_333, 47_000):
        evaluator = RunEvaluator(UNCHECKED)
        evaluator.begin(paper_run.program)
        for name in MEASURED_CHANNELS:
            evaluator.add_channel(paper_run.channel(name))
            evaluator.add_samples(name, 0, paper_run.samples(name)[:until])
        assert evaluator.performance() == whole.performance(until)
        assert evaluator.performance().end_index == until


def test_provisional_results_grow_from_reasons_to_values(paper_run: Run) -> None:
    evaluator = paper_run.evaluator()
    early = evaluator.performance(4_000)
    assert all(reasons(early).values())
    running = evaluator.performance(38_000)
    assert_agrees(running, paper_run.known, *VELOCITY_INDICATORS)
    assert "no contact" in reasons(running)["force"]
    assert_agrees(evaluator.performance(54_000), paper_run.known)


def test_provisional_results_can_be_had_at_any_sample(paper_run: Run) -> None:
    run = paper_run.replace(hold_time=0.02, contact=0.01, bias_time=1e-3)
    evaluator = run.evaluator()
    for until in range(0, run.program.length + 1, 173):
        performance = evaluator.performance(until)
        for one in performance.indicators:
            assert one.is_available != bool(one.reason)
            assert not one.is_available or one.uncertainty >= 0.0


def test_run_is_complete_when_every_channel_is(paper_run: Run) -> None:
    evaluator = RunEvaluator(UNCHECKED)
    evaluator.begin(paper_run.program)
    assert not evaluator.is_complete
    for name in MEASURED_CHANNELS:
        evaluator.add_channel(paper_run.channel(name))
    for name in MEASURED_CHANNELS:
        assert not evaluator.is_complete
        assert not evaluator.performance().is_final
        evaluator.add_samples(name, 0, paper_run.samples(name))
    assert evaluator.is_complete
    assert evaluator.performance().is_final
    assert not evaluator.performance(paper_run.program.length).is_final


def test_channel_without_samples_does_not_hold_up_the_others(paper_run: Run) -> None:
    evaluator = paper_run.evaluator([SLIDER_VELOCITY])
    evaluator.add_channel(paper_run.channel(ROD_VELOCITY))
    performance = evaluator.performance()
    assert not performance.is_final
    assert_agrees(performance, paper_run.known, "mean_velocity", "ripple")
    assert reasons(performance)["durability"] == "no samples of rod/velocity have come"


def test_next_run_starts_afresh(paper_run: Run) -> None:
    evaluator = paper_run.evaluator()
    evaluator.begin(dataclasses.replace(paper_run.program, run_id="next"))
    performance = evaluator.performance()
    assert performance.run_id == "next"
    assert performance.streams == ()
    assert all(one.reason for one in performance.indicators)


# ---------------------------------------------------------------------- run cut short


def shortened(run: Run, at: int) -> tuple[RunEvaluator, DriveProgram]:
    evaluator = run.evaluator([])
    program = run.program.stopped_at(at)
    for name in MEASURED_CHANNELS:
        evaluator.add_channel(run.channel(name))
        evaluator.add_samples(name, 0, run.samples(name)[: at + 300])
    evaluator.change_program(program)
    for name in MEASURED_CHANNELS:
        evaluator.add_samples(name, at + 300, run.samples(name)[at + 300 : program.length])
    return evaluator, program


def test_run_cut_short_is_evaluated_up_to_the_cut(paper_run: Run) -> None:
    run = paper_run.replace(contact=None)
    evaluator, program = shortened(run, 30_000)
    performance = evaluator.performance()
    assert performance.is_final
    assert performance.end_index == program.length
    free = performance.window("free_run")
    assert free is not None
    assert free.end <= 30_000
    assert_agrees(performance, run.known, "mean_velocity", "ripple", "durability", "efficiency")


def test_run_cut_short_before_the_steady_drive_has_no_indicators(paper_run: Run) -> None:
    evaluator, _ = shortened(paper_run, 5_100)
    performance = evaluator.performance()
    assert performance.is_final
    assert all("no steady drive" in reason for reason in reasons(performance).values())


def test_another_program_is_refused(paper_run: Run) -> None:
    evaluator = paper_run.evaluator([])
    for other in (
        dataclasses.replace(paper_run.program, run_id="other"),
        paper_run.replace(hold_time=0.06).program,
        paper_run.replace(frequency=4000.0).program,
    ):
        with pytest.raises(BadInputError, match="is not the program of this run"):
            evaluator.change_program(other)


# ---------------------------------------------------------------------- interface


def test_evaluator_refuses_before_begin() -> None:
    with pytest.raises(BadInputError, match="has not begun"):
        RunEvaluator().performance()


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"unit": "mm/s"}, "wrong unit"),
        ({"delay": math.nan}, "delay"),
        ({"gain_uncertainty": -0.1}, "gain_uncertainty"),
        ({"bandwidth": math.inf}, "bandwidth"),
    ],
)
def test_channel_that_makes_no_sense_is_refused(
    paper_run: Run, change: dict[str, Any], match: str
) -> None:
    evaluator = paper_run.evaluator([])
    with pytest.raises(BadInputError, match=match):
        evaluator.add_channel(dataclasses.replace(paper_run.channel(SLIDER_VELOCITY), **change))


def test_channel_may_be_described_twice_but_not_differently(paper_run: Run) -> None:
    evaluator = paper_run.evaluator([SLIDER_VELOCITY])
    evaluator.add_channel(paper_run.channel(SLIDER_VELOCITY))
    with pytest.raises(BadInputError, match="described twice"):
        evaluator.add_channel(dataclasses.replace(paper_run.channel(SLIDER_VELOCITY), delay=1.0))


def test_channel_that_no_indicator_needs_is_counted(paper_run: Run) -> None:
    evaluator = paper_run.evaluator([SLIDER_VELOCITY])
    evaluator.add_channel(ChannelDescription("slider/temperature", "temperature", "K", 400.0))
    evaluator.add_samples("slider/temperature", 0, np.full(500, 300.0))
    counts = {one.name: one.received for one in evaluator.performance().streams}
    assert counts["slider/temperature"] == 500


@pytest.mark.parametrize(("first", "samples"), [(-1, np.zeros(3)), (0, np.zeros((3, 2)))])
def test_block_of_the_wrong_form_is_refused(paper_run: Run, first: int, samples: Array) -> None:
    evaluator = paper_run.evaluator([SLIDER_VELOCITY])
    with pytest.raises(BadInputError, match="is no block"):
        evaluator.add_samples(SLIDER_VELOCITY, first, samples)


def test_evaluation_survives_json(paper_run: Run) -> None:
    for performance in (paper_run.evaluate(), paper_run.evaluate([SLIDER_VELOCITY])):
        text = json.dumps(performance.to_mapping(), allow_nan=False)
        assert Performance.from_mapping(json.loads(text)) == performance


def test_mean_waveforms_are_those_of_the_free_run(paper_run: Run) -> None:
    waveforms = paper_run.evaluator().waveforms()
    assert not waveforms.reason
    noise = paper_run.velocity_noise / math.sqrt(waveforms.periods)
    phase = waveforms.phase
    wanted = {
        ROD_VELOCITY: paper_run.rod * np.cos(2 * np.pi * phase),
        SLIDER_VELOCITY: paper_run.mean + paper_run.swing * paper_run.triangle(phase),
    }
    for name, values in wanted.items():
        # five deviations for hundreds of points, and 0.03 % of start-up at most
        error = np.max(np.abs(waveforms.velocities[name] - values))
        assert error < 5.0 * noise + 3e-4 * paper_run.mean


def test_mean_waveforms_are_missing_with_a_reason(paper_run: Run) -> None:
    waveforms = paper_run.evaluator().waveforms(until=5_500)
    assert waveforms.velocities == {}
    assert "whole drive periods" in waveforms.reason

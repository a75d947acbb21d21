"""From samples to a friction law: right, with honest intervals, or a reason."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.friction import (
    CoulombFriction,
    FrictionLaw,
    StribeckFriction,
    VelocityDependentFriction,
)
from imotor_ros.core.identification.identification import identify
from imotor_ros.core.identification.records import ChannelRecord, IdentificationParameters
from imotor_ros.core.identification.regime import BOTH, SLIDES, STICKS
from imotor_ros.core.identification.stepped_sine import SteppedSineParameters
from imotor_ros.core.lugre import LuGreFriction
from imotor_ros.core.motor import MotorParameters
from imotor_ros.core.slider import SliderParameters
from imotor_ros.core.vibrometer import VibrometerParameters
from imotor_ros.errors import BadInputError

MASS = 6.92e-3
LINE = VelocityDependentFriction()
SHORT = SteppedSineParameters(steps=14)
FINE = SteppedSineParameters(steps=24)
"""Steps of a third of a micrometre: enough of them in the transition."""


def test_line_is_identified(true_run: Callable[..., Any]) -> None:
    """A sample of what bench/friction_identification.py does with 100 seeds: 1 % and 3 %."""
    run = true_run(LINE)
    for seed in range(3):
        found = run.identify(seed)
        assert found.chosen == "velocity"
        estimates = found.fit.estimates
        assert estimates["sliding_force"].value == pytest.approx(0.940, rel=0.003)
        assert estimates["slope"].value == pytest.approx(2.213, rel=0.03)
        width = estimates["sliding_force"].high - estimates["sliding_force"].low
        assert 2e-4 < width < 8e-3
        assert found.warnings == ()


def test_constant_is_identified(true_run: Callable[..., Any]) -> None:
    run = true_run(CoulombFriction())
    for seed in range(3):
        fit = run.identify(seed).fits["coulomb"]
        assert fit.estimates["sliding_force"].value == pytest.approx(1.01, rel=0.002)


def test_intervals_hold_the_truth(true_run: Callable[..., Any]) -> None:
    """12 seeds: with 95 % each, fewer than 9 by chance once in 450."""
    run = true_run(LINE)
    found = [run.identify(seed, draws=200).fits["velocity"].estimates for seed in range(12)]
    assert sum(one["sliding_force"].holds(0.940) for one in found) >= 9
    assert sum(one["slope"].holds(2.213) for one in found) >= 9


def test_steps_tell_what_the_slider_does(true_run: Callable[..., Any]) -> None:
    found = true_run(LINE).identify()
    regimes = [one.regime for one in found.steps]
    assert regimes == regimes[::-1]
    assert regimes[0] == STICKS
    assert BOTH in regimes
    assert regimes.count(SLIDES) >= 20
    # the first step that slides; the paper's threshold of 10 mm/s is safe at 2 kHz
    assert 8e-3 < found.sliding_from < 12e-3
    for one, amplitude in zip(found.steps, SteppedSineParameters(steps=14).amplitudes, strict=True):
        assert one.measurement is not None
        # the drive is linear between samples: 1e-4 at 2 kHz; and noise at the lowest steps
        assert one.measurement.rod_amplitude == pytest.approx(amplitude, rel=5e-4, abs=2e-9)


def test_threshold_is_checked_against_the_regimes(true_run: Callable[..., Any]) -> None:
    """At 1 kHz it still sticks for a while at 10 mm/s: such steps are left out, and told."""
    run = true_run(LINE, SteppedSineParameters(frequency=1000.0, steps=24, lowest_amplitude=2e-6))
    found = run.identify(leaves_out_bad_steps=False)
    assert found.sliding_from > 10e-3
    assert any("above the threshold" in text for text in found.warnings)
    assert all(one.regime == SLIDES for one in found.steps if one.is_fitted)
    assert found.fit.estimates["sliding_force"].value == pytest.approx(0.94, rel=0.01)
    higher = run.identify(threshold=0.02)
    assert higher.warnings == ()


def test_calibration_moves_the_result_by_no_more_than_it_must(
    true_run: Callable[..., Any],
) -> None:
    """
    1 % in the slider's head: 1 % in force and slope. 1 % in the rod's head: -1 % in the slope.

    m mean |a_S| is proportional to the slider's head alone; the mean relative speed is, to first
    order, to the rod's.
    """
    run = true_run(LINE)
    rod, slider = run.records(3)

    def values(rod_gain: float, slider_gain: float) -> dict[str, float]:
        scaled = [
            replace(record, samples=gain * record.samples)
            for record, gain in ((rod, rod_gain), (slider, slider_gain))
        ]
        estimates = identify(run.program, *scaled, MASS).fits["velocity"].estimates
        return {name: one.value for name, one in estimates.items()}

    base, by_rod, by_slider = values(1.0, 1.0), values(1.01, 1.0), values(1.0, 1.01)
    assert by_slider["sliding_force"] / base["sliding_force"] == pytest.approx(1.01, abs=5e-4)
    assert by_slider["slope"] / base["slope"] == pytest.approx(1.01, abs=3e-3)
    assert by_rod["sliding_force"] / base["sliding_force"] == pytest.approx(1.0, abs=5e-4)
    assert by_rod["slope"] / base["slope"] == pytest.approx(1.0 / 1.01, abs=3e-3)


def test_calibration_is_stated_apart_from_noise(true_run: Callable[..., Any]) -> None:
    run = true_run(LINE)
    heads = VibrometerParameters(
        calibration_uncertainty=0.01, digitiser=DigitiserParameters(bits=14)
    )
    rod, slider = run.records(2, heads, heads)
    found = identify(run.program, rod, slider, MASS)
    assert found.calibration is not None
    assert found.calibration.uncertainties["sliding_force"] == pytest.approx(0.0094, rel=0.05)
    assert found.calibration.uncertainties["slope"] == pytest.approx(0.0313, rel=0.05)
    truth = slider.samples.std() / run.records(2)[1].samples.std()
    ratio = truth / (rod.samples.std() / run.records(2)[0].samples.std())
    assert found.calibration.head_ratio == pytest.approx(ratio, abs=3e-3)


def test_heads_that_disagree_are_told(true_run: Callable[..., Any]) -> None:
    run = true_run(LINE)
    rod, slider = run.records(2)
    found = identify(run.program, rod, replace(slider, samples=1.02 * slider.samples), MASS)
    assert any("where the slider sticks" in text for text in found.warnings)


def test_outer_force_is_told(true_run: Callable[..., Any]) -> None:
    """F_x over the friction force is how much longer than half a period it speeds up."""
    outer = 0.1
    run = true_run(LINE, SHORT, SliderParameters(axial_force=outer))
    found = run.identify()
    assert any("outer force" in text for text in found.warnings)
    sliding = [one.measurement for one in found.steps if one.is_fitted]
    shares = [one.rising_share - 0.5 for one in sliding if one]
    assert shares[-1] == pytest.approx(-0.5 * outer / 1.08, rel=0.1)
    # F is then (1 - (F_x / F)^2) of what it is
    assert found.fit.estimates["sliding_force"].value == pytest.approx(0.94 * 0.989, rel=3e-3)


# ---- contacts beyond the paper's --------------------------------------------------------------


def test_stribeck_friction_is_identified_where_its_peak_is_resolved(
    true_run: Callable[..., Any],
) -> None:
    """Decay at 15 mm/s: passed in 15 us and more. 1 % in the forces, 3 % in slope and decay."""
    law = StribeckFriction(decay_velocity=15e-3)
    found = true_run(law, FINE).identify(1, draws=200)
    assert found.chosen == "stribeck"
    values = {name: one.value for name, one in found.fit.estimates.items()}
    assert values["sliding_force"] == pytest.approx(0.94, rel=0.01)
    assert values["static_force"] == pytest.approx(1.2, rel=0.015)
    assert values["slope"] == pytest.approx(2.213, rel=0.03)
    assert values["decay_velocity"] == pytest.approx(15e-3, rel=0.06)


def test_fast_stribeck_peak_is_found_but_not_resolved(true_run: Callable[..., Any]) -> None:
    """Decay at 5 mm/s: the law is chosen, sliding force to 2 %; the peak's shape is open."""
    found = true_run(StribeckFriction(), FINE).identify(1, draws=200)
    assert found.chosen == "stribeck"
    estimates = found.fit.estimates
    assert estimates["sliding_force"].value == pytest.approx(0.94, rel=0.02)
    static = estimates["static_force"]
    assert static.high - static.low > 0.1
    # what the motor needs is the force where it slides
    speeds = np.linspace(0.02, 0.1, 20)
    assert found.friction.force(speeds) == pytest.approx(StribeckFriction().force(speeds), rel=0.01)


def test_stiff_elastic_contact_is_identified_nearly(true_run: Callable[..., Any]) -> None:
    """LuGre, 2 nm at break-away: 0.5 % of the force, 2 % of the slope."""
    found = true_run(LuGreFriction(stiffness=5e8), FINE).identify(1)
    estimates = found.fits["velocity"].estimates
    assert estimates["sliding_force"].value == pytest.approx(0.94, rel=0.005)
    assert estimates["slope"].value == pytest.approx(2.213, rel=0.02)


def test_soft_elastic_contact_is_refused_or_warned_of(true_run: Callable[..., Any]) -> None:
    """LuGre, 100 nm at break-away: most steps show another shape, and it is said."""
    found = true_run(LuGreFriction(stiffness=1e7), FINE).identify(1)
    assert any("another shape" in text for text in found.warnings)
    assert found.break_away is not None
    assert found.break_away.force is None


# ---- wrong inputs -------------------------------------------------------------------------------


def spoiled(
    record: ChannelRecord, change: Callable[[np.ndarray], None], **more: Any
) -> ChannelRecord:
    samples = record.samples.copy()
    change(samples)
    return replace(record, samples=samples, **more)


def drop(samples: np.ndarray) -> None:
    samples[300_000:300_017] = np.nan


def clip(samples: np.ndarray) -> None:
    np.clip(samples, -0.05, 0.05, out=samples)


@pytest.mark.parametrize("channel", [0, 1])
def test_missing_samples_end_in_a_reason(true_run: Callable[..., Any], channel: int) -> None:
    run = true_run(LINE)
    records = list(run.records(1))
    records[channel] = spoiled(records[channel], drop)
    found = identify(run.program, *records, MASS)
    assert found.fits == {}
    assert "1 of 28 steps have bad samples" in found.reason
    assert "17 samples" in found.reason
    assert "missing" in found.reason
    with pytest.raises(BadInputError, match="bad samples"):
        _ = found.friction
    rest = identify(
        run.program, *records, MASS, IdentificationParameters(leaves_out_bad_steps=True)
    )
    assert rest.reason == ""
    assert any("missing" in text for text in rest.warnings)


def test_samples_that_end_early_end_in_a_reason(true_run: Callable[..., Any]) -> None:
    run = true_run(LINE)
    rod, slider = run.records(1)
    found = identify(run.program, rod, replace(slider, samples=slider.samples[:500_000]), MASS)
    assert "missing" in found.reason


def test_clipped_samples_end_in_a_reason(true_run: Callable[..., Any]) -> None:
    run = true_run(LINE)
    rod, slider = run.records(1)
    narrow = replace(rod.channel, range=0.05)
    found = identify(run.program, spoiled(rod, clip, channel=narrow), slider, MASS)
    assert found.fits == {}
    assert "at the end of its range" in found.reason


@pytest.mark.parametrize(
    ("flag", "word"),
    [
        (SampleFlag.DROP_OUT, "drop-out"),
        (SampleFlag.OVER_RANGE, "over-range"),
        (SampleFlag.GAP, "gap"),
    ],
)
def test_flagged_blocks_end_in_a_reason(
    true_run: Callable[..., Any], flag: SampleFlag, word: str
) -> None:
    run = true_run(LINE)
    rod, slider = run.records(1)
    flagged = replace(slider, flagged=((200_000, 210_000, int(flag)),))
    found = identify(run.program, rod, flagged, MASS)
    assert word in found.reason
    other = replace(slider, flagged=((200_000, 210_000, int(SampleFlag.VOLTAGE_CLIPPED)),))
    assert identify(run.program, rod, other, MASS).reason == ""


def test_run_without_sliding_ends_in_a_reason(true_run: Callable[..., Any]) -> None:
    run = true_run(LINE, SteppedSineParameters(highest_amplitude=0.7e-6, steps=6))
    found = run.identify()
    assert found.fits == {}
    assert "only 0 of 12 steps slide all the time" in found.reason
    assert "larger amplitudes" in found.reason
    assert {one.regime for one in found.steps} == {STICKS}
    assert found.break_away is not None
    assert "no step slides" in found.break_away.reason


def test_steps_too_short_end_in_a_reason(true_run: Callable[..., Any]) -> None:
    run = true_run(LINE)
    found = run.identify(settling_time=0.018)
    assert "0 of 28 steps" in found.reason
    assert found.steps[0].measurement is None
    assert "whole periods" in found.reason


@pytest.mark.parametrize("mass", [0.0, -1.0, math.nan, math.inf])
def test_impossible_mass_is_refused(true_run: Callable[..., Any], mass: float) -> None:
    run = true_run(LINE)
    with pytest.raises(BadInputError, match="slider mass"):
        identify(run.program, *run.records(1), mass)


def test_channels_that_cannot_show_it_are_refused(true_run: Callable[..., Any]) -> None:
    run = true_run(LINE)
    rod, slider = run.records(1)
    slow = replace(rod, channel=replace(rod.channel, bandwidth=10e3))
    with pytest.raises(BadInputError, match="rod/velocity: bandwidth"):
        identify(run.program, slow, slider, MASS)
    coupled = replace(slider, channel=replace(slider.channel, high_pass_frequency=500.0))
    with pytest.raises(BadInputError, match="slider/velocity: high_pass_frequency"):
        identify(run.program, rod, coupled, MASS)


# ---- the result ---------------------------------------------------------------------------------


@pytest.mark.parametrize("law", [CoulombFriction(), LINE, StribeckFriction(decay_velocity=15e-3)])
def test_result_loads_as_a_motor_file(true_run: Callable[..., Any], law: FrictionLaw) -> None:
    found = true_run(law, FINE).identify(2, draws=100)
    text = yaml.safe_dump({"friction": found.friction_mapping()})
    motor = MotorParameters.from_mapping(yaml.safe_load(text))
    assert motor.friction == found.friction
    assert type(motor.friction) is type(law)


def test_larger_break_away_force_is_part_of_the_result(true_run: Callable[..., Any]) -> None:
    law = VelocityDependentFriction(break_away_force=1.3)
    found = true_run(law, SteppedSineParameters()).identify(1)
    assert found.friction.break_away == pytest.approx(1.3, rel=0.02)
    usual = true_run(LINE, FINE).identify(1)
    assert usual.friction_mapping()["break_away_force"] == 0.0


def test_numbers_are_plain_json(true_run: Callable[..., Any]) -> None:
    for found in (
        true_run(LINE).identify(),
        true_run(LINE, SteppedSineParameters(highest_amplitude=0.7e-6, steps=6)).identify(),
    ):
        content = json.loads(json.dumps(found.to_mapping(), allow_nan=False))
        assert len(content["steps"]) == len(found.steps)
        assert (content["friction"] is None) == bool(found.reason)


def test_contact_force_of_the_run_is_told(true_run: Callable[..., Any]) -> None:
    run = true_run(LINE)
    found = identify(run.program, *run.records(1), MASS, contact_scale=1.2)
    assert any("1.2 times the nominal contact force" in text for text in found.warnings)


def test_same_samples_give_the_same_result(true_run: Callable[..., Any]) -> None:
    run = true_run(LINE)
    assert run.identify(4).to_mapping() == run.identify(4).to_mapping()

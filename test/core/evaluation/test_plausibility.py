"""Drivers that are wrong in ways that no index shows: physics refuses, and names the defect."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    ChannelDescription,
)
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.evaluator import EvaluatorParameters, RunEvaluator
from imotor_ros.core.evaluator_parameters import PlausibilityParameters
from imotor_ros.core.excitation import voltage_for_motion
from imotor_ros.core.force_sensor import ForceSensor, ForceSensorParameters
from imotor_ros.core.indicators import UNITS, Performance
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.plausibility import agreement
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.slider import LoadParameters
from imotor_ros.core.stator import StatorParameters
from imotor_ros.core.step_probe import PROBED
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters

Array = NDArray[np.float64]

RATE = 1e6


@dataclass(frozen=True)
class Measured:
    """What was measured in a run."""

    program: DriveProgram
    channels: Mapping[str, ChannelDescription]
    samples: Mapping[str, Array]

    def evaluate(self, parameters: EvaluatorParameters | None = None) -> Performance:
        """Return the final indicators."""
        evaluator = RunEvaluator(parameters)
        evaluator.begin(self.program)
        for name, channel in self.channels.items():
            evaluator.add_channel(channel)
            evaluator.add_samples(name, 0, self.samples[name])
        return evaluator.performance()

    @cached_property
    def performance(self) -> Performance:
        """The final indicators, by the default parameters."""
        return self.evaluate()

    def changed(self, **samples: Array) -> Measured:
        """Return the run with other samples; a name's slash is two underscores."""
        new = {name.replace("__", "/"): values for name, values in samples.items()}
        return replace(self, samples={**self.samples, **new})


def measure(harmonics: int, highest: float) -> Measured:
    """Play a run on the virtual motor, without hysteresis, and measure it."""
    motion = parabolic_sawtooth(harmonics, 15e-6, maximum_frequency=highest)
    load = LoadParameters(upper_stop=1.5e-3)
    parameters = MotorParameters(load=load, stator=StatorParameters.linear())
    motor = VirtualMotor(parameters, RATE, 1)
    amplitudes, phases = voltage_for_motion(motion, motor.displacement_response)
    program = steady_drive(
        run_id="r", epoch=0, sample_rate=RATE,
        fundamental_frequency=motion.fundamental_frequency,
        offset=50.0, amplitudes=amplitudes, phases=phases, hold_time=0.08,
        motion_amplitudes=motion.amplitudes, motion_phases=motion.phases,
    )  # fmt: skip
    done = motor.process(program.render(0, program.length))
    rod = Vibrometer(VibrometerParameters(), RATE, 1, ROD_VELOCITY)
    slider = Vibrometer(VibrometerParameters(), RATE, 1, SLIDER_VELOCITY)
    force = ForceSensor(ForceSensorParameters(), RATE, 1)
    monitors = {one.name: one for one in motor.channels}
    return Measured(
        program,
        {
            **monitors,
            ROD_VELOCITY: rod.channel, SLIDER_VELOCITY: slider.channel, LOAD_FORCE: force.channel,
        },
        {
            VOLTAGE: done.voltage_monitor, CURRENT: done.current,
            ROD_VELOCITY: rod.process(done.rod_velocity)[0],
            SLIDER_VELOCITY: slider.process(done.slider_velocity)[0],
            LOAD_FORCE: force.process(done.load_force)[0],
        },
    )  # fmt: skip


@pytest.fixture(scope="module")
def good() -> Measured:
    """A run that is as it should be: two harmonics, 4625 and 9250 Hz."""
    return measure(2, 9250.0)


@pytest.fixture(scope="module")
def sticking() -> Measured:
    """One in which the slider sticks for a part of each period."""
    return measure(4, 4625.0)


def late(samples: Array, microseconds: int) -> Array:
    """Return samples that come so many microseconds late."""
    return np.concatenate([np.full(microseconds, samples[0]), samples[:-microseconds]])


def resampled(samples: Array, factor: float) -> Array:
    """Return what a clock that is too fast by a factor makes of the samples."""
    index = np.arange(samples.size)
    return np.interp(index / factor, index, samples)


def scaled(name: str, factor: float) -> Callable[[Measured], Measured]:
    """Return a mutant whose one channel is wrong by a factor."""
    return lambda run: run.changed(**{name.replace("/", "__"): factor * run.samples[name]})


def delayed(name: str, microseconds: int) -> Callable[[Measured], Measured]:
    """Return a mutant whose one channel is late and does not say so."""
    return lambda run: run.changed(
        **{name.replace("/", "__"): late(run.samples[name], microseconds)}
    )


def swapped(one: str, other: str) -> Callable[[Measured], Measured]:
    """Return a mutant whose cables are swapped."""
    return lambda run: run.changed(
        **{one.replace("/", "__"): run.samples[other], other.replace("/", "__"): run.samples[one]}
    )


def slipping(*names: str) -> Callable[[Measured], Measured]:
    """Return a mutant whose channels have a clock of their own, too fast by 100 ppm."""
    return lambda run: run.changed(
        **{n.replace("/", "__"): resampled(run.samples[n], 1.0001) for n in names}
    )


def leaky(name: str) -> Callable[[Measured], Measured]:
    """Return a mutant that loses one sample without notice in the middle of the run."""

    def make(run: Measured) -> Measured:
        kept = run.samples[name]
        middle = kept.size // 2
        fewer = np.concatenate([kept[:middle], kept[middle + 1 :], kept[-1:]])
        return run.changed(**{name.replace("/", "__"): fewer})

    return make


VELOCITY = ("mean_velocity", "start_up_time", "ripple", "durability", "efficiency")

MUTANTS = {
    "voltage in another unit": (scaled(VOLTAGE, 1e-3), "drive/voltage_monitor change by steps"),
    "voltage too small": (scaled(VOLTAGE, 0.5), "does not show the voltage of the drive program"),
    "voltage upside down": (scaled(VOLTAGE, -1.0), "does not show the voltage of the drive"),
    "voltage late": (delayed(VOLTAGE, 40), "40 us late|us late .*undeclared delay"),
    "voltage leaky": (leaky(VOLTAGE), "slips against the drive by -1 samples"),
    "all on another clock": (
        slipping(VOLTAGE, CURRENT, ROD_VELOCITY, SLIDER_VELOCITY, LOAD_FORCE),
        "slips against the drive by .* another clock",
    ),
    "rod in mm/s": (scaled(ROD_VELOCITY, 1e3), "at the end of its range"),
    "rod in km/s": (scaled(ROD_VELOCITY, 1e-3), "rod/velocity change by steps"),
    "rod too small": (scaled(ROD_VELOCITY, 0.4), "does not show the motion that the drive"),
    "rod upside down": (scaled(ROD_VELOCITY, -1.0), "rod/velocity does not show the motion"),
    "rod on another clock": (slipping(ROD_VELOCITY), "rod/velocity slips against the drive"),
    "slider in mm/s": (scaled(SLIDER_VELOCITY, 1e3), "slider/velocity are at the end of its range"),
    "slider in km/s": (scaled(SLIDER_VELOCITY, 1e-3), "slider/velocity change by steps"),
    "slider upside down": (scaled(SLIDER_VELOCITY, -1.0), "contradict each other|not faster"),
    "slider in the wrong range": (scaled(SLIDER_VELOCITY, 2.0), "contradict each other"),
    "slider late": (delayed(SLIDER_VELOCITY, 10), "early against slider/velocity .*undeclared"),
    "rod late": (delayed(ROD_VELOCITY, 10), "late against slider/velocity .*undeclared delay"),
    "current in mA": (scaled(CURRENT, 1e3), "drive/current are at the end of its range"),
    "current in kA": (scaled(CURRENT, 1e-3), "drive/current change by steps"),
    "current late": (delayed(CURRENT, 60), "not the current of a piezoelectric stack"),
    "force in mN": (scaled(LOAD_FORCE, 1e3), "load/force are at the end of its range"),
    "force in kN": (scaled(LOAD_FORCE, 1e-3), "load/force change by steps"),
    "rod and slider swapped": (swapped(ROD_VELOCITY, SLIDER_VELOCITY), "fixed to the stator"),
    "voltage and current swapped": (swapped(VOLTAGE, CURRENT), "drive/voltage_monitor|range"),
    "current and force swapped": (swapped(CURRENT, LOAD_FORCE), "steps|piezoelectric stack"),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_mutant_gives_no_wrong_number_in_silence(good: Measured, name: str) -> None:
    """What rests on the wrong channel is refused with the defect's name; the rest is unchanged."""
    mutate, message = MUTANTS[name]
    right, wrong = good.performance, mutate(good).evaluate()
    refused = [one.reason for one in wrong.indicators if not one.is_available]
    assert any(re.search(message, reason) for reason in refused), refused
    for one in wrong.indicators:
        if one.is_available:
            true = right.indicator(one.name)
            assert abs(one.value - true.value) < 0.5 * true.uncertainty, one


def test_good_runs_are_not_refused(good: Measured, sticking: Measured) -> None:
    for run in (good, sticking):
        for one in run.evaluate().indicators:
            is_fast = one.name == "start_up_time"  # may be too fast to be seen
            assert one.is_available or is_fast, one.reason
            assert not any(word in one.reason for word in ("contradict", "does not show", "delay"))


def test_delays_are_seen_where_the_slider_sticks_too(sticking: Measured) -> None:
    """Less sharply: while both move together, their relative velocity says nothing."""
    for name in (ROD_VELOCITY, SLIDER_VELOCITY):
        reason = delayed(name, 25)(sticking).evaluate().indicator("durability").reason
        assert "undeclared delay" in reason, (name, reason)


def test_smaller_factors_are_warned_of(good: Measured) -> None:
    """Half the velocity is a slider that could be, nearly: the reader has to know."""
    assert not any("factor" in one for one in good.evaluate().warnings)
    found = scaled(SLIDER_VELOCITY, 0.5)(good).evaluate()
    assert found.indicator("mean_velocity").is_available
    assert any("a factor of it" in one for one in found.warnings), found.warnings


def test_declared_delay_is_no_defect(good: Measured) -> None:
    channel = good.channels[ROD_VELOCITY]
    honest = replace(channel, delay=channel.delay + 30e-6)
    run = replace(delayed(ROD_VELOCITY, 30)(good), channels={**good.channels, ROD_VELOCITY: honest})
    found = run.evaluate().indicator("durability")
    assert found.value == pytest.approx(good.evaluate().indicator("durability").value, rel=1e-4)


def test_checks_can_be_switched_off_and_widened(good: Measured) -> None:
    wrong = scaled(SLIDER_VELOCITY, 2.0)(good)
    for changes in ({"is_checked": False}, {"friction_agreement": -1.0, "lag_tolerance": 1.0}):
        parameters = EvaluatorParameters(plausibility=PlausibilityParameters(**changes))
        found = wrong.evaluate(parameters)
        assert found.indicator("mean_velocity").is_available, changes


def test_stamps_from_another_clock_are_refused(good: Measured) -> None:
    evaluator = RunEvaluator()
    evaluator.begin(good.program)
    for name, channel in good.channels.items():
        evaluator.add_channel(channel)
        error = 1_500_000_000 if name == SLIDER_VELOCITY else 0
        evaluator.add_samples(name, 0, good.samples[name], stamp_error=error)
    found = {one.name: one.reason for one in evaluator.performance().indicators}
    assert "stamps of slider/velocity" in found["mean_velocity"]
    assert "1.5 s off: stamps from another clock" in found["mean_velocity"]
    assert found["force"] == ""


def test_blocks_do_not_matter(good: Measured) -> None:
    """The steps are looked at in the same samples, however they come."""
    wrong = scaled(SLIDER_VELOCITY, 1e-3)(good)
    whole = wrong.evaluate()
    evaluator = RunEvaluator()
    evaluator.begin(wrong.program)
    for name, channel in wrong.channels.items():
        evaluator.add_channel(channel)
        for first in range(0, wrong.samples[name].size, 777):
            evaluator.add_samples(name, first, wrong.samples[name][first : first + 777])
    assert repr(evaluator.performance()) == repr(whole)
    start = wrong.program.span("hold")[0]
    early = evaluator.performance(until=start + PROBED - 1)
    assert "steps" not in early.indicator("mean_velocity").reason


def test_agreement_of_a_slider_that_friction_drags() -> None:
    """Worked case: a slider with acceleration of constant size, a rod that passes it at 0, 1/2."""
    phase = (np.arange(256) + 0.5) / 256
    rod = np.cos(2 * np.pi * phase)
    slider = 0.05 * (1.0 - np.abs(4.0 * ((phase + 0.25) % 1.0) - 2.0))
    found = agreement(rod, slider, 256e-6, 0.2, 60)
    assert found is not None
    assert found.value > 0.99
    assert found.earliest < 0.0 < found.latest
    shifted = agreement(np.roll(rod, 20), slider, 256e-6, 0.2, 60)
    assert shifted is not None
    assert shifted.distance > 5e-6
    against = agreement(rod, -slider, 256e-6, 0.2, 60)
    assert against is not None
    assert against.value < 0.5
    assert agreement(rod, rod, 256e-6, 0.2, 60) is None
    assert set(UNITS) >= set(VELOCITY)

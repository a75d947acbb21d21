"""A run measured on paper: every quantity is a formula, so that every indicator is known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

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
)
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.evaluator import EvaluatorParameters, RunEvaluator
from imotor_ros.core.evaluator_parameters import PlausibilityParameters
from imotor_ros.core.indicators import Performance

Array = NDArray[np.float64]

UNCHECKED = PlausibilityParameters(is_checked=False)

UNITS = {ROD_VELOCITY: "m/s", SLIDER_VELOCITY: "m/s", LOAD_FORCE: "N", VOLTAGE: "V", CURRENT: "A"}


@dataclass(frozen=True)
class PaperRun:
    """
    A run of which everything is known.

    The rod velocity is a cosine. The slider's period-mean velocity approaches its steady value
    exponentially; on it rides a triangle of 21 harmonics. At `contact` (s after the start of the
    drive) the mean velocity becomes zero and the force starts to rise, exponentially too.
    """

    frequency: float = 4625.0
    sample_rate: float = 1e6
    hold_time: float = 0.05
    bias_time: float = 5e-3
    ramp_periods: float = 1.0
    mean: float = 0.05
    missing_at_start: float = 1.0
    time_constant: float = 1e-3
    swing: float = 0.01
    rod: float = 0.3
    sticks: bool = False
    contact: float | None = 0.035
    force: float = 0.3
    force_time_constant: float = 5e-4
    force_offset: float = 0.02
    voltages: tuple[float, ...] = (30.0, 10.0)
    currents: tuple[float, ...] = (0.5, 0.3)
    velocity_noise: float = 3e-4
    force_noise: float = 3e-3
    delays: tuple[float, ...] = (6e-6, 7.3e-6, 40e-6, 1e-6, 2.5e-6)
    seed: int = 0
    changes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def replace(self, **changes: object) -> PaperRun:
        """Return the run with some things changed."""
        return replace(self, **changes)  # type: ignore[arg-type]

    @property
    def program(self) -> DriveProgram:
        """The drive program."""
        return steady_drive(
            run_id="paper",
            epoch=0,
            sample_rate=self.sample_rate,
            fundamental_frequency=self.frequency,
            offset=50.0,
            amplitudes=(30.0, 10.0),
            phases=(0.0, 0.0),
            hold_time=self.hold_time,
            bias_time=self.bias_time,
            ramp_periods=self.ramp_periods,
            motion_amplitudes=(6e-6, 2e-6),
            motion_phases=(0.0, 0.0),
        )

    def channel(self, name: str) -> ChannelDescription:
        """The description of a channel; its bandwidth is unknown unless changed."""
        delay = self.delays[MEASURED_CHANNELS.index(name)]
        made = ChannelDescription(name, "", UNITS[name], 0.0, delay=delay)
        return replace(made, **self.changes.get(name, {}))

    def triangle(self, cycles: Array) -> Array:
        """A triangle of 21 harmonics; its extrema are at 0 and 1/2 cycle."""
        orders = range(1, 22, 2)
        return sum(4 / (math.pi * k) ** 2 * np.cos(2 * np.pi * k * cycles) for k in orders)

    @property
    def triangle_swing(self) -> float:
        """Peak-to-peak value of the triangle."""
        return 2.0 * sum(4 / (math.pi * k) ** 2 for k in range(1, 22, 2))

    def quantity(self, name: str, time: Array) -> Array:
        """A quantity at times (s) since the start of the drive."""
        cycles = self.frequency * time
        is_on = (time >= 0.0) & (time < self.hold_time + self.ramp_periods / self.frequency)
        late = time - math.inf if self.contact is None else time - self.contact
        is_free = late < 0.0
        if name == ROD_VELOCITY or (name == SLIDER_VELOCITY and self.sticks):
            return is_on * self.rod * np.cos(2 * np.pi * cycles)
        if name == SLIDER_VELOCITY:
            left = np.exp(-np.maximum(time, 0.0) / self.time_constant)
            mean = self.mean * (1.0 - self.missing_at_start * left)
            return is_on * (is_free * mean + self.swing * self.triangle(cycles))
        if name == LOAD_FORCE:
            risen = 1.0 - np.exp(-np.maximum(late, 0.0) / self.force_time_constant)
            return is_on * ~is_free * self.force * math.copysign(1.0, self.mean) * risen
        values = self.voltages if name == VOLTAGE else self.currents
        return sum(a * np.sin(2 * np.pi * k * cycles + k) for k, a in enumerate(values, 1))

    def samples(self, name: str) -> Array:
        """The measured samples of a channel."""
        length = self.program.length
        start = self.program.span("ramp_up")[0]
        delay = self.delays[MEASURED_CHANNELS.index(name)]
        time = (np.arange(length) - start) / self.sample_rate - delay
        seeds = (self.seed, MEASURED_CHANNELS.index(name))
        noise = np.random.default_rng(seeds).standard_normal(length)
        scale = {LOAD_FORCE: self.force_noise, VOLTAGE: 0.1, CURRENT: 2e-3}
        offset = self.force_offset if name == LOAD_FORCE else 0.0
        noise *= scale.get(name, self.velocity_noise)
        return np.asarray(self.quantity(name, time) + noise + offset)

    def evaluator(
        self,
        names: Iterable[str] = MEASURED_CHANNELS,
        *,
        block: int = 10_000,
        parameters: EvaluatorParameters | None = None,
        **changed: Array,
    ) -> RunEvaluator:
        """
        An evaluator that has been given all samples of the named channels.

        Formulas that are independent of each other contradict each other: that is not checked.
        """
        evaluator = RunEvaluator(
            (parameters or EvaluatorParameters()).replace(plausibility=UNCHECKED)
        )
        evaluator.begin(self.program)
        for name in names:
            evaluator.add_channel(self.channel(name))
            samples = changed.get(name.replace("/", "_"))
            samples = self.samples(name) if samples is None else samples
            for first in range(0, samples.size, block):
                evaluator.add_samples(name, first, samples[first : first + block])
        return evaluator

    def evaluate(self, names: Iterable[str] = MEASURED_CHANNELS, **options: Array) -> Performance:
        """The final indicators."""
        return self.evaluator(names, **options).performance()

    @property
    def known(self) -> dict[str, float]:
        """
        The indicators as they follow from the formulas.

        The start-up time is that of the mean velocity over the period about each moment.
        """
        fine = (np.arange(100_000) + 0.5) / 100_000
        relative = self.rod * np.cos(2 * np.pi * fine) - self.swing * self.triangle(fine)
        relative -= self.mean
        half = 0.5 / self.frequency / self.time_constant
        missing = max(abs(self.missing_at_start) * math.sinh(half) / half, 0.01)
        power = 0.5 * math.hypot(*self.voltages) * math.hypot(*self.currents)
        return {
            "mean_velocity": self.mean,
            "start_up_time": self.time_constant * math.log(missing / 0.01),
            "ripple": self.swing * self.triangle_swing / abs(self.mean),
            "durability": abs(self.mean) / float(np.mean(np.abs(relative))),
            "efficiency": abs(self.mean) / power,
            "force": self.force,
        }


@pytest.fixture(scope="session")
def paper_run() -> PaperRun:
    """The standard run; what a test needs differently it changes by `replace`."""
    return PaperRun()

"""From the samples of a run to what every step tells, or why it tells nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass

from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.identification.harmonics import (
    Harmonics,
    measure_harmonics,
    whole_periods,
)
from imotor_ros.core.identification.records import ChannelRecord, IdentificationParameters
from imotor_ros.core.identification.regime import SLIDES, Agreement, classify, find_agreement
from imotor_ros.core.identification.results import StepResult
from imotor_ros.core.identification.stepped_sine import REST, DriveStep, steps_of
from imotor_ros.core.identification.steps import (
    FEWEST_HARMONICS,
    ROD_SHARE,
    SLIDER_SHARE,
    compare_heads,
    harmonic_count,
    measure_step,
)
from imotor_ros.errors import BadInputError

# Samples around what is evaluated that must be good as well: the filters spread what is not.
_MARGIN = 64

# The offset is a mean over the rest, of which the first part is left to the filters.
_REST_SKIPPED = 0.2

_FEWEST_DEVIATIONS = 10.0
_CLEAR_MISFIT = 3.0
_LARGEST_DRIFT = 0.01


@dataclass(frozen=True)
class MeasuredRun:
    """
    A run to be evaluated.

    Attributes
    ----------
    program : DriveProgram
        What was played.
    rod, slider : ChannelRecord
        Measured velocities.
    mass : float
        Mass of the slider (kg).
    parameters : IdentificationParameters
        How to evaluate.

    """

    program: DriveProgram
    rod: ChannelRecord
    slider: ChannelRecord
    mass: float
    parameters: IdentificationParameters

    @property
    def frequency(self) -> float:
        """Frequency of the drive (Hz)."""
        return self.program.fundamental_frequency

    @property
    def rate(self) -> float:
        """Samples per second (Hz)."""
        return self.program.sample_rate


def evaluate_steps(run: MeasuredRun) -> tuple[list[StepResult], Agreement]:
    """
    Return what came of every step, and how the heads agree where the slider sticks.

    Raises
    ------
    BadInputError
        If the program has no steps, a channel is AC-coupled too high, or its low-pass leaves too
        few harmonics.

    """
    counts, offset = _harmonics(run), _rest_offset(run)
    folded = [_fold(run, step, counts) for step in steps_of(run.program)]
    # tells in every step where the rod overtakes the slider
    agreement = find_agreement([compare_heads(*one.heads) for one in folded if one.heads])
    results = [_measure(run, one, offset, agreement.ratio) for one in folded]
    return [_judged(run, one, agreement) for one in results], agreement


def _harmonics(run: MeasuredRun) -> tuple[int, int]:
    """Return how many harmonics of rod and slider are used."""
    pairs = ((run.rod.channel, ROD_SHARE), (run.slider.channel, SLIDER_SHARE))
    counts = []
    for channel, share in pairs:
        if channel.high_pass_frequency > 0.1 * run.frequency:
            raise BadInputError(
                "is coupled too high", where=f"{channel.name}: high_pass_frequency",
                value=channel.high_pass_frequency, bound=f"<= {0.1 * run.frequency:g} Hz",
            )  # fmt: skip
        counts.append(harmonic_count(run.frequency, channel.bandwidth, run.rate, share))
        if counts[-1] < FEWEST_HARMONICS:
            raise BadInputError(
                "is too low for the drive frequency",
                where=f"{channel.name}: bandwidth or sample rate", value=counts[-1],
                bound=f">= {FEWEST_HARMONICS} harmonics of {run.frequency:g} Hz below "
                f"{share:g} of the bandwidth and a fifth of the sample rate",
            )  # fmt: skip
    return counts[0], counts[1]


def _rest_offset(run: MeasuredRun) -> float | None:
    """Return the offset of the slider's channel, from the rest before the first step."""
    if not any(segment.label == REST for segment in run.program.segments):
        return None
    start, end = run.program.span(REST)
    start += round(_REST_SKIPPED * (end - start))
    if run.slider.fault(start, end):
        return None
    return float(run.slider.samples[start:end].mean())


@dataclass(frozen=True)
class _Folded:
    """The harmonics of both velocities in one step, or why there are none."""

    step: DriveStep
    heads: tuple[Harmonics, Harmonics] | None = None
    reason: str = ""
    is_bad: bool = False


def _fold(run: MeasuredRun, step: DriveStep, counts: tuple[int, int]) -> _Folded:
    start = step.start + round(run.parameters.settling_time * run.rate)
    period = run.rate / run.frequency
    delays = [record.channel.delay * run.rate for record in (run.rod, run.slider)]
    periods = whole_periods(start, step.end, period, max(delays))
    if periods < run.parameters.minimum_periods:
        return _Folded(step, reason=f"only {periods} whole periods after settling")
    end = start + math.ceil(periods * period + max(0.0, *delays))
    for record in (run.rod, run.slider):
        fault = record.fault(start - _MARGIN, end + _MARGIN)
        if fault:
            return _Folded(step, reason=fault, is_bad=True)
    rod, slider = (
        measure_harmonics(
            record.samples, record.channel, start=start, periods=periods,
            frequency=run.frequency, sample_rate=run.rate, count=count,
        )
        for record, count in zip((run.rod, run.slider), counts, strict=True)
    )  # fmt: skip
    if min(abs(one.phasors[0]) / one.noise for one in (rod, slider)) < _FEWEST_DEVIATIONS:
        return _Folded(step, reason="the motion is lost in the noise")
    return _Folded(step, (rod, slider))


def _measure(
    run: MeasuredRun, folded: _Folded, offset: float | None, agreement: complex
) -> StepResult:
    step = folded.step
    if folded.heads is None:
        return StepResult(step, reason=folded.reason, is_bad=folded.is_bad)
    rod, slider = folded.heads
    measurement = measure_step(
        step, run.frequency, rod, slider, slider_offset=offset, agreement=agreement
    )
    return StepResult(step, measurement)


def _judged(run: MeasuredRun, result: StepResult, agreement: Agreement) -> StepResult:
    """Add the regime, and whether the step is one to fit a law to."""
    one = result.measurement
    if one is None:
        return result
    regime = classify(one, agreement)
    is_above = one.mean_relative_speed >= run.parameters.threshold
    reason = ""
    if is_above and regime != SLIDES:
        reason = "above the threshold, but it does not clearly slide all the time"
    elif one.drift > _LARGEST_DRIFT + 10.0 * one.phase_noise:
        reason = f"has not settled: it changes by {100 * one.drift:.1f} %"
    elif is_above and one.misfit > _CLEAR_MISFIT:
        reason = (
            f"the slider velocity has another shape: chi square {one.misfit:.0f} times too large"
        )
    is_fitted = is_above and not reason
    return StepResult(result.step, one, regime, is_fitted, reason)

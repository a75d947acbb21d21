"""
From a run with a stepped sine to a friction law: section 5 of the paper, figure 9.

A step that cannot be evaluated, and a run from which no law follows, end in a reason.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.identification.break_away import BreakAway, Transition, estimate_break_away
from imotor_ros.core.identification.correction import correct_stribeck
from imotor_ros.core.identification.evaluation import MeasuredRun, evaluate_steps
from imotor_ros.core.identification.fits import (
    COULOMB,
    FEWEST_STEPS,
    STRIBECK,
    Bootstrap,
    Estimate,
    FrictionFit,
    SlidingSteps,
    choose,
    fit_law,
    fit_laws,
    mean_difference,
)
from imotor_ros.core.identification.records import ChannelRecord, IdentificationParameters
from imotor_ros.core.identification.regime import SLIDES, Agreement
from imotor_ros.core.identification.results import Calibration, Identification, StepResult
from imotor_ros.core.identification.stepped_sine import FALLING, RISING
from imotor_ros.core.identification.steps import StepMeasurement
from imotor_ros.errors import BadInputError

# Outer force that makes the slider speed up for longer than it slows down, and the change of gain
# by which sensitivities are found.
_CLEAR_ASYMMETRY = 0.03
_GAIN_STEP = 1e-3
_CLEAR_SCALE = 1e-6


def identify(
    program: DriveProgram,
    rod: ChannelRecord,
    slider: ChannelRecord,
    mass: float,
    parameters: IdentificationParameters | None = None,
    *,
    contact_scale: float = 1.0,
) -> Identification:
    """
    Identify the friction of a motor from a run with a stepped sine.

    Parameters
    ----------
    program : DriveProgram
        What was played: steps of constant amplitude at one frequency.
    rod, slider : ChannelRecord
        Measured velocities.
    mass : float
        Mass of the slider (kg).
    parameters : IdentificationParameters, optional
        How to evaluate.
    contact_scale : float
        Contact force of the run over the nominal one, for which a friction law holds; the law
        found is that of the run, and a warning tells of a difference.

    Raises
    ------
    BadInputError
        If the program has no steps, the mass is no positive number, a channel is AC-coupled too
        high, or the low-pass leaves too few harmonics.

    """
    if not (math.isfinite(mass) and mass > 0.0):
        raise BadInputError("is out of bounds", where="slider mass", value=mass, bound="> 0 kg")
    settings = parameters or IdentificationParameters()
    run = MeasuredRun(program, rod, slider, mass, settings)
    results, agreement = evaluate_steps(run)
    found = _conclude(run, results, agreement)
    if abs(contact_scale - 1.0) < _CLEAR_SCALE:
        return found
    warning = f"the law is that at {contact_scale:.4g} times the nominal contact force"
    return replace(found, warnings=(*found.warnings, warning))


def _conclude(
    run: MeasuredRun, results: Sequence[StepResult], agreement: Agreement
) -> Identification:
    fitted = [one.measurement for one in results if one.is_fitted and one.measurement]
    warnings = [*_step_warnings(results, fitted), *_head_warnings(run, agreement)]
    reason = _no_law(run, results, fitted)
    fits: dict[str, FrictionFit] = {}
    chosen = ""
    hysteresis = calibration = None
    if not reason:
        steps = _sliding_steps(run, fitted)
        settings = run.parameters
        bootstrap = Bootstrap(settings.draws, settings.confidence, settings.seed)
        fits = fit_laws(steps, bootstrap)
        chosen = choose(fits).law
        if chosen == STRIBECK:
            fits[chosen] = correct_stribeck(
                fitted, steps, fits[chosen], bootstrap, run.mass, run.frequency
            )
        hysteresis = _hysteresis(run, results, fits[chosen])
        calibration = _calibration(run, fitted, chosen, agreement)
        warnings += [fits[chosen].remark] if fits[chosen].remark else []
    measured = [one for one in results if one.measurement is not None]
    return Identification(
        frequency=run.frequency,
        mass=run.mass,
        steps=tuple(results),
        fits=fits,
        chosen=chosen,
        threshold=run.parameters.threshold,
        sliding_from=_sliding_from(measured),
        hysteresis=hysteresis,
        break_away=_break_away(run, measured, agreement, fits.get(chosen)),
        calibration=calibration,
        warnings=tuple(warnings),
        reason=reason,
    )


def _no_law(
    run: MeasuredRun, results: Sequence[StepResult], fitted: Sequence[StepMeasurement]
) -> str:
    bad = [one for one in results if one.is_bad]
    if bad and not run.parameters.leaves_out_bad_steps:
        return (
            f"{len(bad)} of {len(results)} steps have bad samples, the first is step "
            f"{bad[0].step.number}: {bad[0].reason}"
        )
    if len(fitted) >= FEWEST_STEPS:
        return ""
    text = (
        f"only {len(fitted)} of {len(results)} steps slide all the time at a mean relative speed "
        f"of {run.parameters.threshold:g} m/s or more, at least {FEWEST_STEPS} are needed"
    )
    others = _by_reason(results)
    if not others:
        return f"{text}: drive with larger amplitudes"
    worst = max(others, key=lambda one: len(others[one]))
    return f"{text}; {len(others[worst])} are left out: {worst}"


def _sliding_steps(
    run: MeasuredRun,
    fitted: Sequence[StepMeasurement],
    rod_gain: float = 1.0,
    slider_gain: float = 1.0,
) -> SlidingSteps:
    speeds = np.array([one.relative_speeds(slider_gain, rod_gain) for one in fitted])
    accelerations = np.array([one.mean_acceleration for one in fitted])
    return SlidingSteps(speeds, slider_gain * run.mass * accelerations)


def _hysteresis(
    run: MeasuredRun, results: Sequence[StepResult], fit: FrictionFit
) -> Estimate | None:
    """Compare what is left of the forces on both branches once the law is taken off."""
    branches = np.array([one.step.branch for one in results if one.is_fitted])
    falling, rising = (fit.residuals[branches == branch] for branch in (FALLING, RISING))
    if min(falling.size, rising.size) < 3:
        return None
    return mean_difference(falling, rising, run.parameters.confidence)


def _calibration(
    run: MeasuredRun, fitted: Sequence[StepMeasurement], chosen: str, agreement: Agreement
) -> Calibration:
    single = Bootstrap(draws=2)

    def values(rod_gain: float, slider_gain: float) -> dict[str, float]:
        fit = fit_law(chosen, _sliding_steps(run, fitted, rod_gain, slider_gain), single)
        return {name: one.value for name, one in fit.estimates.items()}

    up, down = 1.0 + _GAIN_STEP, 1.0 - _GAIN_STEP
    middle = values(1.0, 1.0)
    pairs = {
        run.rod.channel.name: (values(up, 1.0), values(down, 1.0)),
        run.slider.channel.name: (values(1.0, up), values(1.0, down)),
    }
    gains = {
        record.channel.name: record.channel.gain_uncertainty for record in (run.rod, run.slider)
    }
    sensitivities = {
        name: {
            channel: (high[name] - low[name]) / (2.0 * _GAIN_STEP * value) if value else 0.0
            for channel, (high, low) in pairs.items()
        }
        for name, value in middle.items()
    }
    uncertainties = {
        name: abs(middle[name])
        * math.sqrt(sum((one * gains[channel]) ** 2 for channel, one in by_channel.items()))
        for name, by_channel in sensitivities.items()
    }
    ratio = agreement.ratio
    return Calibration(
        gains, sensitivities, uncertainties, abs(ratio), cmath.phase(ratio),
        agreement.uncertainty if agreement.steps else math.nan,
    )  # fmt: skip


def _break_away(
    run: MeasuredRun,
    measured: Sequence[StepResult],
    agreement: Agreement,
    fit: FrictionFit | None,
) -> BreakAway:
    slope = fit.estimates["slope"].value if fit and fit.law != COULOMB else 0.0
    transition = Transition(
        [one.measurement for one in measured if one.measurement is not None],
        [one.regime for one in measured],
        agreement,
        run.frequency,
        run.mass,
        slope,
    )
    return estimate_break_away(transition, run.parameters.confidence)


def _sliding_from(measured: Sequence[StepResult]) -> float:
    speeds = [
        (one.measurement.mean_relative_speed, one.regime == SLIDES)
        for one in measured
        if one.measurement is not None
    ]
    highest = max((speed for speed, slides in speeds if not slides), default=-math.inf)
    above = [speed for speed, slides in speeds if slides and speed > highest]
    return min(above, default=math.nan)


def _step_warnings(
    results: Sequence[StepResult], fitted: Sequence[StepMeasurement]
) -> Iterator[str]:
    for reason, numbers in _by_reason(results).items():
        yield f"left out: steps {_ranges(numbers)}: {reason}"
    asymmetry = max((abs(one.rising_share - 0.5) for one in fitted), default=0.0)
    if asymmetry > _CLEAR_ASYMMETRY:
        yield (
            f"the slider speeds up for {50 + 100 * asymmetry:.0f} % of a period at most: an outer "
            f"force acts on it, and the forces found are up to {400 * asymmetry**2:.1f} % low"
        )


def _by_reason(results: Sequence[StepResult]) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for one in results:
        if one.reason:
            # numbers in the reason differ from step to step
            found.setdefault(one.reason.split(":")[0], []).append(one.step.number)
    return found


def _ranges(numbers: Sequence[int]) -> str:
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][-1] + 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(f"{p[0]} to {p[-1]}" if len(p) > 1 else str(p[0]) for p in parts)


def _head_warnings(run: MeasuredRun, agreement: Agreement) -> Iterator[str]:
    if agreement.steps == 0:
        return
    stated = math.hypot(run.rod.channel.gain_uncertainty, run.slider.channel.gain_uncertainty)
    limit = 3.0 * math.hypot(stated, agreement.uncertainty) + 2e-3
    if abs(abs(agreement.ratio) - 1.0) > limit:
        yield (
            f"where the slider sticks, its head shows {abs(agreement.ratio):.4f} times the rod's "
            f"velocity: more than their calibrations leave open ({stated:.2%})"
        )

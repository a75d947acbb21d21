"""Pictures like figures 7, 8 and 9 of the paper, from the run that friction was identified from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imotor_ros.bag.identify import read_channels
from imotor_ros.bag.reader import RunBag
from imotor_ros.core.channel import ROD_VELOCITY, SLIDER_VELOCITY
from imotor_ros.core.identification.fits import FrictionFit
from imotor_ros.core.identification.prediction import predict_slider
from imotor_ros.core.identification.records import ChannelRecord
from imotor_ros.core.identification.regime import BOTH, SLIDES, STICKS
from imotor_ros.core.identification.results import Identification, StepResult
from imotor_ros.core.identification.stepped_sine import RISING
from imotor_ros.core.identification.steps import StepMeasurement
from imotor_ros.core.phases import trigonometric_value

Array = NDArray[np.float64]

_ROD, _SLIDER, _MODEL = "#8a8f98", "#0b62a4", "#d1495b"
_LAW_COLOURS = {"coulomb": "#7a8b3c", "velocity": "#d1495b", "stribeck": "#6a4c93"}
_LAW_NAMES = {"coulomb": "constant", "velocity": "line", "stribeck": "with Stribeck part"}
_REGIME_COLOURS = {STICKS: "#8a8f98", BOTH: "#e08e0b", SLIDES: "#0b62a4"}
_REGIME_NAMES = {STICKS: "sticks", BOTH: "sticks and slides", SLIDES: "slides all the time"}

_FIGURE_8 = (0.1e-6, 0.8e-6, 2.5e-6, 8e-6)
_PERIODS_SHOWN = 2.0
_LETTERS = "abcd"


def draw_figures(found: Identification, bag_path: Path, output: Path) -> dict[str, Path]:
    """
    Draw the three figures, as far as there is something to draw.

    Parameters
    ----------
    found : Identification
        What was identified.
    bag_path : Path
        The bag of the run.
    output : Path
        Folder of the pictures.

    Returns
    -------
    dict
        Paths by figure: "figure_7", ...

    """
    measured = [one for one in found.steps if one.measurement is not None]
    if not measured:
        return {}
    with RunBag(bag_path) as bag:
        records, rate = read_channels(bag), bag.program.sample_rate
    figures = {
        "figure_7": _characteristics(found, measured),
        "figure_8": _time_series(found, measured, records, rate),
        "figure_9": _forces(found, measured),
    }
    paths = {name: output / f"{name}.png" for name in figures}
    for name, figure in figures.items():
        figure.savefig(paths[name], dpi=100)
    return paths


def _new_figure(size: tuple[float, float], title: str) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    figure.suptitle(title)
    return figure


# ---- figure 7: what the slider does, by regime --------------------------------------------------


def _characteristics(found: Identification, measured: Sequence[StepResult]) -> Any:
    figure = _new_figure((10, 6.5), "Slider velocity under a sine: reconstructed, and by the law")
    examples = _examples(measured)
    panels = figure.subplots(2, 2).ravel()
    for axes, result, letter in zip(panels, examples, _LETTERS, strict=False):
        one = _measurement(result)
        _draw_period(axes, found, one)
        regime = _REGIME_NAMES[result.regime]
        axes.set_title(f"({letter}) {1e6 * one.rod_amplitude:.2f} µm: {regime}", fontsize=10)
    _remove_empty(panels, len(examples))
    panels[0].legend(loc="upper right", frameon=False, fontsize=8)
    return figure


def _remove_empty(panels: Sequence[Any], used: int) -> None:
    for axes in panels[used:]:
        axes.remove()


def _examples(measured: Sequence[StepResult]) -> list[StepResult]:
    """Return a step that sticks, one that does both, the first that slides, and the largest."""
    rising = [one for one in measured if one.step.branch == RISING] or list(measured)
    of = {name: [one for one in rising if one.regime == name] for name in (STICKS, BOTH, SLIDES)}
    chosen = [steps[len(steps) // 2] for steps in (of[STICKS], of[BOTH]) if steps]
    chosen += of[SLIDES][:1] + of[SLIDES][1:][-1:]
    return chosen


def _draw_period(axes: Any, found: Identification, one: StepMeasurement) -> None:
    turns = np.linspace(0.0, 1.0, 601)
    phase = 2.0 * np.pi * turns
    rod = trigonometric_value(one.rod.phasors, phase)
    slider = one.slider.velocity(phase)
    axes.plot(turns, 1e3 * rod, color=_ROD, label="rod, measured")
    axes.plot(turns, 1e3 * slider, color=_SLIDER, linewidth=2.0, label="slider, measured")
    if found.chosen:
        predicted = predict_slider(one, found.friction, found.mass, found.frequency, phase)
        label = f"slider, law: {_LAW_NAMES[found.chosen]}"
        axes.plot(turns, 1e3 * predicted, color=_MODEL, linestyle="--", linewidth=1.1, label=label)
    reach = 1e3 * float(np.abs(slider).max())
    axes.set_ylim(-2.2 * reach, 2.2 * reach)
    _label(axes, "time (periods)", "velocity (mm/s)")


# ---- figure 8: what was measured ----------------------------------------------------------------


def _time_series(
    found: Identification,
    measured: Sequence[StepResult],
    records: dict[str, ChannelRecord],
    rate: float,
) -> Any:
    figure = _new_figure((10, 6.5), f"Measured velocities at {found.frequency:g} Hz, as sampled")
    panels = figure.subplots(2, 2).ravel()
    rising = [one for one in measured if one.step.branch == RISING] or list(measured)
    steps = _closest(rising, _FIGURE_8)
    for axes, step, letter in zip(panels, steps, _LETTERS, strict=False):
        first = step.step.end - round((_PERIODS_SHOWN + 1.0) * rate / found.frequency)
        last = first + round(_PERIODS_SHOWN * rate / found.frequency)
        for name, colour in ((ROD_VELOCITY, _ROD), (SLIDER_VELOCITY, _SLIDER)):
            record = records[name]
            late = round(record.channel.delay * rate)
            time = np.arange(last - first) / rate * 1e3
            shown = 1e3 * record.samples[first + late : last + late]
            axes.plot(time, shown, color=colour, linewidth=1.1, label=name.partition("/")[0])
        axes.set_title(f"({letter}) {1e6 * _measurement(step).rod_amplitude:.2f} µm", fontsize=10)
        _label(axes, "time (ms)", "velocity (mm/s)")
    _remove_empty(panels, len(steps))
    # above the curves, which would be crossed by it
    low, high = panels[0].get_ylim()
    panels[0].set_ylim(low, high + 0.2 * (high - low))
    panels[0].legend(loc="upper right", frameon=False, fontsize=8, ncols=2)
    return figure


def _closest(steps: Sequence[StepResult], amplitudes: Sequence[float]) -> list[StepResult]:
    """Return the steps closest to some amplitudes (m), each once."""
    found: list[StepResult] = []
    for amplitude in amplitudes:
        one = min(steps, key=lambda step: abs(_measurement(step).rod_amplitude - amplitude))
        if one not in found:
            found.append(one)
    return found


# ---- figure 9: friction force over relative speed -----------------------------------------------


def _forces(found: Identification, measured: Sequence[StepResult]) -> Any:
    figure = _new_figure((9, 8), "Dynamic friction force over mean relative speed")
    force, residual = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    _draw_points(force, found, measured)
    fitted = [_measurement(one) for one in measured if one.is_fitted]
    for fit in found.fits.values():
        _draw_fit(force, residual, found, fitted, fit)
    threshold = {"color": "#888888", "linestyle": ":", "linewidth": 1.2}
    force.axvline(1e3 * found.threshold, label="threshold of the fits", **threshold)
    force.legend(loc="lower right", frameon=False, fontsize=8)
    _label(force, "", "dynamic friction force m$_S$ mean|a$_S$| (N)")
    _label(residual, "mean relative speed (mm/s)", "measured less fitted (mN)")
    residual.axhline(0.0, color="#bbbbbb", linewidth=1.0)
    if found.fits:
        reach = 6e3 * min(fit.scatter for fit in found.fits.values())
        residual.set_ylim(-reach, reach)
    return figure


def _draw_points(axes: Any, found: Identification, measured: Sequence[StepResult]) -> None:
    for regime, colour in _REGIME_COLOURS.items():
        for branch, marker, fill in ((RISING, "^", colour), ("falling", "v", "none")):
            alike = [o for o in measured if (o.regime, o.step.branch) == (regime, branch)]
            chosen = [_measurement(one) for one in alike]
            if chosen:
                axes.plot(
                    [1e3 * one.mean_relative_speed for one in chosen],
                    [found.mass * one.mean_acceleration for one in chosen],
                    marker, color=colour, markerfacecolor=fill, markersize=4.5, linestyle="none",
                    label=f"{_REGIME_NAMES[regime]}, {branch}",
                )  # fmt: skip


def _draw_fit(
    force: Any,
    residual: Any,
    found: Identification,
    fitted: Sequence[StepMeasurement],
    fit: FrictionFit,
) -> None:
    speeds = 1e3 * np.array([one.mean_relative_speed for one in fitted])
    forces = found.mass * np.array([one.mean_acceleration for one in fitted])
    order = np.argsort(speeds)
    is_chosen = fit.law == found.chosen
    colour, width = _LAW_COLOURS[fit.law], 1.8 if is_chosen else 1.0
    label = _LAW_NAMES[fit.law] + (" (chosen)" if is_chosen else "")
    curve = (forces - fit.residuals)[order]
    force.plot(speeds[order], curve, color=colour, linewidth=width, label=label)
    size = 5.0 if is_chosen else 3.0
    residual.plot(speeds, 1e3 * fit.residuals, ".", color=colour, markersize=size)
    if is_chosen:
        noise = 1e3 * found.mass * np.array([one.mean_acceleration_noise for one in fitted])
        residual.errorbar(
            speeds, 1e3 * fit.residuals, noise, fmt="none", ecolor=colour, elinewidth=0.7, alpha=0.6
        )


def _measurement(result: StepResult) -> StepMeasurement:
    assert result.measurement is not None
    return result.measurement


def _label(axes: Any, horizontal: str, vertical: str) -> None:
    axes.set_xlabel(horizontal)
    axes.set_ylabel(vertical)
    axes.grid(visible=True, alpha=0.25)

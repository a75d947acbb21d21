"""Figures 2, 3, 7, 11 and 12 of the paper, drawn from the models and from the results of runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from imotor_ros.cli.campaign_report.figures import comparison_figures
from imotor_ros.core import closed_form
from imotor_ros.core.force_potential import SpringSweep
from imotor_ros.core.friction import CoulombFriction
from imotor_ros.core.signals import (
    HarmonicMotion,
    ideal_parabolic_sawtooth,
    parabolic_sawtooth,
    sine,
)
from imotor_ros.core.slider import SliderParameters

DPI = 100

_ROD, _SLIDER, _IDEAL = "#8a8f98", "#0b62a4", "#b5541c"
_TONES = ("#0b62a4", "#b5541c", "#2c7d4f", "#7a4aa0", "#8a6d00")
_LINES = ("-", "--", ":", "-.")
_SETTLED = 60
"""Periods after which a sine has the slider in its settled state."""


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure; sizes in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Any, path: Path) -> None:
    """Write a figure as a small picture."""
    figure.savefig(path, dpi=DPI)
    shrink(path)


def shrink(path: Path) -> None:
    """Write a picture again with few colours."""
    from PIL import Image

    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(64)
    small.save(path, optimize=True)


def draw_ideal_motion(path: Path) -> None:
    """Draw the parabolic sawtooth of figure 2 over two periods."""
    figure = new_figure(6.4, 3.0)
    axes = figure.subplots()
    turns = np.linspace(0.0, 2.0, 1001)
    axes.plot(turns, 1e6 * ideal_parabolic_sawtooth(turns), color=_SLIDER)
    label(axes, "time (periods)", "rod displacement (µm)")
    save(figure, path)


def draw_signals(path: Path, first: float = 1156.25, highest: float = 4625.0) -> None:
    """Draw figure 3: signals of 2, 3 and 4 harmonics with one frequency f_1, and with one f_n."""
    figure = new_figure(8.0, 5.4)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for tone, style, n in zip(_TONES, _LINES, (2, 3, 4), strict=False):
        _draw_motion(upper, parabolic_sawtooth(n, fundamental_frequency=first), n, tone, style)
        _draw_motion(lower, parabolic_sawtooth(n, maximum_frequency=highest), n, tone, style)
    upper.set_title(f"(a) the same fundamental frequency, {first:g} Hz", fontsize=10)
    lower.set_title(f"(b) the same highest frequency, {highest:g} Hz", fontsize=10)
    for axes in (upper, lower):
        label(axes, "", "displacement (µm)")
        axes.legend(loc="upper right", frameon=False, fontsize=8, ncols=3)
        axes.set_ylim(-9, 11)
    lower.set_xlabel("time (ms)")
    save(figure, path)


def _draw_motion(axes: Any, motion: HarmonicMotion, n: int, tone: str, style: str) -> None:
    time = np.linspace(0.0, 2.0 / 1156.25, 1501)
    shown = 1e6 * motion.position(time)
    axes.plot(1e3 * time, shown, style, color=tone, linewidth=1.5, label=f"n = {n}")


def draw_characteristics(
    path: Path, amplitudes: Sequence[float] = (0.6e-6, 1.2e-6, 1.8e-6, 18e-6)
) -> dict[float, float]:
    """
    Draw figure 7: slider velocity under a sine of 2 kHz by friction model 1.

    Returns
    -------
    dict
        Share of the period in which the slider sticks, by amplitude (m).

    """
    figure = new_figure(8.0, 5.4)
    shares = {}
    for axes, letter, amplitude in zip(
        figure.subplots(2, 2).ravel(), "abcd", amplitudes, strict=True
    ):
        motion = sine(amplitude, 2000.0)
        turns = np.linspace(0.0, 2.0, 2001)
        rod, slider = _settled_velocities(motion, turns)
        shares[amplitude] = float(np.mean(np.abs(rod - slider) < 1e-9 + 1e-6 * np.ptp(rod)))
        axes.plot(turns, 1e3 * rod, color=_ROD, linewidth=1.2, label="rod")
        axes.plot(turns, 1e3 * slider, color=_SLIDER, linewidth=1.8, label="slider")
        axes.set_title(f"({letter}) {1e6 * amplitude:g} µm", fontsize=10)
        label(axes, "time (periods)", "velocity (mm/s)")
        reach = 1.6 * float(np.abs(1e3 * slider).max())
        axes.set_ylim(-reach, reach)
    axes.legend(loc="upper right", frameon=False, fontsize=8)
    save(figure, path)
    return shares


def _settled_velocities(motion: HarmonicMotion, turns: Any) -> tuple[Any, Any]:
    """Return velocities of rod and slider after many periods."""
    periods = _SETTLED + 3
    table = closed_form.simulate(
        motion, SliderParameters(), CoulombFriction(), periods=periods, record=True
    )
    assert table.trajectory is not None
    time = (_SETTLED + turns) * motion.period
    return motion.velocity(time), table.trajectory.sample(time).velocity


def draw_spring_forces(sweeps: Mapping[str, SpringSweep], path: Path) -> None:
    """
    Draw figure 11: mean force over the stiffness of the load spring.

    Parameters
    ----------
    sweeps : mapping
        What to draw, by its name in the legend.
    path : Path
        File to write.

    """
    figure = new_figure(8.0, 4.0)
    axes = figure.subplots()
    for tone, (name, sweep) in zip(_TONES, sweeps.items(), strict=False):
        stiffnesses = [one.stiffness * 1e-3 for one in sweep.forces]
        forces = [one.force for one in sweep.forces]
        axes.semilogx(stiffnesses, forces, ".-", color=tone, linewidth=1.3, label=name)
        if not sweep.critical_stiffness.reason:
            critical = sweep.critical_stiffness.value * 1e-3
            axes.axvline(critical, color=tone, linestyle=":", linewidth=1.2)
    label(axes, "stiffness of the load spring (N/mm)", "mean spring force (N)")
    axes.legend(frameon=False, fontsize=8, loc="lower left")
    save(figure, path)


def draw_comparison(results: Mapping[str, Any], path: Path) -> None:
    """
    Draw figure 12: six indicators over the highest frequency, measurement and models.

    Parameters
    ----------
    results : mapping
        Content of the results file of a campaign over the grid of the paper.
    path : Path
        File to write.

    """
    figure = new_figure(10.0, 9.0)
    panels = comparison_figures(results)
    for axes, panel in zip(figure.subplots(3, 2).ravel(), panels, strict=False):
        for series in panel["series"]:
            _draw_series(axes, series)
        axes.set_xscale("log")
        axes.set_xticks(panel["ticks"], [f"{one / 1e3:g}" for one in panel["ticks"]])
        axes.minorticks_off()
        if panel.get("logValues"):
            axes.set_yscale("log")
        elif panel.get("zero"):
            axes.set_ylim(bottom=0.0)
        axes.set_title(panel["title"], fontsize=10)
        label(axes, "", panel["vertical"] if panel["vertical"] != panel["title"] else "")
        axes.margins(x=0.05)
    for axes in figure.axes[-2:]:
        axes.set_xlabel("highest frequency f_n (kHz)")
    handles = [figure.axes[0].plot([], [], **style)[0] for style in _LEGEND]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)
    save(figure, path)


_LEGEND: tuple[dict[str, Any], ...] = (
    *({"color": tone, "label": f"n = {n}"} for tone, n in zip(_TONES, (2, 3, 4), strict=False)),
    {"color": "#444444", "marker": "o", "linestyle": "none", "label": "measured"},
    {"color": "#444444", "linestyle": "--", "label": "model 1"},
    {"color": "#444444", "linestyle": "-", "label": "model 2"},
)


def _draw_series(axes: Any, series: Mapping[str, Any]) -> None:
    colour = _TONES[int(series["tone"]) - 1]
    if series["kind"] == "points":
        axes.errorbar(
            series["x"], series["y"], series["error"], fmt="o", color=colour, markersize=4.5,
            elinewidth=1.2, capsize=3,
        )  # fmt: skip
    else:
        style = "--" if series["kind"] == "dashed" else "-"
        axes.plot(series["x"], series["y"], style, color=colour, linewidth=1.2)


def label(axes: Any, horizontal: str, vertical: str) -> None:
    """Name the axes, and draw a grid."""
    axes.set_xlabel(horizontal)
    axes.set_ylabel(vertical)
    axes.grid(visible=True, alpha=0.25)
    axes.margins(x=0.02)

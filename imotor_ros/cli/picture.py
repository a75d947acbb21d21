"""One picture of a run: velocities of rod and slider over some periods, and the whole run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imotor_ros.bag.reader import RunBag
from imotor_ros.core import channel
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.indicators import FREE_RUN

_PERIODS_SHOWN = 4
_BINS = 1200
_ROD, _SLIDER, _FORCE = "#8a8f98", "#0b62a4", "#b5541c"


def draw_run(bag_path: Path, picture_path: Path) -> None:
    """
    Draw rod velocity, slider velocity and load force of a recorded run.

    Parameters
    ----------
    bag_path : Path
        Folder of the bag.
    picture_path : Path
        File to write; its ending chooses the format.

    """
    from matplotlib.figure import Figure

    with RunBag(bag_path) as bag:
        program = bag.program
        window = bag.performance.window(FREE_RUN)
        signals = {name: bag.samples(name)[0] for name in channel.MEASURED_CHANNELS}
    figure = Figure(figsize=(9, 7.5), layout="constrained")
    close, whole, force = figure.subplots(3, 1)
    _draw_periods(close, signals, program, window.start if window else program.span("hold")[0])
    _draw_velocity(whole, signals[channel.SLIDER_VELOCITY], program)
    _draw_force(force, signals[channel.LOAD_FORCE], program)
    frequency = program.fundamental_frequency
    figure.suptitle(
        f"{len(program.motion_amplitudes)} harmonics of {frequency:g} Hz   ({program.run_id})"
    )
    figure.savefig(picture_path, dpi=130)


def _draw_periods(
    axes: Any, signals: dict[str, NDArray[np.float64]], program: DriveProgram, first: int
) -> None:
    """Draw some periods from sample `first` on."""
    period = program.sample_rate / program.fundamental_frequency
    last = first + round(_PERIODS_SHOWN * period)
    time = np.arange(last - first) / program.sample_rate * 1e3
    for name, colour in ((channel.ROD_VELOCITY, _ROD), (channel.SLIDER_VELOCITY, _SLIDER)):
        axes.plot(time, signals[name][first:last], color=colour, label=name, linewidth=1.3)
    _label(axes, f"time since {first / program.sample_rate * 1e3:.1f} ms (ms)", "velocity (m/s)")
    axes.legend(loc="lower right", frameon=False)


def _draw_velocity(axes: Any, velocity: NDArray[np.float64], program: DriveProgram) -> None:
    _draw_envelope(axes, velocity, program, _SLIDER, period_mean=True)
    _label(axes, "time (ms)", "slider velocity (m/s)")


def _draw_force(axes: Any, force: NDArray[np.float64], program: DriveProgram) -> None:
    _draw_envelope(axes, force, program, _FORCE, period_mean=True)
    _label(axes, "time (ms)", "load force (N)")


def _draw_envelope(
    axes: Any,
    samples: NDArray[np.float64],
    program: DriveProgram,
    colour: str,
    *,
    period_mean: bool,
) -> None:
    """Draw the range of the samples in each short stretch, and their running mean."""
    size = max(1, len(samples) // _BINS)
    cut = samples[: len(samples) // size * size].reshape(-1, size)
    time = (np.arange(len(cut)) + 0.5) * size / program.sample_rate * 1e3
    axes.fill_between(
        time, cut.min(axis=1), cut.max(axis=1), color=colour, alpha=0.3, linewidth=0, label="range"
    )
    if period_mean:
        width = max(1, round(program.sample_rate / program.fundamental_frequency))
        kernel = np.full(width, 1.0 / width)
        mean = np.convolve(samples, kernel, mode="same")
        axes.plot(
            np.arange(len(samples))[::size] / program.sample_rate * 1e3,
            mean[::size],
            color=colour,
            linewidth=1.4,
            label="mean over a period",
        )
    axes.legend(loc="best", frameon=False)


def _label(axes: Any, horizontal: str, vertical: str) -> None:
    axes.set_xlabel(horizontal)
    axes.set_ylabel(vertical)
    axes.grid(visible=True, alpha=0.25)
    axes.margins(x=0)

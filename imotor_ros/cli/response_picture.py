"""The Bode picture of a measured frequency response, like figure 5 of the paper."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from imotor_ros.core.response import MeasuredResponse

_LINE, _LIMIT = "#0b62a4", "#b5541c"
_GOOD = 0.99
"""Coherence from which on a response counts as well measured."""


def draw_response(response: MeasuredResponse, path: Path) -> None:
    """
    Draw admittance, its phase and the coherence over frequency.

    Parameters
    ----------
    response : MeasuredResponse
        What was measured.
    path : Path
        File to write; its ending chooses the format.

    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter

    frequencies = np.array(response.frequencies) * 1e-3
    admittances, band = response.admittances, response.half_widths
    figure = Figure(figsize=(8, 7), layout="constrained")
    magnitude, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=[3, 3, 1.4])
    size = np.abs(admittances) * 1e3
    magnitude.loglog(frequencies, size, ".-", color=_LINE, markersize=4, linewidth=1.2)
    magnitude.fill_between(
        frequencies, size * np.maximum(1 - band, 1e-3), size * (1 + band), color=_LINE, alpha=0.25
    )
    magnitude.set_ylabel("velocity over voltage\n|Y| (mm/s/V)")
    angle = np.degrees(np.unwrap(np.angle(admittances)))
    phase.semilogx(frequencies, angle, ".-", color=_LINE, markersize=4, linewidth=1.2)
    half = np.degrees(band)
    phase.fill_between(frequencies, angle - half, angle + half, color=_LINE, alpha=0.25)
    phase.set_ylabel("phase of Y (degrees)")
    coherence.semilogx(
        frequencies, response.coherences, ".-", color=_LINE, markersize=4, linewidth=1.2
    )
    coherence.axhline(_GOOD, color=_LIMIT, linewidth=0.8)
    coherence.set_ylim(min(0.95, float(np.min(response.coherences))) - 0.01, 1.005)
    coherence.set_ylabel("coherence")
    coherence.set_xlabel("frequency (kHz)")
    for axes in (magnitude, phase, coherence):
        axes.grid(visible=True, which="both", alpha=0.25)
        axes.margins(x=0.01)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    coherence.xaxis.set_minor_formatter(
        FuncFormatter(lambda value, _: f"{value:g}" if f"{value:g}"[0] in "25" else "")
    )
    largest = max(response.amplitudes)
    method = response.method.replace("_", " ")
    figure.suptitle(f"Mechanical admittance of the stator, {method}, up to {largest:.3g} V")
    figure.savefig(path, dpi=130)

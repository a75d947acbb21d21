"""What is said beside the figures of the paper: what it shows, what is shown here, what differs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from imotor_ros.cli.figure_page import Entry
from imotor_ros.core.correction import Excitation
from imotor_ros.core.force_potential import Estimate, SpringSweep
from imotor_ros.core.identification.results import Identification
from imotor_ros.core.response import MeasuredResponse

_PAPER_ROWS = (
    ("wanted displacement, paper (µm, degrees)", (6.23, 2.43, 1.07, 0.37), (-153.7, 46.9, -113.9)),
    ("voltage by the linear model, paper (V, degrees)",
     (37.44, 13.98, 5.75, 2.05), (-73.1, -152.1, 126.1)),
    ("voltage after iteration, paper (V, degrees)",
     (36.87, 14.09, 5.76, 1.97), (-75.1, -150.1, 140.5)),
)  # fmt: skip
"""Table 1. The phases of the displacement are those of sines, those of the voltages of cosines."""

_FRICTION_COMMAND = (
    "./imotor figures; with 40 steps each way instead of 24: ./imotor identify-friction --bench sim"
)


def figure_2() -> Entry:
    """Return the text of figure 2."""
    return Entry(
        "Figure 2: ideal rod motion",
        "the stator movement for the highest velocity: a parabolic sawtooth, repeated.",
        "the same over two periods, with the stroke of 15 µm that all measurements have.",
        "none in the shape. The paper gives no formula here; that of the signal derived from it "
        "reproduces every digit of table 1.",
        "./imotor signal --harmonics 64 --json",
        "figure_2.png",
        "A parabola that rises from rest within a period and falls back at once, twice.",
    )


def figure_3() -> Entry:
    """Return the text of figure 3."""
    return Entry(
        "Figure 3: drive signals",
        "signals of 2, 3 and 4 harmonics from the Fourier series of figure 2 with Lanczos' sigma "
        "factors: (a) with the same fundamental frequency of 1156 Hz, (b) with the same highest "
        "frequency of 4625 Hz.",
        "the same signals, scaled to a stroke of 15 µm. The more harmonics, the steeper the flank; "
        "with one highest frequency, the longer the period.",
        "1156 Hz is taken as 4625 Hz / 4.",
        "./imotor signal --harmonics 4",
        "figure_3.png",
        "Two panels with three curves each: asymmetric waves that rise slowly and fall fast.",
    )


def figure_5(response: MeasuredResponse) -> Entry:
    """Return the text of figure 5."""
    frequencies = np.array(response.frequencies)
    size = np.abs(np.array(response.admittances))
    peak = float(frequencies[int(np.argmax(size))])
    worst = 100 * float(np.max(response.half_widths))
    return Entry(
        "Figure 5: mechanical admittance",
        "a frequency sweep of amplitude and phase of rod velocity over voltage, without slider. "
        "The text says that resonances do not impair the motor up to more than 10 kHz.",
        f"the same of the virtual stator, by stepped sines of up to "
        f"{max(response.amplitudes):.3g} V at {len(frequencies)} frequencies. The "
        f"largest magnitude is at {peak / 1e3:.3g} kHz. "
        f"The 95 % confidence is {worst:.2g} % or better, and calibration adds "
        f"{100 * response.calibration_uncertainty:.2g} % to all magnitudes together.",
        "the curve of the paper is not known; the virtual stator has two modes that fit the four "
        "amplitudes and phases of the linear row in table 1, and a hysteresis that fits the other. "
        "Between and beyond these frequencies it is an assumption.",
        "./imotor frequency-response --bench sim --lowest-frequency 500 --highest-frequency 50e3 "
        "--points 60",
        "figure_5.png",
        "Magnitude and phase of the admittance and its coherence over frequency.",
    )


def table_1(found: Excitation) -> Entry:
    """Return table 1: the paper's rows and those found here."""
    count = found.harmonics
    rows = [_row(name, sizes, phases) for name, sizes, phases in _PAPER_ROWS]
    here = (
        ("wanted displacement, here (µm, degrees)",
         [1e6 * a for a in found.motion_amplitudes], found.motion_phases, 0.0),
        ("voltage by the linear model, here (V, degrees)",
         found.linear_amplitudes, found.linear_phases, 90.0),
        ("voltage after correction, here (V, degrees)",
         found.amplitudes[:count], found.phases[:count], 90.0),
    )  # fmt: skip
    rows += [_row(name, sizes, _relative(phases, shift)) for name, sizes, phases, shift in here]
    amplitude = 100 * found.largest_amplitude_errors[-1]
    phase = math.degrees(found.largest_phase_errors[-1])
    linear = 100 * found.largest_amplitude_errors[0], math.degrees(found.largest_phase_errors[0])
    return Entry(
        "Table 1: voltages of the harmonics",
        "amplitudes and phases of one signal: wanted displacement, voltage by the linear model, "
        "voltage after iteration. One iteration usually leaves errors below 1 % and 1 degree.",
        f"the same, found on the virtual stand. By the linear model the rod motion is wrong by up "
        f"to {linear[0]:.2g} % and {linear[1]:.2g} degrees, after {found.cycles} corrections by "
        f"{amplitude:.2g} % and {phase:.2g} degrees. Phases relative to the first harmonic, those "
        "of the displacement as of sines, those of voltages as of cosines, as the paper has them.",
        "the caption in the paper says n = 2 and f_n = 9250 Hz; the four harmonics say n = 4 and "
        "f_n = 18500 Hz. The virtual stator was fitted to the rows of the paper, so that their "
        "agreement is no test of it. Further harmonics, which hysteresis makes, are brought to "
        "rest as well, and left out here.",
        "./imotor excite --harmonics 4 --max-frequency 18500 --bench sim",
        header=("", "1st", "2nd", "phase", "3rd", "phase", "4th", "phase"),
        rows=rows,
    )


def _row(name: str, sizes: Sequence[float], phases: Sequence[float]) -> list[str]:
    cells = [name, f"{sizes[0]:.2f}"]
    for size, phase in zip(sizes[1:], phases, strict=True):
        cells += [f"{size:.2f}", f"{phase:.1f}"]
    return cells


def _relative(phases: Sequence[float], shift: float) -> list[float]:
    """Return phases relative to the first harmonic (degrees); `shift` from sine to cosine."""
    first = phases[0]
    return [
        math.remainder(math.degrees(phase - k * first) + shift * (k - 1), 360.0)
        for k, phase in enumerate(phases[1:], 2)
    ]


def figure_7(shares: Mapping[float, float]) -> Entry:
    """Return the text of figure 7."""
    parts = ", ".join(f"{100 * s:.0f} % at {1e6 * a:g} µm" for a, s in shares.items())
    return Entry(
        "Figure 7: slider velocity under a sine",
        "the simulated slider velocity at a rod motion of 2000 Hz and (a) 0.6, (b) 1.2, (c) 1.8 "
        "and (d) 18 µm: sticking, sticking and sliding, and sliding all the time with a triangular "
        "velocity.",
        f"the same by friction model 1, in closed form, in the settled state. The slider sticks "
        f"for this share of the period: {parts}.",
        "none that can be seen from the text. In closed form it sticks throughout up to 0.92 µm "
        "and slides throughout from 1.72 µm on. In (d) the rod moves far beyond the axis.",
        "./imotor figures",
        "figure_7.png",
        "Four panels with the velocities of rod and slider over two periods.",
    )


def figure_8(found: Identification) -> Entry:
    """Return the text of figure 8."""
    return Entry(
        "Figure 8: measured velocities",
        "measured velocities of rod and slider at 2000 Hz and approximately 0.1, 0.8, 2.5 and "
        "8.0 µm.",
        f"the same from the run of {len(found.steps)} steps that figure 9 is made of, at the steps "
        "nearest to these amplitudes, as the virtual vibrometers sampled them, with their noise.",
        "the noise is that of data sheets, not of the instruments of the paper.",
        _FRICTION_COMMAND,
        "figure_8.png",
        "Four panels with the velocities of rod and slider over time, rising amplitude.",
    )


def figure_9(found: Identification) -> Entry:
    """Return the text of figure 9."""
    line, constant = (found.fits[law].estimates for law in ("velocity", "coulomb"))
    calibration = found.calibration.uncertainties if found.calibration else {}
    return Entry(
        "Figure 9: friction force over relative speed",
        "the dynamic friction force by the mean absolute slider acceleration, over the mean "
        "relative speed. The fits are 0.940 N + 2.213 N s/m v (8) and 1.01 N (9), from 10 mm/s on.",
        "the same from a measurement on the virtual stand, whose motor obeys (8). The line found "
        f"is {_between(line['sliding_force'])} N + {_between(line['slope'])} N s/m v, the constant "
        f"{_between(constant['sliding_force'])} N (95 % of noise and misfit in brackets). The "
        f"calibration of the heads adds {calibration.get('sliding_force', 0.0):.2g} N and "
        f"{calibration.get('slope', 0.0):.2g} N s/m (standard uncertainty).",
        "equation (6) as printed integrates the relative acceleration; its own text and its result "
        "need that of the slider, which is used here. The constant depends on which speeds are in "
        "the fit, and the paper does not list them.",
        _FRICTION_COMMAND,
        "figure_9.png",
        "Friction force over relative speed with the fitted laws, and their residuals.",
    )


def _between(estimate: Any) -> str:
    return f"{estimate.value:.3f} [{estimate.low:.3f}, {estimate.high:.3f}]"


def figure_11(sweeps: Mapping[str, SpringSweep]) -> Entry:
    """Return the text of figure 11."""
    parts = "; ".join(
        f"{name}: plateau {_with_error(sweep.plateau, 1.0)} N, critical stiffness "
        f"{_with_error(sweep.critical_stiffness, 1e-3)} N/mm"
        for name, sweep in sweeps.items()
    )
    return Entry(
        "Figure 11: spring force over stiffness",
        "the mean spring force in steady state for one example, whose drive is not named: "
        "independent of the stiffness up to a critical one of approximately 80 N/mm.",
        f"the same by the motor model for four drives; dotted the critical stiffness, at which the "
        f"force is 5 % below the plateau. {parts}.",
        "the critical stiffness depends strongly on the drive: from a few N/mm to thousands. "
        "Beyond it slider and spring resonate with the drive, and the force jumps. That of "
        "two harmonics at 2312.5 Hz with model 2 is near the paper's, which may or may not be "
        "its example.",
        "./imotor force --harmonics 2 --max-frequency 2312.5 --friction velocity --picture f.png",
        "figure_11.png",
        "Mean spring force over stiffness on a logarithmic axis: level, then falling.",
    )


def _with_error(estimate: Estimate, factor: float) -> str:
    if estimate.reason:
        return f"none ({estimate.reason})"
    return f"{factor * estimate.value:.3g} ± {factor * estimate.uncertainty:.1g}"


def figure_12(results: Mapping[str, Any]) -> Entry:
    """Return the text of figure 12."""
    found = results["identifications"][0]
    laws = found["models"]
    streams = [s for one in results["points"] for s in one["performance"]["streams"]]
    lost = sum(one["lost"] for one in streams)
    return Entry(
        "Figure 12: indicators of the motor",
        "six indicators over the highest frequency for 2, 3 and 4 harmonics, measured and by both "
        "friction models. What is concluded from them stands in the table.",
        f"the same of the virtual motor, {len(results['points'])} runs, {lost} samples lost. "
        "Measured values have their standard uncertainty; where there is none, the indicator could "
        "not be determined. The models have the friction that a run of its own identified: "
        f"{laws['model_1']['sliding_force']:.3f} N (model 1), "
        f"{laws['model_2']['sliding_force']:.3f} N + {laws['model_2']['slope']:.3f} N s/m v "
        "(model 2). What the paper concludes is tested on the results.",
        "the virtual motor obeys model 2, so that its being closer says nothing of a real motor. "
        "Where a conclusion does not hold, that is no error of measurement: model 2 itself gives "
        f"{_mean_velocity(results, 'n3_f18500'):.1f} mm/s for three harmonics at 18500 Hz and "
        f"{_mean_velocity(results, 'n2_f18500'):.1f} mm/s for two. The velocity per power rests on "
        "an assumed capacitance.",
        "./imotor run params/campaigns/paper.yaml --bench sim",
        "figure_12.png",
        "Six panels with measured points and the lines of two models, for 2, 3 and 4 harmonics.",
        header=("What the paper concludes", "here", "in numbers"),
        rows=[[one["statement"], one["verdict"], one["summary"]] for one in results["conclusions"]],
    )


def _mean_velocity(results: Mapping[str, Any], name: str) -> float:
    """Return the velocity (mm/s) that model 2 predicts for a point."""
    point = next(one for one in results["points"] if one["name"] == name)
    return 1e3 * float(point["predictions"]["model_2"]["mean_velocity"])

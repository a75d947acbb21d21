"""
Find the voltage that makes the rod move as wanted, as table 1 of the paper does.

Measures the response at the harmonics, plays the voltage of the linear model, and corrects it from
the measured rod motion. Phases are those of sines, relative to the first harmonic.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from imotor_ros.campaign.excite import request_of
from imotor_ros.campaign.point import SignalParameters
from imotor_ros.cli.motor_stand import add_stand_arguments, follow, new_folder, open_bench, plan_for
from imotor_ros.cli.output import print_json, table
from imotor_ros.core.correction import CorrectionParameters, Excitation

RESULT_NAME = "excitation.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    add, defaults = parser.add_argument, CorrectionParameters()
    add("--harmonics", type=int, required=True, metavar="N", help="number of harmonics")
    add("--max-frequency", type=float, required=True, metavar="HZ", help="of the highest harmonic")
    add("--stroke", type=float, default=15e-6, metavar="M", help="peak to peak (m), default 15e-6")
    add(
        "--suppressed", type=int, default=defaults.suppressed_harmonics, metavar="N",
        help="further harmonics that are brought to rest, default %(default)s; the paper has 0",
    )  # fmt: skip
    add_stand_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Find the voltage and print it."""
    signal = SignalParameters(
        harmonics=options.harmonics,
        maximum_frequency=options.max_frequency,
        stroke=options.stroke,
    )
    correction = CorrectionParameters(suppressed_harmonics=options.suppressed)
    folder = new_folder(options, "excitation", RESULT_NAME)
    plan = plan_for(options, "excitation", folder, signal=signal, correction=correction)
    with open_bench(options, folder) as bench:
        found = follow(bench.excite(plan, request_of(plan)))
    content = _mapping(options, found, plan.parameters.to_mapping()["drive"]["offset"])
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / RESULT_NAME
    path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if options.json:
        print_json({**content, "output": str(folder), "files": {"result": str(path)}})
    else:
        print(_text(found, path))
    return 0


def _relative(phases: Sequence[float]) -> list[float]:
    """Return phases psi_k - k psi_1 (rad) in (-pi, pi]."""
    return [
        math.remainder(phase - k * phases[0], 2.0 * math.pi) for k, phase in enumerate(phases, 1)
    ]


def _tones(amplitudes: Sequence[float], phases: Sequence[float]) -> dict[str, list[float]]:
    return {
        "amplitudes": list(amplitudes),
        "phases": _relative(phases),
        "absolute_phases": list(phases),
    }


def _mapping(options: argparse.Namespace, found: Excitation, offset: float) -> dict[str, Any]:
    count = found.harmonics
    frequencies = [k * found.fundamental_frequency for k in range(1, len(found.amplitudes) + 1)]
    extra = _tones(found.amplitudes, found.phases)
    return {
        "motor": str(options.motor or "paper"),
        "bench": options.bench,
        "seed": options.seed,
        "harmonics": count,
        "fundamental_frequency": found.fundamental_frequency,
        "max_frequency": options.max_frequency,
        "stroke": options.stroke,
        "offset": offset,
        "wanted": _tones(found.motion_amplitudes, found.motion_phases),
        "linear_model": _tones(found.linear_amplitudes, found.linear_phases),
        "corrected": _tones(found.amplitudes[:count], found.phases[:count]),
        "errors": {
            "amplitudes": list(found.amplitude_errors),
            "phases": list(found.phase_errors),
            "uncertainties": list(found.uncertainties),
        },
        "cycles": found.cycles,
        "history": [
            {"amplitude_error": amplitude, "phase_error": phase}
            for amplitude, phase in zip(
                found.largest_amplitude_errors, found.largest_phase_errors, strict=True
            )
        ],
        "suppressed": {
            "frequencies": frequencies[count:],
            **{name: values[count:] for name, values in extra.items()},
            "velocities": list(found.unwanted_velocities),
        },
        "response": {
            "frequencies": frequencies[: len(found.response_gains)],
            "gains": list(found.response_gains),
            "phases": list(found.response_phases),
        },
    }


def _text(found: Excitation, path: Path) -> str:
    count, first = found.harmonics, found.fundamental_frequency
    wanted, linear, corrected = (
        _relative(phases) for phases in (found.motion_phases, found.linear_phases, found.phases)
    )
    rows = [
        [
            f"{k + 1}", f"{(k + 1) * first:g}",
            f"{found.motion_amplitudes[k] * 1e6:.3f}", f"{math.degrees(wanted[k]):.1f}",
            f"{found.linear_amplitudes[k]:.2f}", f"{math.degrees(linear[k]):.1f}",
            f"{found.amplitudes[k]:.2f}", f"{math.degrees(corrected[k]):.1f}",
            f"{100 * found.amplitude_errors[k]:.2f}", f"{math.degrees(found.phase_errors[k]):.2f}",
        ]
        for k in range(count)
    ]  # fmt: skip
    header = [
        "harmonic", "(Hz)", "wanted (um)", "(deg)", "linear model (V)", "(deg)", "corrected (V)",
        "(deg)", "error (%)", "(deg)",
    ]  # fmt: skip
    lines = [table(rows, header)]
    for cycle, (amplitude, phase) in enumerate(
        zip(found.largest_amplitude_errors, found.largest_phase_errors, strict=True)
    ):
        what = f"after {cycle} correction{'s' if cycle > 1 else ''}" if cycle else "linear model"
        lines.append(
            f"{what}: largest errors {100 * amplitude:.2f} % and {math.degrees(phase):.2f} degrees"
        )
    if len(found.amplitudes) > count:
        lines.append(
            f"brought to rest: harmonics {count + 1} to {len(found.amplitudes)}, with "
            + ", ".join(f"{size:.2f}" for size in found.amplitudes[count:])
            + f" V; they keep {100 * max(found.unwanted_velocities):.1f} % of the largest velocity"
        )
    return "\n".join((*lines, f"result: {path}"))

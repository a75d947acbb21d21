"""
Measure the mechanical admittance of the stator, rod velocity over voltage.

Through vibrometer and voltage monitor, whose delays and low-passes are taken out. Leaves
response.json, response.png like figure 5 of the paper, and the bags of the runs.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

from imotor_ros.campaign.measurement import measure, setting_of
from imotor_ros.cli.motor_stand import add_stand_arguments, follow, new_folder, open_bench, plan_for
from imotor_ros.cli.output import print_json, table
from imotor_ros.cli.response_picture import draw_response
from imotor_ros.core.response import LEAST_COHERENCE, MeasuredResponse
from imotor_ros.core.response_measurement import ResponseParameters, measure_response

RESULT_NAME = "response.json"
PICTURE_NAME = "response.png"

_ROWS = 20
"""Rows of the printed table, at most."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    add, defaults = parser.add_argument, ResponseParameters()
    add_stand_arguments(parser)
    add(
        "--method", choices=("stepped_sine", "multisine"), default=defaults.method,
        help="signal, default %(default)s",
    )  # fmt: skip
    add(
        "--amplitude", type=float, default=defaults.amplitude, metavar="V",
        help="of the sine, peak of the multisine; by default 0.6 of what the range leaves",
    )  # fmt: skip
    add("--lowest-frequency", type=float, default=defaults.lowest_frequency, metavar="HZ",
        help="default %(default)g")  # fmt: skip
    add("--highest-frequency", type=float, default=defaults.highest_frequency, metavar="HZ",
        help="default %(default)g")  # fmt: skip
    add("--points", type=int, default=defaults.points, metavar="N",
        help="number of frequencies, default %(default)s")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Measure, write the files, print the result."""
    parameters = ResponseParameters(
        method=options.method,
        amplitude=options.amplitude,
        lowest_frequency=options.lowest_frequency,
        highest_frequency=options.highest_frequency,
        points=options.points,
    )
    folder = new_folder(options, "frequency-response", RESULT_NAME)
    plan = plan_for(options, "response", folder)
    procedure = measure_response(setting_of(plan, plan.program.run_id), parameters)
    with open_bench(options, folder) as bench:
        response = follow(measure(bench, plan, procedure))
    content = {
        "motor": str(options.motor or "paper"),
        "bench": options.bench,
        "seed": options.seed,
        "offset": plan.parameters.to_mapping()["drive"]["offset"],
        **response.to_mapping(),
    }
    files, warnings = _write(content, response, folder), _warnings(response)
    if options.json:
        print_json({**content, "output": str(folder), "files": files, "warnings": warnings})
    else:
        print(_text(response))
        print(f"\nresult: {files['result']}\npicture: {files['picture']}")
        for text in warnings:
            print(f"warning: {text}")
    return 0


def _write(content: dict[str, object], response: MeasuredResponse, folder: Path) -> dict[str, str]:
    """Write result and picture; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    result, picture = folder / RESULT_NAME, folder / PICTURE_NAME
    result.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    draw_response(response, picture)
    return {"result": str(result), "picture": str(picture), "bags": str(folder / "trials")}


def _warnings(response: MeasuredResponse) -> list[str]:
    """Return what a user must know before relying on a response."""
    low = [one for one in response.coherences if one < LEAST_COHERENCE]
    if not low:
        return []
    count = f"{len(low)} of {len(response.coherences)} frequencies"
    text = f"coherence below {LEAST_COHERENCE:g} at {count}, lowest {min(low):.4g}"
    return [f"{text}: no basis for a voltage there"]


def _text(response: MeasuredResponse) -> str:
    step = max(1, math.ceil(len(response.frequencies) / _ROWS))
    half_widths = response.half_widths
    rows = []
    for i in range(0, len(response.frequencies), step):
        admittance, gain = response.admittances[i], response.gains[i]
        rows.append(
            [
                f"{response.frequencies[i]:.1f}",
                f"{abs(admittance) * 1e3:.4g}",
                f"{100 * half_widths[i]:.2g}",
                f"{math.degrees(math.atan2(admittance.imag, admittance.real)):.2f}",
                f"{math.degrees(half_widths[i]):.2g}",
                f"{abs(gain) * 1e6:.4f}",
                f"{response.amplitudes[i]:.1f}",
                f"{response.coherences[i]:.5f}",
            ]
        )
    header = [
        "frequency (Hz)", "|Y| (mm/s/V)", "+- (%)", "phase (deg)", "+- (deg)", "|x/u| (um/V)",
        "amplitude (V)", "coherence",
    ]  # fmt: skip
    common = 100 * response.calibration_uncertainty
    return (
        f"{table(rows, header)}\n+-: 95 % confidence; calibration adds {common:.2g} % "
        "(standard uncertainty) to all magnitudes together"
    )

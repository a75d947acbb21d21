"""
Make a page with the figures 2, 3, 5, 7, 8, 9, 11, 12 and the table 1 of the paper.

Each with what the paper shows, what is shown here, which command makes it, and where it differs.
Measurements are carried out on the bench in one process. Writes figures.html, one file that needs
nothing else, the same as figures.md, and the pictures in the folder figures.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from imotor_ros.bag.identify import identify_bag
from imotor_ros.campaign.campaign import NamedPoint, load_campaign
from imotor_ros.campaign.excite import request_of
from imotor_ros.campaign.measurement import measure, setting_of
from imotor_ros.campaign.point import SignalParameters
from imotor_ros.campaign.results import RESULTS_NAME
from imotor_ros.campaign.runner import run_campaign
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.cli import figure_texts as texts
from imotor_ros.cli import paper_figures as drawn
from imotor_ros.cli.figure_page import Entry, html_page, markdown_page
from imotor_ros.cli.friction_pictures import draw_figures
from imotor_ros.cli.motor_stand import follow, plan_for
from imotor_ros.cli.output import print_json
from imotor_ros.cli.resources import find_params
from imotor_ros.cli.response_picture import draw_response
from imotor_ros.core.force_potential import sweep_springs
from imotor_ros.core.friction import CoulombFriction, FrictionLaw, VelocityDependentFriction
from imotor_ros.core.response_measurement import ResponseParameters, measure_response
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.slider import SliderParameters
from imotor_ros.errors import RecordingError

PAGE_NAME, TEXT_NAME, FOLDER = "figures.html", "figures.md", "figures"

_STEPS = 24
"""Steps each way of the identification; the verb identify-friction takes 40."""

_FREQUENCIES, _LOWEST_FREQUENCY, _HIGHEST_FREQUENCY = 60, 500.0, 50e3

_SPRINGS: tuple[tuple[int, float, type[FrictionLaw], str], ...] = (
    (2, 2312.5, VelocityDependentFriction, "model 2"),
    (2, 9250.0, VelocityDependentFriction, "model 2"),
    (4, 4625.0, CoulombFriction, "model 1"),
    (4, 2312.5, CoulombFriction, "model 1"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument(
        "--output", type=Path, default=Path("results/figures"), metavar="DIR",
        help="folder of page and pictures, default %(default)s; what is there is replaced",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Make figures and pages."""
    pictures: Path = options.output / FOLDER
    try:
        pictures.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as runs:
            entries = _make_entries(pictures, Path(runs))
        files = {
            "page": _write(options.output / PAGE_NAME, html_page(entries, pictures)),
            "text": _write(options.output / TEXT_NAME, markdown_page(entries, FOLDER)),
            "pictures": str(pictures),
        }
    except OSError as error:
        cause = error.strerror or str(error)
        raise RecordingError(f"{options.output}: cannot be written: {cause}") from error
    if options.json:
        print_json({"output": str(options.output), "files": files})
    else:
        print("\n".join(f"{kind}: {path}" for kind, path in files.items()))
    return 0


def _write(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    return str(path)


def _make_entries(pictures: Path, runs: Path) -> list[Entry]:
    makers: tuple[tuple[str, Callable[[Path, Path], list[Entry]]], ...] = (
        ("figures 2 and 3", _signals),
        ("figure 5", _response),
        ("table 1", _excitation),
        ("figures 7, 8 and 9", _friction),
        ("figure 11", _springs),
        ("figure 12", _comparison),
    )
    entries = []
    for name, make in makers:
        if sys.stderr.isatty():
            print(name, file=sys.stderr)
        entries += make(pictures, runs)
    return entries


def _options() -> Namespace:
    """Return what the verbs for a motor are given, the paper's motor on the bench in process."""
    return Namespace(
        motor=None, stand=None, offset=None, seed=1, bench="sim", output=None, namespace=""
    )


def _signals(pictures: Path, _: Path) -> list[Entry]:
    drawn.draw_ideal_motion(pictures / "figure_2.png")
    drawn.draw_signals(pictures / "figure_3.png")
    return [texts.figure_2(), texts.figure_3()]


def _response(pictures: Path, runs: Path) -> list[Entry]:
    plan = plan_for(_options(), "response", runs / "response")
    procedure = measure_response(
        setting_of(plan, plan.program.run_id),
        ResponseParameters(
            points=_FREQUENCIES,
            lowest_frequency=_LOWEST_FREQUENCY,
            highest_frequency=_HIGHEST_FREQUENCY,
        ),
    )
    with SimBench() as bench:
        response = follow(measure(bench, plan, procedure))
    draw_response(response, pictures / "figure_5.png")
    drawn.shrink(pictures / "figure_5.png")
    return [texts.figure_5(response)]


def _excitation(_: Path, runs: Path) -> list[Entry]:
    signal = SignalParameters(harmonics=4, maximum_frequency=18500.0)
    plan = plan_for(_options(), "excitation", runs / "excitation", signal=signal)
    with SimBench() as bench:
        found = follow(bench.excite(plan, request_of(plan)))
    return [texts.table_1(found)]


def _friction(pictures: Path, runs: Path) -> list[Entry]:
    shares = drawn.draw_characteristics(pictures / "figure_7.png")
    campaign = load_campaign(find_params("campaigns/friction.yaml"))
    point = campaign.points[0].parameters
    point = point.replace(drive=point.drive.replace(steps=_STEPS))
    campaign = replace(campaign, points=(NamedPoint("friction", point),))
    with SimBench() as bench:
        for _ in run_campaign(campaign, bench, runs):
            pass
    bag = runs / "friction" / "bag"
    found = identify_bag(bag)
    made = draw_figures(found, bag, runs)
    for name in ("figure_8", "figure_9"):
        picture = pictures / f"{name}.png"
        picture.write_bytes(made[name].read_bytes())
        drawn.shrink(picture)
    return [texts.figure_7(shares), texts.figure_8(found), texts.figure_9(found)]


def _springs(pictures: Path, _: Path) -> list[Entry]:
    sweeps = {}
    for n, frequency, law, name in _SPRINGS:
        motion = parabolic_sawtooth(n, maximum_frequency=frequency)
        title = f"n = {n}, f_n = {frequency:g} Hz, {name}"
        sweeps[title] = sweep_springs(motion, SliderParameters(), law())
    drawn.draw_spring_forces(sweeps, pictures / "figure_11.png")
    return [texts.figure_11(sweeps)]


def _comparison(pictures: Path, runs: Path) -> list[Entry]:
    campaign = load_campaign(find_params("campaigns/paper.yaml"))
    jobs = len(os.sched_getaffinity(0))
    folder = runs / "paper"
    with SimBench() as bench:
        for _ in run_campaign(campaign, bench, folder, jobs=jobs):
            pass
    results: dict[str, Any] = json.loads((folder / RESULTS_NAME).read_text(encoding="utf-8"))
    drawn.draw_comparison(results, pictures / "figure_12.png")
    return [texts.figure_12(results)]

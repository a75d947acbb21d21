"""The force of a motor, measured on a bench beside what the models predict."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from imotor_ros.campaign.force import (
    STIFFNESSES,
    ForcePotential,
    evaluate_results,
    force_campaign,
)
from imotor_ros.campaign.point import SignalParameters
from imotor_ros.campaign.predictions import MODELS
from imotor_ros.campaign.results import DONE
from imotor_ros.cli.motor_stand import plan_for
from imotor_ros.cli.output import format_value, print_json, table
from imotor_ros.cli.run import carry_out, output_folder
from imotor_ros.cli.tables import write_table
from imotor_ros.contracts.topics import DEFAULT_NAMESPACE
from imotor_ros.core.force_potential import (
    Estimate,
    SpringSweep,
    VelocityForceCurve,
    sweep_springs,
    velocity_force_curve,
)
from imotor_ros.errors import BadInputError

TABLE_NAME = "force.csv"
PICTURE_NAME = "force.png"

_LOADS = 6
_COLOURS = {"model_1": "#b5541c", "model_2": "#0b62a4"}


def add_measurement_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options that a measurement has beside those of the model."""
    add = parser.add_argument_group("to measure").add_argument
    add("--bench", choices=("ros", "sim"), help="measure: on the ROS graph, or in this process")
    add("--motor", type=Path, metavar="FILE", help="YAML file of the motor, by default the paper's")
    add("--stand", type=Path, metavar="FILE", help="YAML file of the instruments, ditto")
    add("--offset", type=float, metavar="V", help="voltage about which the drive swings")
    add("--seed", type=int, default=1, metavar="N", help="of the instruments, default %(default)s")
    add("--output", type=Path, metavar="DIR", help="folder for bags and results, by default new")
    add("--resume", action="store_true", help="leave out runs that DIR has results of")
    add("--namespace", default=DEFAULT_NAMESPACE, help="of the nodes, for stands side by side")


def refuse_measurement_options(options: argparse.Namespace) -> None:
    """
    Refuse options of a measurement where the model is asked alone.

    Raises
    ------
    BadInputError
        If there is one.

    """
    for name in ("motor", "stand", "offset", "output", "resume"):
        value = getattr(options, name)
        if value is not None and value is not False:
            raise BadInputError("needs --bench", where=f"--{name}")


def measure_force(
    options: argparse.Namespace, signal: SignalParameters, stiffnesses: Sequence[float] | None
) -> int:
    """Carry out the runs, print what they say; 1 if one of them failed."""
    base = plan_for(options, "force", Path(), signal=signal).parameters
    loads = _LOADS if options.points is None else options.points
    campaign = force_campaign(base, STIFFNESSES if stiffnesses is None else stiffnesses, loads)
    output = output_folder(campaign, options)
    results = carry_out(campaign, options, output)
    found = evaluate_results(campaign, results)
    stand = base.stand.motor
    models = {}
    for name, law in MODELS.items():
        springs = [one.stiffness for one in found.springs]
        models[name] = (
            sweep_springs(signal.motion, stand.slider, law, springs, pushes_only=True),
            velocity_force_curve(signal.motion, stand.slider, law, 2 * loads - 1),
        )
    write_table(_rows(found), output / TABLE_NAME)
    picture = options.picture or output / PICTURE_NAME
    draw_measured(found, models, picture)
    if options.json:
        print_json(_mapping(options, found, models, output, picture))
    else:
        _print(found, models)
        print(f"\nresults: {output}\npicture: {picture}")
    failed = [one for one in results if one.status != DONE]
    return 1 if failed else 0


Models = Mapping[str, tuple[SpringSweep, VelocityForceCurve]]


def _rows(found: ForcePotential) -> list[dict[str, str | float | None]]:
    return [
        *(
            {"load": "spring", "stiffness": one.stiffness, **_columns(one.force)}
            for one in found.springs
        ),
        *(
            {"load": "weight", "load_force": one.load_force, **_columns(one.velocity, "velocity")}
            for one in found.characteristic
        ),
        {"load": "stop", **_columns(found.stop_force)},
    ]


def _columns(one: Estimate, name: str = "force") -> dict[str, str | float | None]:
    plain = plain_estimate(one)
    return {name: plain["value"], f"{name}_uncertainty": plain["uncertainty"], "reason": one.reason}


def plain_estimate(estimate: Estimate) -> dict[str, Any]:
    """Return an estimate for JSON, which has no NaN."""
    return {key: None if one != one else one for key, one in asdict(estimate).items()}


def _mapping(
    options: argparse.Namespace, found: ForcePotential, models: Models, output: Path, picture: Path
) -> dict[str, Any]:
    return {
        "harmonics": options.harmonics,
        "max_frequency": options.max_frequency,
        "stroke": options.stroke,
        "bench": options.bench,
        "springs": [
            {"stiffness": one.stiffness, "force": plain_estimate(one.force)}
            for one in found.springs
        ],
        "plateau": plain_estimate(found.plateau),
        "critical_stiffness": plain_estimate(found.critical_stiffness),
        "characteristic": [
            {"load_force": one.load_force, "mean_velocity": plain_estimate(one.velocity)}
            for one in found.characteristic
        ],
        "stop_force": plain_estimate(found.stop_force),
        "models": {
            name: {
                "springs": [asdict(one) for one in sweep.forces],
                "plateau": plain_estimate(sweep.plateau),
                "critical_stiffness": plain_estimate(sweep.critical_stiffness),
                "characteristic": [
                    {"load_force": force, "mean_velocity": velocity}
                    for force, velocity in zip(curve.load_force, curve.mean_velocity, strict=True)
                ],
                "stall_force": plain_estimate(curve.stall_force),
            }
            for name, (sweep, curve) in models.items()
        },
        "output": str(output),
        "table": str(output / TABLE_NAME),
        "picture": str(picture),
    }


def _print(found: ForcePotential, models: Models) -> None:
    titles = [name.replace("_", " ") for name in models]
    rows = [
        [f"{one.stiffness * 1e-3:.4g}", _number(one.force),
         *(f"{sweep.forces[i].force:.4f}" for sweep, _ in models.values())]
        for i, one in enumerate(found.springs)
    ]  # fmt: skip
    rows.append(["end stop", _number(found.stop_force), *("" for _ in models)])
    print(table(rows, ["stiffness (N/mm)", "force (N)", *titles]))
    print(f"plateau: {words(found.plateau, 1.0, 'N')}")
    print(f"critical stiffness: {words(found.critical_stiffness, 1e-3, 'N/mm')}")
    for name, (sweep, _) in models.items():
        print(f"critical stiffness, {name}: {words(sweep.critical_stiffness, 1e-3, 'N/mm')}")
    rows = [
        [f"{one.load_force:.4f}", _number(one.velocity, 1e3),
         *(f"{1e3 * _at(curve, one.load_force):.2f}" for _, curve in models.values())]
        for one in found.characteristic
    ]  # fmt: skip
    print()
    print(table(rows, ["constant load (N)", "velocity (mm/s)", *titles]))
    for name, (_, curve) in models.items():
        print(f"stall force, {name}: {words(curve.stall_force, 1.0, 'N')}")


def _at(curve: VelocityForceCurve, load: float) -> float:
    import numpy as np

    return float(np.interp(load, curve.load_force, curve.mean_velocity))


def _number(one: Estimate, factor: float = 1.0) -> str:
    return "-" if one.reason else format_value(one.value * factor, one.uncertainty * factor)


def words(estimate: Estimate, factor: float, unit: str) -> str:
    """Return an estimate for people, or why there is none."""
    if estimate.reason:
        return estimate.reason
    return f"{format_value(estimate.value * factor, estimate.uncertainty * factor)} {unit}"


def draw_measured(found: ForcePotential, models: Models, path: Path) -> None:
    """
    Draw force over stiffness and velocity over load, measured and by the models.

    Raises
    ------
    BadInputError
        If there is no such format, or the file cannot be written.

    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    springs, loads = figure.subplots(1, 2)
    for name, (sweep, curve) in models.items():
        look = {"color": _COLOURS.get(name, "#555555"), "label": name.replace("_", " ")}
        springs.plot([1e-3 * f.stiffness for f in sweep.forces], [f.force for f in sweep.forces],
                     **look)  # fmt: skip
        loads.plot(curve.load_force, [1e3 * v for v in curve.mean_velocity], **look)
    measured = {"fmt": "ko", "markersize": 4, "capsize": 3, "label": "measured"}
    good = [one for one in found.springs if not one.force.reason]
    springs.errorbar([1e-3 * one.stiffness for one in good], [one.force.value for one in good],
                     [one.force.uncertainty for one in good], **measured)  # fmt: skip
    moving = [one for one in found.characteristic if not one.velocity.reason]
    loads.errorbar([one.load_force for one in moving], [1e3 * one.velocity.value for one in moving],
                   [1e3 * one.velocity.uncertainty for one in moving], **measured)  # fmt: skip
    if not found.plateau.reason:
        springs.axhline(found.plateau.value, color="#8a8f98", linewidth=1, label="plateau")
    if not found.critical_stiffness.reason:
        springs.axvline(
            1e-3 * found.critical_stiffness.value, color="#8a8f98", linestyle="--",
            label="critical stiffness",
        )  # fmt: skip
    springs.set(xscale="log", xlabel="stiffness of the load spring (N/mm)",
                ylabel="mean spring force (N)")  # fmt: skip
    springs.set_ylim(0.0, 1.15 * springs.get_ylim()[1])
    loads.set(xlabel="constant load (N)", ylabel="mean velocity (mm/s)")
    for axes in (springs, loads):
        axes.grid(visible=True, alpha=0.25)
        axes.legend(frameon=False)
    try:
        figure.savefig(path, dpi=130)
    except (ValueError, OSError) as error:
        raise BadInputError(f"cannot be drawn: {error}", where=str(path)) from error

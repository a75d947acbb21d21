"""
Predict how much force a motor generates: against springs, and under constant loads.

The sweep over the stiffness of a load spring gives the plateau of the force and the critical
stiffness, at which it is 5 % lower (figure 11); constant loads from none to the stall force give
the velocity-force characteristic. Motor model without instruments, from rest, in continuous time.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from imotor_ros.cli.output import format_value, print_json, table
from imotor_ros.core.force_potential import (
    STIFFNESSES,
    Estimate,
    SpringSweep,
    VelocityForceCurve,
    sweep_springs,
    velocity_force_curve,
)
from imotor_ros.core.friction import FRICTION_LAWS, FrictionLaw
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.slider import SliderParameters
from imotor_ros.errors import BadInputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    add = parser.add_argument
    add("--harmonics", type=int, required=True, metavar="N", help="number of harmonics")
    add("--max-frequency", type=float, required=True, metavar="HZ", help="of the highest harmonic")
    add("--friction", choices=tuple(FRICTION_LAWS), required=True, help="friction law")
    add("--stroke", type=float, default=15e-6, metavar="M", help="peak to peak (m), default 15e-6")
    add(
        "--stiffnesses",
        metavar="K,K,...",
        help="of the load spring (N/m), by default 25 from 1e2 to 1e8",
    )
    add("--points", type=int, default=11, metavar="P", help="constant loads, default 11")
    add("--picture", type=Path, metavar="FILE", help="draw both curves; the ending is the format")


def run(options: argparse.Namespace) -> int:
    """Print sweep and characteristic."""
    stiffnesses = _stiffnesses(options.stiffnesses)
    motion = parabolic_sawtooth(
        options.harmonics, options.stroke, maximum_frequency=options.max_frequency
    )
    slider = SliderParameters()
    friction = cast("FrictionLaw", FRICTION_LAWS[options.friction]())
    sweep = sweep_springs(motion, slider, friction, stiffnesses)
    curve = velocity_force_curve(motion, slider, friction, options.points)
    if options.picture is not None:
        draw(sweep, curve, options.picture)
    if options.json:
        print_json(_mapping(options, sweep, curve))
    else:
        _print(sweep, curve)
    return 0


def _stiffnesses(text: str | None) -> tuple[float, ...]:
    if text is None:
        return STIFFNESSES
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise BadInputError(
            "is not a list of numbers", where="--stiffnesses", value=text, bound="e.g. 1e3,1e4,1e5"
        ) from error


def _mapping(
    options: argparse.Namespace, sweep: SpringSweep, curve: VelocityForceCurve
) -> dict[str, Any]:
    loads = zip(curve.load_force, curve.mean_velocity, curve.is_steady, strict=True)
    return {
        "harmonics": options.harmonics,
        "max_frequency": options.max_frequency,
        "friction": options.friction,
        "stroke": options.stroke,
        "springs": [asdict(one) for one in sweep.forces],
        "plateau": _plain(sweep.plateau),
        "critical_stiffness": _plain(sweep.critical_stiffness),
        "characteristic": [
            {"load_force": force, "mean_velocity": velocity, "is_steady": steady}
            for force, velocity, steady in loads
        ],
        "stall_force": _plain(curve.stall_force),
        "picture": None if options.picture is None else str(options.picture),
    }


def _plain(estimate: Estimate) -> dict[str, Any]:
    """Return an estimate for JSON, which has no NaN."""
    return {k: None if v != v else v for k, v in asdict(estimate).items()}


def _print(sweep: SpringSweep, curve: VelocityForceCurve) -> None:
    rows = [
        [f"{one.stiffness * 1e-3:.4g}", f"{one.force:.4f}", "" if one.is_steady else "not steady"]
        for one in sweep.forces
    ]
    print(table(rows, ["stiffness (N/mm)", "force (N)", ""]))
    print(f"plateau: {_words(sweep.plateau, 1.0, 'N')}")
    print(f"critical stiffness: {_words(sweep.critical_stiffness, 1e-3, 'N/mm')}\n")
    rows = [
        [f"{force:.4f}", f"{velocity * 1e3:.3f}"]
        for force, velocity in zip(curve.load_force, curve.mean_velocity, strict=True)
    ]
    print(table(rows, ["constant load (N)", "velocity (mm/s)"]))
    print(f"stall force: {_words(curve.stall_force, 1.0, 'N')}")


def _words(estimate: Estimate, factor: float, unit: str) -> str:
    if math.isnan(estimate.value):
        return estimate.reason
    return f"{format_value(estimate.value * factor, estimate.uncertainty * factor)} {unit}"


def draw(sweep: SpringSweep, curve: VelocityForceCurve, path: Path) -> None:
    """
    Draw force over stiffness and velocity over load.

    Parameters
    ----------
    sweep, curve
        What to draw.
    path : Path
        File to write; its ending chooses the format.

    Raises
    ------
    BadInputError
        If there is no such format, or the file cannot be written.

    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    springs, loads = figure.subplots(1, 2)
    springs.semilogx(
        [one.stiffness * 1e-3 for one in sweep.forces],
        [one.force for one in sweep.forces],
        "o-", color="#0b62a4", markersize=4,
    )  # fmt: skip
    if not sweep.plateau.reason:
        springs.axhline(sweep.plateau.value, color="#8a8f98", linewidth=1, label="plateau")
    if not sweep.critical_stiffness.reason:
        critical = sweep.critical_stiffness.value * 1e-3
        springs.axvline(critical, color="#b5541c", linestyle="--", label="critical stiffness")
    if springs.get_legend_handles_labels()[0]:
        springs.legend(frameon=False)
    springs.set(xlabel="stiffness of the load spring (N/mm)", ylabel="mean spring force (N)")
    velocities = [velocity * 1e3 for velocity in curve.mean_velocity]
    loads.plot(curve.load_force, velocities, "o-", color="#0b62a4", markersize=4)
    loads.set(xlabel="constant load (N)", ylabel="mean velocity (mm/s)")
    for axes in (springs, loads):
        axes.grid(visible=True, alpha=0.25)
    try:
        figure.savefig(path, dpi=130)
    except (ValueError, OSError) as error:
        raise BadInputError(f"cannot be drawn: {error}", where=str(path)) from error

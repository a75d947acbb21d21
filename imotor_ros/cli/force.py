"""
How much force a motor generates: against springs, under constant loads, against an end stop.

The sweep over the stiffness of a load spring gives the plateau of the force and the critical
stiffness, at which it is 5 % lower (figure 11); constant loads from none to the stall force give
the velocity-force characteristic. With --bench it is measured, by a run for each spring and load,
beside what both friction models predict; without, it is the model alone, without instruments,
from rest, in continuous time.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from imotor_ros.campaign.point import SignalParameters
from imotor_ros.cli.force_measurement import (
    add_measurement_arguments,
    measure_force,
    plain_estimate,
    refuse_measurement_options,
    words,
)
from imotor_ros.cli.friction_option import FRICTION_HELP, friction_law
from imotor_ros.cli.output import print_json, table
from imotor_ros.core.force_potential import (
    STIFFNESSES,
    SpringSweep,
    VelocityForceCurve,
    sweep_springs,
    velocity_force_curve,
)
from imotor_ros.core.slider import SliderParameters
from imotor_ros.errors import BadInputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    add = parser.add_argument
    add("--harmonics", type=int, required=True, metavar="N", help="number of harmonics")
    add("--max-frequency", type=float, required=True, metavar="HZ", help="of the highest harmonic")
    add("--friction", metavar="LAW|FILE", help=f"of the model alone; {FRICTION_HELP}")
    add("--stroke", type=float, default=15e-6, metavar="M", help="peak to peak (m), default 15e-6")
    add(
        "--stiffnesses",
        metavar="K,K,...",
        help="of the load spring (N/m), default 1e2 to 1e8, or 3e2 to 1e6 to measure",
    )
    add("--points", type=int, metavar="P", help="constant loads, default 11, or 6 to measure")
    add("--picture", type=Path, metavar="FILE", help="draw both curves; the ending is the format")
    add_measurement_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Print sweep and characteristic."""
    stiffnesses = _stiffnesses(options.stiffnesses)
    signal = SignalParameters(
        harmonics=options.harmonics, maximum_frequency=options.max_frequency, stroke=options.stroke
    )
    if options.bench is not None:
        if options.friction is not None:
            raise BadInputError("stands beside --bench", where="--friction", value=options.friction)
        return measure_force(options, signal, stiffnesses)
    refuse_measurement_options(options)
    if options.friction is None:
        raise BadInputError(
            "is missing", where="--friction", bound="a law, or --bench to measure the force"
        )
    slider = SliderParameters()
    friction = friction_law(options.friction)
    points = 11 if options.points is None else options.points
    sweep = sweep_springs(signal.motion, slider, friction, stiffnesses or STIFFNESSES)
    curve = velocity_force_curve(signal.motion, slider, friction, points)
    if options.picture is not None:
        draw(sweep, curve, options.picture)
    if options.json:
        print_json(_mapping(options, sweep, curve))
    else:
        _print(sweep, curve)
    return 0


def _stiffnesses(text: str | None) -> Sequence[float] | None:
    if text is None:
        return None
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
        "plateau": plain_estimate(sweep.plateau),
        "critical_stiffness": plain_estimate(sweep.critical_stiffness),
        "characteristic": [
            {"load_force": force, "mean_velocity": velocity, "is_steady": steady}
            for force, velocity, steady in loads
        ],
        "stall_force": plain_estimate(curve.stall_force),
        "picture": None if options.picture is None else str(options.picture),
    }


def _print(sweep: SpringSweep, curve: VelocityForceCurve) -> None:
    rows = [
        [f"{one.stiffness * 1e-3:.4g}", f"{one.force:.4f}", "" if one.is_steady else "not steady"]
        for one in sweep.forces
    ]
    print(table(rows, ["stiffness (N/mm)", "force (N)", ""]))
    print(f"plateau: {words(sweep.plateau, 1.0, 'N')}")
    print(f"critical stiffness: {words(sweep.critical_stiffness, 1e-3, 'N/mm')}\n")
    rows = [
        [f"{force:.4f}", f"{velocity * 1e3:.3f}"]
        for force, velocity in zip(curve.load_force, curve.mean_velocity, strict=True)
    ]
    print(table(rows, ["constant load (N)", "velocity (mm/s)"]))
    print(f"stall force: {words(curve.stall_force, 1.0, 'N')}")


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

"""The stand with a motor from a file, for verbs that measure the motor and not a campaign."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Generator
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from imotor_ros.campaign.bench import Bench, ExcitationAdvanced, PhaseEntered, RunEvent
from imotor_ros.campaign.campaign import NamedPoint, read_yaml
from imotor_ros.campaign.plan import RunPlan, plan_run
from imotor_ros.campaign.point import DriveParameters, PointParameters, SignalParameters
from imotor_ros.cli.resources import find_params
from imotor_ros.cli.run import make_bench
from imotor_ros.contracts.topics import DEFAULT_NAMESPACE
from imotor_ros.core.correction_parameters import CorrectionParameters
from imotor_ros.core.motor import MotorParameters
from imotor_ros.core.stand import StandParameters
from imotor_ros.errors import BadInputError

T = TypeVar("T")


def add_stand_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options that choose motor, bench and folder."""
    add = parser.add_argument
    add("--motor", type=Path, metavar="FILE", help="YAML file of the motor, by default the paper's")
    add("--stand", type=Path, metavar="FILE", help="YAML file of the instruments, ditto")
    add(
        "--offset", type=float, metavar="V",
        help="voltage about which the drive swings, by default the middle of the motor's range",
    )  # fmt: skip
    add("--seed", type=int, default=1, metavar="N", help="of the instruments, default %(default)s")
    add("--bench", choices=("ros", "sim"), default="ros", help="ROS graph, or this process")
    add("--output", type=Path, metavar="DIR", help="folder for files and logs, by default new")
    add("--namespace", default=DEFAULT_NAMESPACE, help="of the nodes, for stands side by side")


def plan_for(
    options: argparse.Namespace,
    name: str,
    directory: Path,
    *,
    signal: SignalParameters | None = None,
    correction: CorrectionParameters | None = None,
) -> RunPlan:
    """
    Return the plan of a run on the stand that the options choose.

    Raises
    ------
    BadInputError
        If a file or a number cannot be used.

    """
    path = options.motor or find_params("motors/paper.yaml")
    motor = MotorParameters.from_mapping(read_yaml(path), str(path))
    stand_path = options.stand or find_params("stands/paper.yaml")
    stand = StandParameters.from_mapping(read_yaml(stand_path), str(stand_path))
    limits = motor.drive_limits
    middle = 0.5 * (limits.lowest_voltage + limits.highest_voltage)
    offset = middle if options.offset is None else options.offset
    if not limits.lowest_voltage < offset < limits.highest_voltage:
        raise BadInputError(
            "is out of the motor's range", where="--offset", value=offset,
            bound=f"> {limits.lowest_voltage:g} and < {limits.highest_voltage:g} V",
        )  # fmt: skip
    parameters = PointParameters(
        seed=options.seed,
        report_interval=0.0,
        signal=signal or SignalParameters(),
        drive=DriveParameters(offset=offset),
        correction=correction or CorrectionParameters(),
        stand=stand.replace(motor=motor),
    )
    return plan_run(NamedPoint(name, parameters), directory)


def new_folder(options: argparse.Namespace, name: str, result: str) -> Path:
    """
    Return the folder for what a verb writes.

    Raises
    ------
    BadInputError
        If it holds a result already: nothing is overwritten.

    """
    folder: Path | None = options.output
    if folder is None:
        return Path("results") / f"{name}-{datetime.now().strftime('%Y%m%d-%H%M%S')}"
    if (folder / result).exists():
        raise BadInputError("holds a result already", where=str(folder), bound="a new folder")
    return folder


def open_bench(options: argparse.Namespace, folder: Path) -> Bench:
    """Return the bench that the options choose; to be entered."""
    return make_bench(options.bench, folder, options.namespace)


def follow(steps: Generator[RunEvent, None, T]) -> T:
    """Go through what happens, tell it on a terminal, and return the result."""
    is_terminal = sys.stderr.isatty()
    while True:
        try:
            event = next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
        if is_terminal and isinstance(event, (ExcitationAdvanced, PhaseEntered)):
            text = event.stage if isinstance(event, ExcitationAdvanced) else event.phase
            print(text, file=sys.stderr)

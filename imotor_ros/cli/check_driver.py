"""
Check that a driver does what the stand asks of one, and report it requirement by requirement.

DRIVER is an executable of imotor_ros, PACKAGE/EXECUTABLE, the path of a program, or "virtual":
the virtual motor with its instruments. It is started and ended by the check. With --running
nothing is started: the nodes of the namespace are checked. docs/driver_specification.md explains
the requirements. The motor is driven: by sines about --offset of --amplitude, and up to the ends of
--voltage-range.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import textwrap
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imotor_ros.campaign.conformance.programs import CheckParameters
from imotor_ros.campaign.conformance.record import MEASURED
from imotor_ros.campaign.conformance.report import has_passed, to_junit, to_mapping
from imotor_ros.campaign.conformance.requirements import Result, Verdict, conclude
from imotor_ros.cli.output import print_json
from imotor_ros.cli.run import check_surroundings
from imotor_ros.contracts.topics import DEFAULT_NAMESPACE
from imotor_ros.errors import BadInputError

if TYPE_CHECKING:
    from imotor_ros.nodes.driver_check import DriverCheck

_WIDTH = 100
_INDENT = " " * 9
_MARKS = {Verdict.PASS: "pass", Verdict.FAIL: "FAIL", Verdict.NOT_APPLICABLE: "n/a"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    defaults = CheckParameters()
    meanings = {name: info for name, _, info in defaults.leaves()}
    add = parser.add_argument
    add("driver", nargs="?", metavar="DRIVER", help="what to start and check")
    add("--running", action="store_true", help="check the nodes that run in the namespace already")
    add("--params", type=Path, metavar="FILE", help="ROS parameter file for the driver's nodes")
    add("--namespace", default=DEFAULT_NAMESPACE, help="of the nodes, default %(default)s")
    add(
        "--without", action="append", default=[], choices=MEASURED, metavar="CHANNEL",
        help="channel that the rig does not have, e.g. load/force",
    )  # fmt: skip
    for option, kind, unit in (
        ("sample_rate", float, "HZ"),
        ("offset", float, "V"),
        ("amplitude", float, "V"),
        ("voltage_timeout", float, "S"),
        ("alignment_tolerance", float, "S"),
    ):
        info = meanings[option]
        add(
            f"--{option.replace('_', '-')}", type=kind, metavar=unit,
            default=getattr(defaults, option), help=f"{info.meaning}, default %(default)g",
        )  # fmt: skip
    add(
        "--voltage-range", type=float, nargs=2, metavar=("LOW", "HIGH"),
        default=(defaults.lowest_voltage, defaults.highest_voltage),
        help="what the driver may put out (V), default %(default)s",
    )  # fmt: skip
    add("--once", action="store_true", help="start the driver once, which leaves shutdown out")
    add("--junit", type=Path, metavar="FILE", help="also write the report as JUnit XML")
    add("--logs", type=Path, metavar="DIR", help="keep the logs of the driver's nodes there")


def run(options: argparse.Namespace) -> int:
    """Check the driver and print the report."""
    if options.running == (options.driver is not None):
        raise BadInputError("needs either a driver or --running", where="imotor check-driver")
    if options.running and options.params is not None:
        raise BadInputError("is for a driver that is started", where="--params", value="--running")
    if options.junit is not None and not options.junit.absolute().parent.is_dir():
        raise BadInputError("no such folder", where="--junit", value=str(options.junit.parent))
    check_surroundings(options.namespace)
    parameters = CheckParameters(
        sample_rate=options.sample_rate,
        offset=options.offset,
        amplitude=options.amplitude,
        voltage_timeout=options.voltage_timeout,
        alignment_tolerance=options.alignment_tolerance,
        lowest_voltage=options.voltage_range[0],
        highest_voltage=options.voltage_range[1],
    )
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="imotor-check-") as folder:
        results = _check(options, parameters, options.logs or Path(folder))
    duration = time.monotonic() - began
    name = options.driver or f"nodes of {options.namespace}"
    if options.junit is not None:
        options.junit.write_text(to_junit(name, results, duration), encoding="utf-8")
    if options.json:
        print_json(to_mapping(name, results, duration))
    else:
        print(report(name, results, duration))
    return 0 if has_passed(results) else 1


def _check(
    options: argparse.Namespace, parameters: CheckParameters, logs: Path
) -> tuple[Result, ...]:
    from imotor_ros.nodes.driver_session import driver_check

    streams = tuple(name for name in MEASURED if name not in options.without)
    with driver_check(
        options.driver,
        parameters,
        namespace=options.namespace,
        streams=streams,
        parameter_file=options.params,
        log_directory=logs,
        lives=1 if options.once else 2,
    ) as check:
        _follow(check)
    return conclude(check.findings, check.unreached)


def _follow(check: DriverCheck) -> None:
    """Carry out the check, and tell on a terminal what is being done."""
    is_terminal = sys.stderr.isatty()
    for text in check.run():
        if is_terminal:
            print(f"\r\033[K{text} ...", end="", file=sys.stderr, flush=True)
    if is_terminal:
        print("\r\033[K", end="", file=sys.stderr, flush=True)


def report(driver: str, results: Sequence[Result], duration: float) -> str:
    """Return the report as text: a line for each requirement, its evidence below."""
    lines = [driver]
    for one in results:
        lines.append(f"{_MARKS[one.verdict]:<5}{one.requirement.id:<4}{one.requirement.title}")
        for line in one.evidence.splitlines():
            lines += textwrap.wrap(line, _WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT)
    counts = {verdict: sum(one.verdict is verdict for one in results) for verdict in Verdict}
    lines.append(
        f"{counts[Verdict.PASS]} passed, {counts[Verdict.FAIL]} failed, "
        f"{counts[Verdict.NOT_APPLICABLE]} not applicable, in {duration:.1f} s"
    )
    return "\n".join(lines)

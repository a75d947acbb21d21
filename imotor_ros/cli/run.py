"""
Carry out a campaign.

Every point leaves a bag, and results.json holds the indicators of all points beside what the
models predict; report.html shows both. With --resume, points that have a result already are left
out.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

from imotor_ros.bag.provenance import provenance
from imotor_ros.campaign.bench import Bench
from imotor_ros.campaign.campaign import Campaign, load_campaign
from imotor_ros.campaign.forecast import forecast_run
from imotor_ros.campaign.own_friction import identification_points
from imotor_ros.campaign.runner import (
    DONE,
    RESULTS_NAME,
    CampaignFinished,
    PointResult,
    run_campaign,
)
from imotor_ros.cli.campaign_report import REPORT_NAME, write_report
from imotor_ros.cli.main import main as run_verb
from imotor_ros.cli.output import performance_table, print_json, table
from imotor_ros.cli.progress import CampaignProgress
from imotor_ros.contracts.topics import DEFAULT_NAMESPACE
from imotor_ros.errors import BadInputError, ImotorError, StoppedError

_LAST_DOMAIN = 232
"""Highest ROS domain that has ports."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("campaign", type=Path, metavar="CAMPAIGN.yaml", help="what to measure")
    add_run_arguments(parser)
    parser.add_argument(
        "--dry-run", action="store_true", help="list the runs, their length and bags; run nothing"
    )


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of every verb that carries out runs."""
    parser.add_argument(
        "--bench", choices=("ros", "sim"), default="ros", help="ROS graph, or this process"
    )
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="folder for bags and results, by default new"
    )
    parser.add_argument(
        "--namespace", default=DEFAULT_NAMESPACE, help="of the nodes, for stands side by side"
    )
    parser.add_argument(
        "--resume", action="store_true", help="leave out points that DIR has results of"
    )
    parser.add_argument(
        "--jobs", type=int, metavar="N",
        help="runs at a time on the bench in one process, by default one for each core; "
        "the results are the same",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Carry out the campaign and print its results."""
    if not options.dry_run:
        _jobs(options)  # a large campaign takes time to plan
    campaign = load_campaign(options.campaign)
    if options.dry_run:
        return show_forecast(campaign, as_json=options.json)
    output = output_folder(campaign, options)
    results = carry_out(campaign, options, output)
    report(results, output, as_json=options.json)
    return 0 if all(result.status == DONE for result in results) else 1


def show_forecast(campaign: Campaign, *, as_json: bool) -> int:
    """Print what a campaign would do; 1 if a run would exceed a limit."""
    own = [run for run, _ in identification_points(campaign)]
    runs = [forecast_run(point) for point in (*own, *campaign.points)]
    total = {
        "duration": sum(one.duration for one in runs),
        "bag_size": sum(one.bag_size for one in runs),
    }
    if as_json:
        print_json({"name": campaign.name, "runs": [asdict(one) for one in runs], **total})
    else:
        rows = [
            [one.name, f"{one.duration:.3f}", str(one.samples), f"{one.lowest_voltage:.1f}",
             f"{one.highest_voltage:.1f}", f"{one.bag_size / 1e6:.1f}"]
            for one in runs
        ]  # fmt: skip
        head = ["run", "duration (s)", "samples", "lowest (V)", "highest (V)", "bag (MB)"]
        print(table(rows, head))
        print(
            f"{len(runs)} runs, {total['duration']:.3f} s of stream, "
            f"about {total['bag_size'] / 1e6:.0f} MB"
        )
        for one in runs:
            if one.problem:
                print(f"{one.name}: {one.problem}")
    return 1 if any(one.problem for one in runs) else 0


def output_folder(campaign: Campaign, options: argparse.Namespace) -> Path:
    """
    Return the folder for a campaign's bags and results.

    Raises
    ------
    BadInputError
        If it holds results and they are not to be resumed: nothing is overwritten.

    """
    if options.output is None:
        if options.resume:
            raise BadInputError("needs --output", where="--resume")
        moment = datetime.now().strftime("%Y%m%d-%H%M%S")
        return Path("results") / f"{campaign.name}-{moment}"
    output: Path = options.output
    if (output / RESULTS_NAME).exists() and not options.resume:
        raise BadInputError(
            "holds results already", where=str(output), bound="a new folder, or --resume"
        )
    for point in campaign.points if not options.resume else ():
        if (output / point.name).exists():
            raise BadInputError(
                "exists already", where=str(output / point.name), bound="a new folder, or --resume"
            )
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(
            f"cannot be made: {error.strerror}", where=str(output), bound="a folder to write in"
        ) from error
    return output


def check_surroundings(namespace: str) -> None:
    """
    Check what the middleware would only stumble over.

    Raises
    ------
    BadInputError
        If domain or namespace is none.

    """
    from rclpy.exceptions import InvalidNamespaceException
    from rclpy.validate_namespace import validate_namespace

    domain = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not domain.isdigit() or int(domain) > _LAST_DOMAIN:
        raise BadInputError(
            "is no domain", where="ROS_DOMAIN_ID", value=domain, bound=f"0 to {_LAST_DOMAIN}"
        )
    try:
        validate_namespace(namespace)
    except InvalidNamespaceException as error:
        raise BadInputError(
            "is no namespace", where="--namespace", value=namespace, bound='one like "/stand"'
        ) from error


def make_bench(kind: str, output: Path, namespace: str = DEFAULT_NAMESPACE) -> Bench:
    """Return a bench of the kind "ros", with nodes in a namespace, or "sim"."""
    if kind == "sim":
        if namespace != DEFAULT_NAMESPACE:
            raise BadInputError(
                "is for nodes: the bench in one process has none", where="--namespace",
                value=namespace, bound="--bench ros",
            )  # fmt: skip
        from imotor_ros.campaign.sim_bench import SimBench

        return SimBench()
    check_surroundings(namespace)
    from imotor_ros.nodes.ros_bench import RosBench

    return RosBench(output / "logs", namespace=namespace)


def carry_out(
    campaign: Campaign, options: argparse.Namespace, output: Path
) -> tuple[PointResult, ...]:
    """Carry out a campaign, showing progress, and return the results of its points."""
    results: tuple[PointResult, ...] = ()
    try:
        jobs, made = _jobs(options), make_bench(options.bench, output, options.namespace)
    except BadInputError:
        _remove_empty(output)
        raise
    with made as bench, CampaignProgress() as progress:
        events = run_campaign(
            campaign,
            bench,
            output,
            resume=options.resume,
            provenance=lambda: {**provenance(), "bench": bench.name},
            jobs=jobs,
        )
        try:
            for event in events:
                progress.show(event)
                if isinstance(event, CampaignFinished):
                    results = event.results
                    write_report(output)
        except (KeyboardInterrupt, StoppedError):
            events.close()
            print(
                f"stopped; go on with: --output {output} --resume",
                file=sys.stderr,
            )
            raise
        except BadInputError:
            _remove_empty(output)
            raise
    return results


def _jobs(options: argparse.Namespace) -> int:
    """Return how many runs go on at a time."""
    jobs: int | None = getattr(options, "jobs", None)
    if jobs is None:
        return len(os.sched_getaffinity(0)) if options.bench == "sim" else 1
    if jobs < 1 or (jobs > 1 and options.bench != "sim"):
        bound = ">= 1" if options.bench == "sim" else "1: there is one stand"
        raise BadInputError("is out of bounds", where="--jobs", value=jobs, bound=bound)
    return jobs


def _remove_empty(output: Path) -> None:
    """Remove the folder of a campaign that was refused, if nothing came to be in it."""
    for folder in (output / "logs", output):
        with suppress(OSError):  # it is not there, or not empty
            folder.rmdir()


def report(results: Sequence[PointResult], output: Path, *, as_json: bool) -> None:
    """Print results, as JSON or as a table for each point."""
    if as_json:
        print_json(
            {
                "output": str(output),
                "results": str(output / RESULTS_NAME),
                "report": str(output / REPORT_NAME),
                "conclusions": _conclusions(output),
                "points": [
                    {**result.to_mapping(), "bag": str(output / result.bag)} for result in results
                ],
            }
        )
        return
    for result in results:
        print(f"\n{result.name}  ({output / result.bag})")
        if result.performance is None:
            print(f"failed: {result.error}")
        else:
            print(performance_table(result.performance, result.predictions))
    if conclusions := _conclusions(output):
        print("\nWhat the paper concludes")
    for one in conclusions:
        print(f"{one['verdict']}: {one['statement']}\n    {one['summary']}")
    print(f"\nresults: {output / RESULTS_NAME}\nreport: {output / REPORT_NAME}")


def _conclusions(output: Path) -> list[dict[str, Any]]:
    """Return the conclusions in the results, which rest on points done before as well."""
    path = output / RESULTS_NAME
    if not path.exists():
        return []
    found: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["conclusions"]
    return found


def main() -> int:
    """Run the verb as an executable of its own, as `ros2 run imotor_ros run_campaign` does."""
    try:
        return run_verb(["run", *sys.argv[1:]])
    except ImotorError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1

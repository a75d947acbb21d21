"""
Predict every point of a campaign with the motor model, on all cores or on a Dask cluster.

Ideal rod motion, no instruments, no end stops; friction, spring and constant load are those of
the point. Of a sweep with thousands of points, --output keeps a table with one row per point: its
name, the parameters that differ between points, and what is predicted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from imotor_ros.campaign.campaign import NamedPoint, load_campaign
from imotor_ros.campaign.cluster import predict_on_cluster
from imotor_ros.campaign.model_sweep import PREDICTED, predict_points
from imotor_ros.cli.output import SCALES, format_value, print_json, table
from imotor_ros.cli.tables import check_table_path, write_table
from imotor_ros.core.parameters import varying_leaves
from imotor_ros.errors import BadInputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("campaign", type=Path, metavar="CAMPAIGN.yaml", help="the points")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes, by default all cores")
    parser.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="of a Dask cluster, instead of processes"
    )
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="write a table, .csv or .parquet, SI units"
    )


def run(options: argparse.Namespace) -> int:
    """Print the predictions; 1 if one could not be made."""
    if options.jobs is not None and options.scheduler is not None:
        raise BadInputError("stands beside --scheduler", where="--jobs", value=options.jobs)
    if options.output is not None:
        check_table_path(options.output)
    points = load_campaign(options.campaign).points
    rows = _with_parameters(points, list(_show_progress(_predict(points, options), len(points))))
    if options.output is not None:
        write_table(rows, options.output)
    if options.json:
        print_json({"points": rows})
    elif options.output is None:
        _print(rows)
    else:
        print(f"{len(rows)} points: {options.output}")
    for row in rows:
        if row["error"]:
            print(f"{row['name']}: {row['error']}", file=sys.stderr)
    return 1 if any(row["error"] for row in rows) else 0


def _predict(points: Sequence[NamedPoint], options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    if options.scheduler is not None:
        return predict_on_cluster(points, options.scheduler)
    return predict_points(points, options.jobs)


def _show_progress(rows: Iterator[dict[str, Any]], count: int) -> Iterator[dict[str, Any]]:
    """Hand on rows, with a bar on a terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        return rows
    return iter(track(rows, "points", total=count, console=console, transient=True))


def _with_parameters(
    points: Sequence[NamedPoint], rows: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Put the parameters that differ between points after the name of each."""
    special = varying_leaves([point.parameters for point in points])
    return [
        {"name": row["name"], **leaves, **row} for row, leaves in zip(rows, special, strict=True)
    ]


def _print(rows: Sequence[dict[str, Any]]) -> None:
    scales = [SCALES[name] for name in PREDICTED]
    header = ["point", *(f"{s.title} ({s.unit})" if s.unit else s.title for s in scales)]
    cells = [
        [row["name"], *(_scaled(row[name], SCALES[name].factor) for name in PREDICTED)]
        for row in rows
    ]
    print(table(cells, header))


def _scaled(value: float | None, factor: float) -> str:
    return "-" if value is None else format_value(value * factor)

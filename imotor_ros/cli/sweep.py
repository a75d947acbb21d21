"""
Predict every point of a campaign with the motor model, on all cores.

Ideal rod motion, no instruments, no end stops; friction, spring and constant load are those of
the point. Of a sweep with thousands of points, --output keeps a CSV file.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from imotor_ros.campaign.campaign import load_campaign
from imotor_ros.campaign.model_sweep import PREDICTED, predict_points
from imotor_ros.cli.output import SCALES, format_value, print_json, table
from imotor_ros.errors import BadInputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("campaign", type=Path, metavar="CAMPAIGN.yaml", help="the points")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes, by default all cores")
    parser.add_argument("--output", type=Path, metavar="FILE.csv", help="write a table, SI units")


def run(options: argparse.Namespace) -> int:
    """Print the predictions; 1 if one could not be made."""
    rows = list(predict_points(load_campaign(options.campaign).points, options.jobs))
    if options.output is not None:
        try:
            with options.output.open("w", encoding="utf-8", newline="") as file:
                writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
                writer.writeheader()
                writer.writerows(rows)
        except OSError as error:
            cause = error.strerror or str(error)
            raise BadInputError(f"cannot be written: {cause}", where=str(options.output)) from error
    if options.json:
        print_json({"points": rows})
    else:
        scales = [SCALES[name] for name in PREDICTED]
        header = ["point", *(f"{s.title} ({s.unit})" if s.unit else s.title for s in scales)]
        cells = [
            [row["name"], *(_scaled(row[name], SCALES[name].factor) for name in PREDICTED)]
            for row in rows
        ]
        print(table(cells, header))
        for row in rows:
            if row["error"]:
                print(f"{row['name']}: {row['error']}")
    return 1 if any(row["error"] for row in rows) else 0


def _scaled(value: float | None, factor: float) -> str:
    return "-" if value is None else format_value(value * factor)

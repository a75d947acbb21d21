"""
Write the waveforms of a recorded run in a form that PlotJuggler, Foxglove or a table takes.

With more samples than points, the smallest and the largest of every stretch are kept: no peak is
lost. Layouts for both viewers are in params/layouts.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from imotor_ros.bag.export import Excerpt, export_csv, export_mcap, scope_topic
from imotor_ros.cli.output import print_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    default = Excerpt()
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of the run's bag")
    form = parser.add_mutually_exclusive_group(required=True)
    form.add_argument("--mcap", type=Path, metavar="DIR", help="new bag with topics of scalars")
    form.add_argument("--csv", type=Path, metavar="FILE", help="new table")
    parser.add_argument(
        "--begin", type=float, default=0.0, metavar="S", help="time since the start of the run (s)"
    )
    parser.add_argument(
        "--end", type=float, default=default.end, metavar="S", help="by default the end of the run"
    )
    parser.add_argument(
        "--points", type=int, default=default.points, metavar="N",
        help="points of each channel, default %(default)s",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Export, and print what was written."""
    excerpt = Excerpt(options.begin, options.end, options.points)
    if options.mcap:
        target, traces = options.mcap, export_mcap(options.bag, options.mcap, excerpt)
    else:
        target, traces = options.csv, export_csv(options.bag, options.csv, excerpt)
    channels = [
        {"name": one.name, "unit": one.unit, "points": int(one.index.size)} for one in traces
    ]
    if options.json:
        topics = {one.name: scope_topic(one.name) for one in traces} if options.mcap else {}
        print_json({"output": str(target), "channels": channels, "topics": topics})
        return 0
    for channel in channels:
        print(f"{channel['name']}: {channel['points']} points ({channel['unit']})")
    print(target)
    return 0

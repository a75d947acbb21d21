"""Describe a recorded run: what it was, how it ended, what it holds."""

from __future__ import annotations

import argparse
from pathlib import Path

from imotor_ros.bag.describe import describe
from imotor_ros.cli.output import print_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of the run's bag")


def run(options: argparse.Namespace) -> int:
    """Print the description."""
    description = describe(options.bag)
    if options.json:
        print_json(description.to_mapping())
    else:
        print(description)
    return 0

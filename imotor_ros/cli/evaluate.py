"""Compute the indicators of a recorded run, with the code that computed them live."""

from __future__ import annotations

import argparse
from pathlib import Path

from imotor_ros.bag.evaluate import evaluate_bag
from imotor_ros.cli.output import performance_table, print_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of the run's bag")


def run(options: argparse.Namespace) -> int:
    """Print the indicators."""
    performance = evaluate_bag(options.bag)
    if options.json:
        print_json({"bag": str(options.bag), **performance.to_mapping()})
    else:
        print(performance_table(performance))
    return 0

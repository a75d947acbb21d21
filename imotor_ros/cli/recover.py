"""Mend a bag whose recorder was killed: everything up to the last whole chunk is saved."""

from __future__ import annotations

import argparse
from pathlib import Path

from imotor_ros.bag.recover import recover
from imotor_ros.cli.output import print_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of the damaged bag")
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="write the mended bag there, not in place"
    )


def run(options: argparse.Namespace) -> int:
    """Mend the bag and say what was saved."""
    report = recover(options.bag, options.output)
    if options.json:
        print_json(report.to_mapping())
    else:
        print(report)
    return 0

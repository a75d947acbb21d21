"""
Run one of the benchmarks in bench/, which measure this project beside others in one run.

Without a name it lists them. What follows the name goes to the benchmark.
"""

from __future__ import annotations

import argparse
import runpy
import sys
from pathlib import Path

import imotor_ros
from imotor_ros.cli.output import print_json
from imotor_ros.errors import BadInputError

_FOLDER = Path(imotor_ros.__file__).parent.parent / "bench"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("name", nargs="?", metavar="NAME", help="which benchmark")
    parser.add_argument(
        "rest", nargs=argparse.REMAINDER, metavar="ARGUMENT", help="for the benchmark"
    )


def run(options: argparse.Namespace) -> int:
    """Run the benchmark, or list what there is."""
    names = sorted(path.stem for path in _FOLDER.glob("*.py"))
    if options.name is None:
        if options.json:
            print_json({"benchmarks": names})
        else:
            print("\n".join(names))
        return 0
    if options.name not in names:
        raise BadInputError(
            "no such benchmark",
            where="NAME",
            value=options.name,
            bound="one of " + ", ".join(names),
        )
    sys.argv = [str(_FOLDER / f"{options.name}.py"), *options.rest]
    runpy.run_path(sys.argv[0], run_name="__main__")
    return 0

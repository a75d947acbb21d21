"""Play a recorded run through the topics to the evaluator node, and print what it says."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from imotor_ros.campaign.bench import PerformanceReported
from imotor_ros.cli.output import performance_table, print_json
from imotor_ros.core.indicators import Performance
from imotor_ros.errors import RunError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of the run's bag")


def run(options: argparse.Namespace) -> int:
    """Replay the bag and print the final indicators."""
    from imotor_ros.nodes.replay import replay

    last: Performance | None = None
    with tempfile.TemporaryDirectory(prefix="imotor-replay-") as logs:
        for event in replay(options.bag, Path(logs)):
            if isinstance(event, PerformanceReported):
                last = event.performance
    if last is None:
        raise RunError("the evaluator reported nothing")
    if options.json:
        print_json({"bag": str(options.bag), **last.to_mapping()})
    else:
        print(performance_table(last))
    return 0

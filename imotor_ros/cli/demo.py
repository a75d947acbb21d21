"""
Run the demonstration: two harmonics, 4625 Hz, on the ROS graph, against an end stop.

It leaves a bag, the results and one picture, and prints the indicators beside what the two
models of the paper predict.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from imotor_ros.campaign.campaign import load_campaign
from imotor_ros.campaign.runner import DONE
from imotor_ros.cli.picture import draw_run
from imotor_ros.cli.resources import find_params
from imotor_ros.cli.run import add_run_arguments, carry_out, output_folder, report
from imotor_ros.errors import RecordingError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    add_run_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Run the demonstration."""
    campaign = load_campaign(find_params("campaigns/demo.yaml"))
    output = output_folder(campaign, options)
    results = carry_out(campaign, options, output)
    report(results, output, as_json=options.json)
    for result in results:
        if result.status == DONE:
            picture = _draw(output / result.bag, output)
            if not options.json:
                print(f"picture: {picture}")
    return 0 if results and all(result.status == DONE for result in results) else 1


def _draw(bag: Path, output: Path) -> Path:
    path = output / "run.png"
    try:
        draw_run(bag, path)
    except OSError as error:
        cause = error.strerror or str(error)
        raise RecordingError(f"{path}: cannot be written: {cause}") from error
    return path

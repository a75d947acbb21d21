"""
Write the report of a campaign beside its results.json: report.html, and the indicators as tables.

`imotor run` does this at its end; this verb does it again, from results and bags.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from imotor_ros.cli.campaign_report import PARQUET_NAME, TABLE_NAME, write_report
from imotor_ros.cli.output import print_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of a campaign's results")


def run(options: argparse.Namespace) -> int:
    """Write the report and say where it is."""
    report = write_report(options.folder)
    table, parquet = (options.folder / name for name in (TABLE_NAME, PARQUET_NAME))
    if options.json:
        print_json({"report": str(report), "table": str(table), "parquet": str(parquet)})
    else:
        print(f"report: {report}\ntable: {table}\nparquet: {parquet}")
    return 0

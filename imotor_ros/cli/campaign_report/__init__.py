"""The report of a campaign: one HTML file that needs nothing else, and tables for programs."""

from __future__ import annotations

from pathlib import Path

from imotor_ros.cli.campaign_report.content import collect
from imotor_ros.cli.campaign_report.page import html_page
from imotor_ros.cli.campaign_report.table import indicator_rows
from imotor_ros.cli.tables import write_table

REPORT_NAME = "report.html"
TABLE_NAME = "indicators.csv"
PARQUET_NAME = "indicators.parquet"


def write_report(output: Path) -> Path:
    """
    Write report and tables of a campaign beside its results.

    Parameters
    ----------
    output : Path
        Folder of the campaign, with results.json and the bags.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    UnreadableFileError
        If the results are missing or cannot be read. A bag that cannot be read is noted in the
        report instead.

    """
    content = collect(output)
    rows = indicator_rows(content.results)
    for name in (TABLE_NAME, PARQUET_NAME):
        write_table(rows, output / name)
    path = output / REPORT_NAME
    path.write_text(html_page(content), encoding="utf-8")
    return path

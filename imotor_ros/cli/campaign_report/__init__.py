"""The report of a campaign: one HTML file that needs nothing else, and a table as CSV."""

from __future__ import annotations

from pathlib import Path

from imotor_ros.cli.campaign_report.content import collect
from imotor_ros.cli.campaign_report.page import html_page
from imotor_ros.cli.campaign_report.table import indicator_rows, write_csv

REPORT_NAME = "report.html"
TABLE_NAME = "indicators.csv"


def write_report(output: Path) -> Path:
    """
    Write report and table of a campaign beside its results.

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
    write_csv(indicator_rows(content.results), output / TABLE_NAME)
    path = output / REPORT_NAME
    path.write_text(html_page(content), encoding="utf-8")
    return path

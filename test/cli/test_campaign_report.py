"""The report of a campaign: complete, self-contained, and drawn by a browser where there is one."""

import csv
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest

from imotor_ros.campaign.campaign import campaign_from_mapping
from imotor_ros.campaign.runner import run_campaign
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.cli.campaign_report import REPORT_NAME, TABLE_NAME, write_report
from imotor_ros.cli.main import main

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of two short runs, the first of which has lost its bag."""
    folder = tmp_path_factory.mktemp("report")
    campaign = campaign_from_mapping(
        {
            "name": "two <points>",
            "point": {"drive.hold_time": 0.02, "report_interval": 0.0},
            "sweep": {"signal.harmonics": [2, 3]},
        }
    )
    with SimBench() as bench:
        for _ in run_campaign(campaign, bench, folder):
            pass
    shutil.rmtree(folder / "harmonics-2" / "bag")
    write_report(folder)
    return folder


@pytest.fixture
def page(output: Path) -> str:
    return (output / REPORT_NAME).read_text(encoding="utf-8")


def figures_of(page: str) -> list[dict[str, object]]:
    found = re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.S)
    assert found
    figures: list[dict[str, object]] = json.loads(found[1])
    return figures


def test_page_loads_nothing(page: str) -> None:
    links: list[str] = []

    class Links(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            links.extend(value or "" for key, value in attrs if key in ("src", "href"))

    Links().feed(page)
    assert links == ["data:,"]
    assert "@import" not in page
    assert "url(h" not in page


def test_page_escapes_what_the_campaign_says(page: str) -> None:
    assert "two &lt;points&gt;" in page
    assert "two <points>" not in page


def test_page_holds_a_figure_for_each_place(page: str) -> None:
    figures = figures_of(page)
    places = [int(one) for one in re.findall(r'data-figure="(\d+)"', page)]
    assert places == list(range(len(figures)))
    titles = [one["title"] for one in figures]
    for title in ("steady-state velocity", "voltage", "current", "load force"):
        assert title in titles


def test_run_without_bag_says_so_and_the_other_is_shown(page: str) -> None:
    assert page.count("no waveforms: ") == 1
    assert sum("rod (grey)" in str(one["title"]) for one in figures_of(page)) == 1


def test_table_holds_every_indicator_to_the_last_digit(output: Path) -> None:
    with (output / TABLE_NAME).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    results = json.loads((output / "results.json").read_text(encoding="utf-8"))
    assert len(rows) == 12
    for row, one in zip(rows[6:], results["points"][1]["performance"]["indicators"], strict=True):
        assert (row["point"], row["indicator"]) == ("harmonics-3", one["name"])
        assert (float(row["value"]) if row["value"] else None) == one["value"]
        assert bool(row["value"]) != bool(row["reason"])


def test_verb_refuses_a_folder_without_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(tmp_path)]) == 2
    assert "results.json" in capsys.readouterr().err


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
@pytest.mark.parametrize("width", [390, 1280])
def test_browser_draws_every_visible_plot(output: Path, width: int) -> None:
    done = subprocess.run(
        [
            str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom",
            f"--window-size={width},900",
            (output / REPORT_NAME).as_uri(),
        ],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    dom = done.stdout
    assert dom.count("<svg") >= 4
    assert 'class="line' in dom
    assert "NaN" not in dom

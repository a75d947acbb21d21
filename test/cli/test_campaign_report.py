"""The report of a campaign: complete, self-contained, and drawn by a browser where there is one."""

import csv
import json
import re
import shutil
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

from imotor_ros.campaign.campaign import campaign_from_mapping
from imotor_ros.campaign.runner import run_campaign
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.cli.campaign_report import (
    PARQUET_NAME,
    REPORT_NAME,
    TABLE_NAME,
    write_report,
)
from imotor_ros.cli.main import main

sys.path.insert(0, str(Path(__file__).parent))
from browser import CHROMIUM, Browser

with_browser = pytest.mark.skipif(
    CHROMIUM is None,
    reason="needs Chromium, e.g. the Debian package chromium, which .ci/run installs",
)


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


def test_run_of_stepped_sine_has_no_empty_comparison(tmp_path: Path) -> None:
    """Nor whose friction models have that predict nothing, nor the error of a search."""
    campaign = campaign_from_mapping(
        {
            "name": "steps",
            "point": {
                "report_interval": 0.0,
                "drive": {"kind": "stepped_sine", "frequency": 2000.0, "steps": 2},
            },
        }
    )
    with SimBench() as bench:
        for _ in run_campaign(campaign, bench, tmp_path):
            pass
    write_report(tmp_path)
    page = (tmp_path / REPORT_NAME).read_text(encoding="utf-8")
    assert "no waveforms: the run has no steady drive; see identify-friction BAG" in page
    assert "no such segment" not in page
    assert "Measurement beside the models" not in page
    assert 'class="legend"' not in page
    assert "Friction of the models" not in page
    assert "completed" in page


def test_page_names_the_friction_of_models_that_predict(page: str) -> None:
    assert "Measurement beside the models" in page
    assert 'class="legend"' in page
    assert "The models have the friction that the paper identified." in page


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


def test_parquet_holds_the_same_table(output: Path) -> None:
    content = (output / PARQUET_NAME).read_bytes()
    assert (content[:4], content[-4:]) == (b"PAR1", b"PAR1")
    with (output / TABLE_NAME).open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            assert row["indicator"].encode() in content
            assert row["reason"].encode() in content


# ---- in a browser --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def desktop(output: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("desktop"), 1280, 900) as browser:
        browser.open(output / REPORT_NAME)
        yield browser
        assert browser.errors == []


@pytest.fixture(scope="module")
def phone(output: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("phone"), 390, 844, is_phone=True) as browser:
        browser.open(output / REPORT_NAME)
        yield browser
        assert browser.errors == []


SHOWN = "plots[0].shown || plots[0].whole"


def place_of_plot(browser: Browser) -> tuple[float, float, float]:
    """Bring the first plot into view, unzoomed; return left, width and middle height in pixels."""
    box = browser.run(
        "(plots[0].show(null), plots[0].host.scrollIntoView({block: 'center'}), "
        "document.activeElement.blur(), plots[0].host.getBoundingClientRect().toJSON())"
    )
    browser.settle()
    return box["left"], box["width"], box["top"] + box["height"] / 2


def test_scripts_of_the_tests_name_what_the_page_has(page: str) -> None:
    assert "const plots = " in page


@with_browser
def test_every_plot_in_view_is_drawn(desktop: Browser) -> None:
    count = desktop.run(
        "[...document.querySelectorAll('[data-figure]')].filter((one) => one.clientWidth).length"
    )
    assert count >= 4
    assert desktop.run("document.querySelectorAll('[data-figure] > svg').length") == count
    assert "NaN" not in desktop.run("document.body.innerHTML")


@with_browser
def test_drag_zooms_in_and_double_click_out(desktop: Browser) -> None:
    left, width, middle = place_of_plot(desktop)
    low, high = desktop.run(SHOWN)
    desktop.drag((left + 0.4 * width, middle), (left + 0.7 * width, middle))
    near, far = desktop.run(SHOWN)
    assert low < near < far < high
    assert (far - near) / (high - low) < 0.5
    assert not desktop.run("plots[0].button.hidden")
    desktop.run("plots[0].button.click()")
    assert desktop.run(SHOWN) == [low, high]


@with_browser
def test_wheel_zooms_a_plot_that_was_clicked_and_moves_the_page_else(desktop: Browser) -> None:
    left, width, middle = place_of_plot(desktop)
    at = (left + 0.5 * width, middle)
    whole = desktop.run(SHOWN)
    desktop.mouse("mouseWheel", *at, deltaX=0, deltaY=-100)
    desktop.settle()
    assert desktop.run(SHOWN) == whole, "a wheel that passes over it is for the page"
    left, width, middle = place_of_plot(desktop)
    desktop.run("plots[0].host.focus()")
    desktop.mouse("mouseWheel", left + 0.5 * width, middle, deltaX=0, deltaY=-100)
    desktop.settle()
    near, far = desktop.run(SHOWN)
    assert whole[0] < near < far < whole[1]
    desktop.call("Input.dispatchKeyEvent", type="keyDown", key="0", text="0")
    assert desktop.run(SHOWN) == whole


@with_browser
def test_pinch_keeps_what_is_under_the_fingers(phone: Browser) -> None:
    left, width, middle = place_of_plot(phone)
    low, high = phone.run(SHOWN)
    first, second = left + 0.4 * width, left + 0.6 * width
    places = [phone.run(f"plots[0].back({x - left})") for x in (first, second)]
    phone.touch("touchStart", (first, middle), (second, middle))
    phone.touch("touchMove", (first - 30, middle), (second + 30, middle))
    phone.touch("touchEnd")
    phone.settle()
    near, far = phone.run(SHOWN)
    assert low < near < far < high
    for x, place in zip((first - 30, second + 30), places, strict=True):
        # a pixel of a plot of three hundred
        assert phone.run(f"plots[0].back({x - left})") == pytest.approx(
            place, abs=(high - low) / 300
        )


@with_browser
def test_phone_scrolls_only_downwards(phone: Browser) -> None:
    assert phone.run("document.documentElement.scrollWidth") == 390
    assert phone.run("getComputedStyle(document.querySelector('.scroll')).overflowX") == "auto"


@with_browser
def test_prints_all_runs(desktop: Browser, tmp_path: Path) -> None:
    desktop.paper(tmp_path / "report.pdf")
    content = (tmp_path / "report.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert content.count(b"/Type /Page\n") + content.count(b"/Type/Page/") >= 2
    assert desktop.run("[...document.querySelectorAll('details.point')].every((d) => d.open)")

"""The page of the paper's figures: the committed one is complete, quick parts are made."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.cli import figures
from imotor_ros.cli.figure_page import Entry, html_page, markdown_page
from imotor_ros.cli.figures import PAGE_NAME, TEXT_NAME

DOCS = Path(__file__).parents[2] / "docs"
NAMES = [f"Figure {number}" for number in (2, 3, 5, 7, 8, 9, 11, 12)] + ["Table 1"]

MOST_BYTES = 150_000


def test_committed_page_has_every_figure_and_says_what_differs() -> None:
    text = (DOCS / TEXT_NAME).read_text(encoding="utf-8")
    titles = re.findall(r"^## (.*?):", text, re.MULTILINE)
    assert sorted(titles) == sorted(NAMES)
    for section in text.split("\n## ")[1:]:
        assert "**The paper:**" in section, section
        assert "**Here:**" in section, section
        assert "**Differences:**" in section, section
        assert "\n    ./imotor " in section, section
    pictures = re.findall(r"!\[(.+?)\]\((.+?)\)", text)
    assert len(pictures) == 8
    for _, path in pictures:
        assert 1000 < (DOCS / path).stat().st_size < MOST_BYTES


def test_page_needs_nothing_else_and_escapes(tmp_path: Path) -> None:
    (tmp_path / "p.png").write_bytes(b"\x89PNG")
    entry = Entry(
        "Figure 1: a < b", "x & y", "here", "", "./imotor demo", "p.png", 'a "wave"', ("a",),
        (("<1>",),),
    )  # fmt: skip
    page = html_page([entry], tmp_path)
    assert "a &lt; b" in page
    assert "<td>&lt;1&gt;</td>" in page
    assert 'alt="a &quot;wave&quot;"' in page
    assert re.findall(r'(?:src|href)="(?!data:|#)', page) == []
    assert "Differences" not in page
    text = markdown_page([entry], "pictures")
    assert "](pictures/p.png)" in text
    assert "| <1> |" in text


def test_verb_writes_page_text_and_pictures(
    imotor: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the parts that need no measurement; the others are tested with their verbs."""
    for name in ("_response", "_excitation", "_friction", "_springs", "_comparison"):
        monkeypatch.setattr(figures, name, lambda *_: [])
    answer = imotor("figures", "--output", tmp_path / "out", "--json")
    assert answer.code == 0
    files = answer.json["files"]
    assert Path(files["page"]) == tmp_path / "out" / PAGE_NAME
    made = {one.name for one in Path(files["pictures"]).iterdir()}
    assert made == {"figure_2.png", "figure_3.png"}
    assert "Figure 3" in Path(files["text"]).read_text(encoding="utf-8")


def test_output_that_cannot_be_written_is_one_clear_error(imotor: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    answer = imotor("figures", "--output", tmp_path / "file" / "out")
    assert answer.code == 1
    assert "cannot be written" in answer.error

"""The page of the paper's figures, as HTML that needs nothing else and as Markdown."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path

_TITLE = "The figures of the paper"
_INTRODUCTION = (
    "The figures and the table of M. Hunstig, T. Hemsel and W. Sextro, “High-Velocity Operation "
    "of Piezoelectric Inertia Motors – Experimental Validation”, made again on the virtual stand "
    "by one command: ./imotor figures. Where the paper measured, a virtual motor is measured here."
)


@dataclass(frozen=True)
class Entry:
    """
    One figure or table.

    Attributes
    ----------
    title : str
        E.g. "Figure 5: mechanical admittance".
    paper : str
        What the paper shows.
    here : str
        What is shown here.
    differs : str
        Where that differs from the paper.
    command : str
        Which command makes it by itself.
    picture : str
        Name of the picture; empty for a table.
    alternative : str
        What the picture shows, for those who do not see it.
    header, rows : sequence
        A table; empty if there is none.

    """

    title: str
    paper: str
    here: str
    differs: str
    command: str
    picture: str = ""
    alternative: str = ""
    header: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()


def html_page(entries: Sequence[Entry], pictures: Path) -> str:
    """
    Return the page as one HTML file.

    Parameters
    ----------
    entries : sequence of Entry
        What is on it.
    pictures : Path
        Folder of the pictures, which are put into the page.

    """
    style = files("imotor_ros.cli.campaign_report").joinpath("style.css").read_text("utf-8")
    body = "\n".join(_html_entry(one, pictures) for one in entries)
    links = "".join(
        f'<li><a href="#{_anchor(one)}">{escape(one.title)}</a></li>' for one in entries
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{_TITLE}</title>
<link rel="icon" href="data:,">
<style>
{style}
img {{ max-width: 100%; height: auto; background: #fff; }}
main {{ max-width: 860px; margin: 0 auto; }}
section {{ break-inside: avoid; }}
</style>
</head>
<body>
<main>
<h1>{_TITLE}</h1>
<p>{escape(_INTRODUCTION)}</p>
<ul>{links}</ul>
{body}
</main>
</body>
</html>
"""


def _html_entry(entry: Entry, pictures: Path) -> str:
    parts = [f'<section id="{_anchor(entry)}">', f"<h2>{escape(entry.title)}</h2>"]
    if entry.picture:
        data = base64.b64encode((pictures / entry.picture).read_bytes()).decode()
        text = escape(entry.alternative, quote=True)
        parts.append(f'<img src="data:image/png;base64,{data}" alt="{text}">')
    if entry.rows:
        head = "".join(f"<th>{escape(cell)}</th>" for cell in entry.header)
        rows = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
            for row in entry.rows
        )
        parts.append(f'<div class="scroll"><table><tr>{head}</tr>{rows}</table></div>')
    parts += [f"<p><b>{name}:</b> {escape(text)}</p>" for name, text in _paragraphs(entry)]
    parts += [f"<pre>{escape(entry.command)}</pre>", "</section>"]
    return "\n".join(parts)


def markdown_page(entries: Sequence[Entry], folder: str) -> str:
    """
    Return the page as Markdown.

    Parameters
    ----------
    entries : sequence of Entry
        What is on it.
    folder : str
        Folder of the pictures, relative to the page.

    """
    return "\n".join([f"# {_TITLE}", "", _INTRODUCTION, "", *_lines(entries, folder)])


def _lines(entries: Sequence[Entry], folder: str) -> list[str]:
    lines: list[str] = []
    for entry in entries:
        lines += [f"## {entry.title}", ""]
        if entry.picture:
            lines += [f"![{entry.alternative}]({folder}/{entry.picture})", ""]
        if entry.rows:
            lines += ["| " + " | ".join(entry.header) + " |", "|" + "---|" * len(entry.header)]
            lines += ["| " + " | ".join(row) + " |" for row in entry.rows]
            lines.append("")
        for name, text in _paragraphs(entry):
            lines += [f"**{name}:** {text}", ""]
        lines += [f"    {entry.command}", ""]
    return lines


def _paragraphs(entry: Entry) -> list[tuple[str, str]]:
    named = (("The paper", entry.paper), ("Here", entry.here), ("Differences", entry.differs))
    return [(name, text) for name, text in named if text]


def _anchor(entry: Entry) -> str:
    return "-".join(entry.title.partition(":")[0].lower().split())

"""The report as one HTML page that loads nothing."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any

from imotor_ros.campaign.conclusions import FAILS, HOLDS
from imotor_ros.campaign.runner import DONE
from imotor_ros.cli.campaign_report.content import ReportContent, Waveforms
from imotor_ros.cli.campaign_report.figures import (
    Figure,
    comparison_figures,
    friction_figure,
    is_grid,
    tone_of,
    waveform_figures,
)
from imotor_ros.cli.output import SCALES, format_value
from imotor_ros.core.channel import SampleFlag

Mapped = Mapping[str, Any]

_CLASSES = {HOLDS: "holds", FAILS: "fails"}
_HINT = (
    "Plots zoom: drag across a part or pinch; after a click also by wheel, + and -. A double-click "
    "shows the whole again."
)


def html_page(content: ReportContent) -> str:
    """
    Return the report of a campaign.

    Parameters
    ----------
    content : ReportContent
        Results and waveforms.

    """
    results = content.results
    figures: list[Figure] = []
    body = "\n".join(
        (
            _head(results),
            _conclusions(results.get("conclusions") or []),
            _comparison(results, figures),
            _friction(results, figures),
            _indicator_table(results),
            _points(content, figures),
            _provenance(content),
        )
    )
    assets = files("imotor_ros.cli.campaign_report")
    style = assets.joinpath("style.css").read_text(encoding="utf-8")
    script = assets.joinpath("plots.js").read_text(encoding="utf-8")
    # "</" would end the script element
    data = json.dumps(figures, allow_nan=False, separators=(",", ":")).replace("</", "<\\/")
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(results["campaign"]["name"])}</title>
<link rel="icon" href="data:,">
<style>
{style}</style>
</head>
<body>
{body}
<script type="application/json" id="figures">{data}</script>
<script>
{script}</script>
</body>
</html>
"""


def _head(results: Mapped) -> str:
    campaign, points = results["campaign"], results["points"]
    done = sum(point["status"] == DONE for point in points)
    counts = f"{done} of {len(campaign['points'])} points done on the bench “{results['bench']}”"
    streams = [s for p in points if p["performance"] for s in p["performance"]["streams"]]
    samples = f"{sum(s['received'] for s in streams):,}".replace(",", " ")
    lost = sum(s["lost"] for s in streams)
    return (
        f"<h1>{escape(campaign['name'])}</h1>\n<p>{escape(campaign['description'])}</p>\n"
        f'<p class="soft">{escape(counts)}; {samples} samples, {lost} lost. Uncertainties are '
        f'standard uncertainties. <span class="on-screen">{_HINT}</span></p>\n'
        '<noscript><p class="note">The plots need JavaScript; all values stand in the table.</p>'
        "</noscript>"
    )


def _conclusions(conclusions: Sequence[Mapped]) -> str:
    if not conclusions:
        return ""
    items = "\n".join(
        f'<li><span class="verdict {_CLASSES.get(one["verdict"], "undecided")}">'
        f"{escape(one['verdict'])}</span> {escape(one['statement'])}"
        f'<br><span class="soft">{escape(one["summary"])}</span></li>'
        for one in conclusions
    )
    return f'<h2>What the paper concludes</h2>\n<ul class="plain">\n{items}\n</ul>'


def _comparison(results: Mapped, figures: list[Figure]) -> str:
    points = results["campaign"]["points"]
    panels = "\n".join(_plots(comparison_figures(results), figures))
    if not panels:
        return ""
    numbers = sorted({p["signal"]["harmonics"] for p in points})
    keys = "".join(
        f'<span style="color: var(--tone-{tone_of(points, n)})"><i></i>n = {n}</span>'
        for n in numbers
    )
    legend = (
        f'<div class="legend">{keys}<span><i class="dot"></i>measured</span>'
        '<span><i class="dashed"></i>model 1</span><span><i class="thin"></i>model 2</span></div>'
    )
    title = "Measurement beside the models" + (", over frequency" if is_grid(points) else "")
    return f'<h2>{title}</h2>\n{legend}\n<div class="grid-of-plots">\n{panels}\n</div>'


_MODEL_LAWS = {"model_1": "model 1, constant force", "model_2": "model 2, straight line"}
_PARAMETERS = {"sliding_force": ("force", "N"), "slope": ("slope", "N s/m")}


def _friction(results: Mapped, figures: list[Figure]) -> str:
    """Return whose friction the models have."""
    found = results.get("identifications") or []
    if not found:
        if not any(point["predictions"] for point in results["points"]):
            return ""
        laws = (results.get("models") or {}).get("laws") or {}
        rows = "".join(_law_row(_MODEL_LAWS.get(k, k), law, {}) for k, law in laws.items())
        text = "The models have the friction that the paper identified."
        return _friction_table(text, rows) if laws else ""
    parts = []
    for one in found:
        if one["status"] != DONE:
            note = f"{one['name']} failed: {one['error']}; its points have no models."
            parts.append(f'<h2>Friction of the models</h2><p class="note">{escape(note)}</p>')
            continue
        laws, estimates = one["models"], one["estimates"]
        rows = "".join(
            _law_row(_MODEL_LAWS.get(k, k), law, estimates[k]) for k, law in laws.items()
        )
        text = (
            f"Identified by the run {one['run_id']}: sine of {one['frequency']:g} Hz, "
            f"{one['fitted']} of {one['steps']} steps fitted, {one['mass'] * 1e3:g} g. In brackets "
            "the 95 % interval of noise and misfit; calibration adds the standard uncertainty "
            "beside."
        )
        plots = "\n".join(_plots([friction_figure(one)], figures))
        parts.append(_friction_table(text, rows) + f'\n<div class="one-plot">\n{plots}\n</div>')
    return "\n".join(parts)


def _friction_table(text: str, rows: str) -> str:
    head = "<tr><th>law</th><th>parameter</th><th>value</th><th>calibration</th></tr>"
    return (
        f'<h2>Friction of the models</h2>\n<p class="soft">{escape(text)}</p>\n'
        f'<div class="scroll"><table>{head}{rows}</table></div>'
    )


def _law_row(title: str, law: Mapped, estimates: Mapped) -> str:
    rows = []
    for name, (word, unit) in _PARAMETERS.items():
        if name not in law:
            continue
        value, one = f"{law[name]:.4g} {unit}", estimates.get(name)
        calibration = ""
        if one:
            value = f"{one['value']:.4f} [{one['low']:.4f}, {one['high']:.4f}] {unit}"
            if one.get("calibration"):
                calibration = f"± {one['calibration']:.2g} {unit}"
        rows.append(
            f"<tr><td>{escape(title)}</td><td>{word}</td><td>{value}</td><td>{calibration}</td></tr>"
        )
    return "".join(rows)


def _plots(made: Sequence[Figure], figures: list[Figure]) -> Iterator[str]:
    """Yield the places of figures, which join those of the page."""
    for figure in made:
        figures.append(figure)
        yield (
            f"<figure><figcaption>{escape(figure['title'])}"
            '<button type="button" hidden>whole</button></figcaption>'
            f'<div data-figure="{len(figures) - 1}"></div></figure>'
        )


def _indicator_table(results: Mapped) -> str:
    header = "".join(
        f"<th>{escape(s.title)}<br><span class='soft'>{escape(s.unit) or '1'}</span></th>"
        for s in SCALES.values()
    )
    rows = "\n".join(_table_row(point) for point in results["points"])
    return (
        '<h2>Indicators</h2>\n<p class="soft">Measured value with its standard uncertainty; below '
        "it what models 1 and 2 predict. The same in SI units: "
        "indicators.csv and indicators.parquet.</p>\n"
        f'<div class="scroll"><table>\n<tr><th>point</th>{header}</tr>\n{rows}\n</table></div>'
    )


def _table_row(point: Mapped) -> str:
    if point["performance"] is None:
        text = f"failed: {escape(point['error'])}"
        row = f'<td class="words" colspan="{len(SCALES)}">{text}</td>'
    else:
        found = {one["name"]: one for one in point["performance"]["indicators"]}
        row = "".join(_cell(found.get(name, {}), name, point["predictions"]) for name in SCALES)
    return f"<tr><td>{escape(point['name'])}</td>{row}</tr>"


def _cell(one: Mapped, name: str, predictions: Mapped) -> str:
    factor = SCALES[name].factor
    value, uncertainty = (_times(one.get(key), factor) for key in ("value", "uncertainty"))
    models = " | ".join(format_value(_times(m.get(name), factor)) for m in predictions.values())
    title = f' title="{escape(one["reason"])}"' if one.get("reason") else ""
    return f"<td{title}>{format_value(value, uncertainty)}<small>{models}</small></td>"


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _points(content: ReportContent, figures: list[Figure]) -> str:
    parts = ["<h2>Runs</h2>"]
    for number, point in enumerate(content.results["points"]):
        waveforms = content.waveforms[point["name"]]
        plots = "\n".join(_plots(waveform_figures(waveforms), figures))
        parts.append(
            f'<details class="point"{" open" if number == 0 else ""}>'
            f"<summary><b>{escape(point['name'])}</b>{_state(point, waveforms)}</summary>\n"
            f"{_notes(point, waveforms)}"
            f'<div class="grid-of-plots">\n{plots}\n</div>\n{_streams(point)}</details>'
        )
    return "\n".join(parts)


def _state(point: Mapped, waveforms: Waveforms) -> str:
    state = escape(waveforms.end_state or point["status"])
    performance = point["performance"]
    lost = sum(s["lost"] for s in performance["streams"]) if performance else 0
    warnings = len(performance["warnings"]) if performance else 0
    extras = [f"{lost} samples lost"] if lost else []
    extras += [f"{warnings} warning{'s' if warnings > 1 else ''}"] if warnings else []
    return f'<span class="soft">{", ".join([state, *extras])}</span>'


def _notes(point: Mapped, waveforms: Waveforms) -> str:
    performance = point["performance"] or {"warnings": [], "indicators": []}
    notes = [f"failed: {point['error']}"] if point["error"] else []
    notes += [f"no waveforms: {waveforms.problem}"] if waveforms.problem else []
    notes += [f"warning: {text}" for text in performance["warnings"]]
    notes += [
        f"no {SCALES[one['name']].title}: {one['reason']}"
        for one in performance["indicators"]
        if one["reason"]
    ]
    return "".join(f'<p class="note">{escape(text)}</p>\n' for text in notes)


def _streams(point: Mapped) -> str:
    if not point["performance"]:
        return ""
    rows = "".join(
        f"<tr><td>{escape(s['name'])}</td><td>{s['received']}</td><td>{s['lost']}</td>"
        f"<td>{escape(_flags(s['flags']))}</td></tr>"
        for s in point["performance"]["streams"]
    )
    return (
        '<div class="scroll"><table><tr><th>stream</th><th>samples</th><th>lost</th>'
        f"<th>flags</th></tr>{rows}</table></div>\n"
    )


def _flags(flags: int) -> str:
    names = [flag.name or "" for flag in SampleFlag if flag & flags]
    return ", ".join(names).lower().replace("_", " ") or "none"


def _provenance(content: ReportContent) -> str:
    """Return what the runs were made with, once where it is the same for all, and parameters."""
    rows = []
    for one in content.results["points"]:
        found = content.waveforms[one["name"]].provenance
        revision = str(found.get("revision") or "-")[:12] + (
            " + changes" * bool(found.get("is_dirty"))
        )
        cells = (one["name"], found.get("start", "-"), revision, found.get("host", "-"))
        run = f'<td class="words">{escape(one["run_id"])}</td>'
        rows.append("<tr>" + "".join(f"<td>{escape(str(c))}</td>" for c in cells) + f"{run}</tr>")
    first = next((w.provenance for w in content.waveforms.values() if w.provenance), {})
    versions = {**first.get("versions", {}), "Python": first.get("python", "-")}
    listed = ", ".join(f"{k} {v}" for k, v in versions.items() if v)
    parameters = escape(json.dumps(content.results["campaign"]["points"], indent=1))
    return (
        f"<h2>Provenance</h2>\n<p>{escape(listed)}; {escape(str(first.get('platform', '')))}</p>\n"
        '<div class="scroll"><table><tr><th>point</th><th>start (UTC)</th><th>revision</th>'
        f'<th>host</th><th class="words">run</th></tr>\n{"".join(rows)}</table></div>\n'
        '<details class="on-screen"><summary>All parameters of all points (SI units)</summary>'
        f"<pre>{parameters}</pre></details>"
    )

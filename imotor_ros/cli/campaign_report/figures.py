"""The figures of a report, as plain JSON for plots.js."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from imotor_ros.cli.campaign_report.content import OVER_RUN, Waveforms, rounded
from imotor_ros.cli.output import SCALES

Figure = dict[str, Any]

MODELS = (("model_1", "model 1", "dashed"), ("model_2", "model 2", ""))
"""Predictions shown beside the measurement: key, name, kind of line."""

_LOGARITHMIC = ("ripple",)

_TONES = 5
_RUN_TONES = ("1", "2", "3", "4")


def is_grid(points: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether no two points share number of harmonics and highest frequency."""
    keys = [(p["signal"]["harmonics"], p["signal"]["maximum_frequency"]) for p in points]
    return len(set(keys)) == len(keys)


def tone_of(points: Sequence[Mapping[str, Any]], harmonics: int) -> str:
    """Return the colour of a number of harmonics."""
    known = sorted({p["signal"]["harmonics"] for p in points})
    return str(known.index(harmonics) % _TONES + 1)


def comparison_figures(results: Mapping[str, Any]) -> list[Figure]:
    """
    Return the panels of figure 12: each indicator over the highest frequency, for each n.

    Where points share number of harmonics and frequency, they are shown in their order instead.
    """
    points = results["campaign"]["points"]
    found = {one["name"]: one for one in results["points"]}
    return [figure for name in SCALES if (figure := _panel(name, points, found))["series"]]


def _panel(
    name: str, points: Sequence[Mapping[str, Any]], found: Mapping[str, Mapping[str, Any]]
) -> Figure:
    scale, grid = SCALES[name], is_grid(points)
    series: list[dict[str, Any]] = []
    for harmonics in sorted({p["signal"]["harmonics"] for p in points}):
        chosen = [
            (p["signal"]["maximum_frequency"] if grid else number, found[p["name"]])
            for number, p in enumerate(points, 1)
            if p["signal"]["harmonics"] == harmonics and p["name"] in found
        ]
        chosen.sort(key=lambda pair: pair[0])
        tone = tone_of(points, harmonics)
        for model, title, kind in MODELS:
            line = _series(
                f"n = {harmonics}, {title}",
                tone,
                [(x, (one["predictions"].get(model) or {}).get(name)) for x, one in chosen],
                scale.factor,
            )
            if line["x"]:
                series.append({**line, "kind": kind})
        measured = [(x, one) for x, p in chosen if (one := _indicator(p, name)) is not None]
        if measured:
            values = [(x, one["value"]) for x, one in measured]
            errors = rounded([one["uncertainty"] * scale.factor for _, one in measured])
            line = _series(f"n = {harmonics}, measured", tone, values, scale.factor)
            series.append({**line, "kind": "points", "error": errors})
    frequencies = sorted({p["signal"]["maximum_frequency"] for p in points})
    return {
        "title": scale.title,
        "horizontal": "highest frequency f_n (Hz)" if grid else "point",
        "vertical": scale.unit or scale.title,
        "log": grid,
        "logValues": name in _LOGARITHMIC,
        "ticks": frequencies if grid else list(range(1, len(points) + 1)),
        "points": True,
        "zero": name not in _LOGARITHMIC,
        "series": series,
    }


def _indicator(point: Mapping[str, Any], name: str) -> Mapping[str, Any] | None:
    performance = point["performance"] or {"indicators": []}
    for one in performance["indicators"]:
        if one["name"] == name and one["value"] is not None:
            return dict(one)
    return None


def _series(
    name: str, tone: str, values: Sequence[tuple[float, float | None]], factor: float
) -> dict[str, Any]:
    known = [(x, y * factor) for x, y in values if y is not None]
    return {
        "name": name,
        "tone": tone,
        "x": [x for x, _ in known],
        "y": rounded([y for _, y in known]),
    }


def friction_figure(identification: Mapping[str, Any]) -> Figure:
    """Return the figure of an identification run: force over relative speed, and both laws."""
    curve, models = identification["curve"], identification["models"]
    series: list[dict[str, Any]] = []
    for wanted, name, tone in ((False, "not fitted", "grey"), (True, "fitted", "1")):
        rows = zip(curve["speed"], curve["force"], curve["is_fitted"], strict=True)
        chosen = [(1e3 * speed, force) for speed, force, fitted in rows if fitted is wanted]
        line = _series(name, tone, chosen, 1.0)
        series.append({**line, "kind": "points", "error": [0.0] * len(chosen)})
    speeds = [0.0, max(curve["speed"])]
    for (model, title, kind), tone in zip(MODELS, ("2", "3"), strict=True):
        law = models[model]
        forces = [law["sliding_force"] + law.get("slope", 0.0) * speed for speed in speeds]
        values = list(zip([1e3 * one for one in speeds], forces, strict=True))
        series.append({**_series(title, tone, values, 1.0), "kind": kind})
    return {
        "title": "dynamic friction force: fitted steps (blue), model 1 (dashed), model 2",
        "horizontal": "mean relative speed (mm/s)",
        "vertical": "N",
        "points": True,
        "series": series,
    }


def waveform_figures(waveforms: Waveforms) -> list[Figure]:
    """Return the figures of one run: some periods, and what was measured over the whole run."""
    periods = waveforms.periods
    if not periods:
        return []
    lines = [
        {"name": key, "tone": tone, "x": periods["time"], "y": periods[key]}
        for key, tone in (("rod", "grey"), ("slider", "1"))
        if key in periods
    ]
    start = f"time since {periods['start']:.4g} ms (ms)"
    title = "velocity of rod (grey) and slider over some periods"
    figures = [_figure(title, start, "m/s", lines)]
    for (name, title, unit), tone in zip(OVER_RUN, _RUN_TONES, strict=True):
        if name in waveforms.run:
            shown = waveforms.run[name]
            band = {"name": name, "tone": tone, "x": shown["time"], "y": shown["mean"]}
            band |= {"low": shown["low"], "high": shown["high"]}
            figures.append(_figure(title, "time (ms)", unit, [band]))
    return figures


def _figure(
    title: str, horizontal: str, vertical: str, series: Sequence[Mapping[str, Any]]
) -> Figure:
    return {
        "title": title,
        "horizontal": horizontal,
        "vertical": vertical,
        "series": list(series),
    }

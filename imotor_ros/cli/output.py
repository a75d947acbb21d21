"""What verbs print: JSON for programs, tables with scaled units for people."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imotor_ros.core.indicators import Indicator, Performance


def print_json(content: Mapping[str, Any]) -> None:
    """Print one JSON object, and nothing else, on standard output."""
    json.dump(content, sys.stdout, allow_nan=False)
    sys.stdout.write("\n")


@dataclass(frozen=True)
class Scale:
    """How people read an indicator: its name, a factor from SI, and the unit after it."""

    title: str
    factor: float
    unit: str


SCALES = {
    "mean_velocity": Scale("steady-state velocity", 1e3, "mm/s"),
    "start_up_time": Scale("start-up time", 1e3, "ms"),
    "ripple": Scale("velocity ripple", 1.0, ""),
    "durability": Scale("durability F_c*delta", 1.0, ""),
    "efficiency": Scale("velocity per power zeta", 1e3, "mm/(s V A)"),
    "force": Scale("load force", 1.0, "N"),
}


def format_value(value: float | None, uncertainty: float | None = None) -> str:
    """
    Return a number with as many digits as its uncertainty supports.

    Parameters
    ----------
    value, uncertainty : float or None
        The number and its standard uncertainty; without one, four significant digits.

    """
    if value is None or math.isnan(value):
        return "-"
    if not uncertainty or math.isnan(uncertainty) or math.isinf(uncertainty):
        return f"{value:.4g}"
    digits = max(0, 1 - math.floor(math.log10(uncertainty)))
    return f"{value:.{digits}f} ± {uncertainty:.{digits}f}"


def format_interval(value: float, low: float, high: float, factor: float = 1.0) -> str:
    """Return a number and the interval it lies in, with the digits that the interval supports."""
    spread = factor * (high - low)
    digits = max(0, 2 - math.floor(math.log10(spread))) if spread > 0.0 else 4
    numbers = (f"{factor * one:.{digits}f}" for one in (value, low, high))
    return "{} [{}, {}]".format(*numbers)


def format_indicator(indicator: Indicator) -> str:
    """Return value and uncertainty of an indicator in the unit that people read."""
    scale = SCALES[indicator.name]
    if not indicator.is_available:
        return "-"
    return format_value(indicator.value * scale.factor, indicator.uncertainty * scale.factor)


def table(rows: Sequence[Sequence[str]], header: Sequence[str]) -> str:
    """Return lines of columns, the first one to the left and the others to the right."""
    cells = [list(header), *map(list, rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    lines = []
    for row in cells:
        first, *others = (
            cell.ljust(widths[i]) if i == 0 else cell.rjust(widths[i]) for i, cell in enumerate(row)
        )
        lines.append("  ".join((first, *others)).rstrip())
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)


def performance_table(
    performance: Performance, predictions: Mapping[str, Mapping[str, Any]] | None = None
) -> str:
    """
    Return the indicators of a run as text, beside what models predict.

    Parameters
    ----------
    performance : Performance
        The measured indicators.
    predictions : mapping, optional
        Predicted value, or None, by model and indicator.

    """
    models = dict(predictions or {})
    header = ["", "measured", *(model.replace("_", " ") for model in models), "unit"]
    rows = []
    for indicator in performance.indicators:
        scale = SCALES[indicator.name]
        predicted = [_scaled(model.get(indicator.name), scale) for model in models.values()]
        rows.append([scale.title, format_indicator(indicator), *predicted, scale.unit])
    lines = [table(rows, header)]
    lines += [
        f"{SCALES[one.name].title}: {one.reason}"
        for one in performance.indicators
        if not one.is_available
    ]
    lines += [f"warning: {text}" for text in performance.warnings]
    lost = sum(stream.lost for stream in performance.streams)
    received = sum(stream.received for stream in performance.streams)
    lines.append(f"{received} samples in {len(performance.streams)} streams, {lost} lost")
    return "\n".join(lines)


def _scaled(value: float | None, scale: Scale) -> str:
    return "-" if value is None else format_value(value * scale.factor)

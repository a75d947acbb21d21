"""The indicators of a campaign as a table with one row per point and indicator, SI units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

COLUMNS = (
    "point", "harmonics", "maximum_frequency", "status", "indicator", "unit", "value",
    "uncertainty", "model_1", "model_2", "reason",
)  # fmt: skip


def indicator_rows(results: Mapping[str, Any]) -> list[dict[str, Any]]:
    """
    Return the rows of the table.

    Parameters
    ----------
    results : mapping
        Content of results.json.

    """
    empty: dict[str, Any] = dict.fromkeys(COLUMNS)
    signals = {one["name"]: one["signal"] for one in results["campaign"]["points"]}
    rows = []
    for point in results["points"]:
        signal = signals[point["name"]]
        common = {
            "point": point["name"],
            "harmonics": signal["harmonics"],
            "maximum_frequency": signal["maximum_frequency"],
            "status": point["status"],
        }
        if point["performance"] is None:
            rows.append({**empty, **common, "reason": point["error"]})
            continue
        for one in point["performance"]["indicators"]:
            models = {m: values.get(one["name"]) for m, values in point["predictions"].items()}
            row = {key: one[key] for key in ("unit", "value", "uncertainty", "reason")}
            values = {**common, "indicator": one["name"], **row, **models}
            rows.append({key: values.get(key) for key in COLUMNS})
    return rows

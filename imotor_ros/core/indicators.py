"""
What is said of a run: performance indicators, each with uncertainty or reason, and provenance.

The indicators are those of section 6 of Hunstig, Hemsel and Sextro, "High-Velocity Operation of
Piezoelectric Inertia Motors - Experimental Validation".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imotor_ros.errors import BadInputError

MEAN_VELOCITY = "mean_velocity"
START_UP_TIME = "start_up_time"
RIPPLE = "ripple"
DURABILITY = "durability"
EFFICIENCY = "efficiency"
FORCE = "force"

UNITS = {
    MEAN_VELOCITY: "m/s",
    START_UP_TIME: "s",
    RIPPLE: "",
    DURABILITY: "",
    EFFICIENCY: "m/(V A s)",
    FORCE: "N",
}
"""Unit of each indicator, in the order in which they are reported."""

FREE_RUN = "free_run"
LOAD = "load"


@dataclass(frozen=True)
class Indicator:
    """
    One performance indicator of a run.

    Attributes
    ----------
    name : str
        Its name, e.g. "mean_velocity".
    unit : str
        SI unit, empty for a pure number.
    value : float
        The value (unit); NaN where it cannot be given.
    uncertainty : float
        Standard uncertainty of the value (unit), coverage factor 1.
    reason : str
        Why there is no value; empty where there is one.

    """

    name: str
    unit: str
    value: float = math.nan
    uncertainty: float = math.nan
    reason: str = ""

    @property
    def is_available(self) -> bool:
        """True if there is a value."""
        return not math.isnan(self.value)


@dataclass(frozen=True)
class StreamCount:
    """
    What arrived of one channel.

    Attributes
    ----------
    name : str
        Name of the channel.
    received, lost : int
        Samples that came, and that are missing before one that came.
    flags : int
        Bitwise or of the `SampleFlag` of its blocks.

    """

    name: str
    received: int
    lost: int
    flags: int = 0


@dataclass(frozen=True)
class Window:
    """
    The samples that an indicator rests on.

    Attributes
    ----------
    name : str
        "free_run" or "load".
    start, end : int
        First sample, and the one after the last.
    periods : int
        Number of whole drive periods in it.

    """

    name: str
    start: int
    end: int
    periods: int


@dataclass(frozen=True)
class Performance:
    """
    The indicators of a run and what they rest on.

    Attributes
    ----------
    run_id : str
        The run.
    is_final : bool
        True once every channel is complete; before that all values are provisional.
    indicators : tuple of Indicator
        One of each kind, in the order of `UNITS`.
    streams : tuple of StreamCount
        One per channel, in the order of their names.
    end_index : int
        Number of samples of the run that were taken into account.
    windows : tuple of Window
        The windows found; a window that was not found is missing.
    delays : tuple of (str, float)
        Delay (s) that was taken out of each channel.
    warnings : tuple of str
        What the reader of the values should know.

    """

    run_id: str
    is_final: bool
    indicators: tuple[Indicator, ...]
    streams: tuple[StreamCount, ...]
    end_index: int
    windows: tuple[Window, ...] = ()
    delays: tuple[tuple[str, float], ...] = ()
    warnings: tuple[str, ...] = ()

    def indicator(self, name: str) -> Indicator:
        """
        Return one indicator.

        Raises
        ------
        BadInputError
            If there is none of that name.

        """
        for one in self.indicators:
            if one.name == name:
                return one
        raise BadInputError(
            "no such indicator", where=self.run_id, value=name, bound="one of " + ", ".join(UNITS)
        )

    def window(self, name: str) -> Window | None:
        """Return a window, or None if it was not found."""
        return next((one for one in self.windows if one.name == name), None)

    def to_mapping(self) -> dict[str, Any]:
        """
        Return a plain mapping that survives JSON to the last bit.

        NaN, which JSON does not have, becomes None.
        """
        return {
            "run_id": self.run_id,
            "is_final": self.is_final,
            "end_index": self.end_index,
            "indicators": [
                {
                    "name": one.name,
                    "unit": one.unit,
                    "value": _plain(one.value),
                    "uncertainty": _plain(one.uncertainty),
                    "reason": one.reason,
                }
                for one in self.indicators
            ],
            "streams": [dict(vars(one)) for one in self.streams],
            "windows": [dict(vars(one)) for one in self.windows],
            "delays": [{"channel": name, "delay": delay} for name, delay in self.delays],
            "warnings": list(self.warnings),
        }

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> Performance:
        """
        Return the object of which `to_mapping` made a mapping.

        Raises
        ------
        BadInputError
            If a key is missing or a value has the wrong form.

        """
        try:
            return cls(
                run_id=str(mapping["run_id"]),
                is_final=bool(mapping["is_final"]),
                indicators=tuple(_read_indicator(one) for one in mapping["indicators"]),
                streams=tuple(StreamCount(**one) for one in mapping["streams"]),
                end_index=int(mapping["end_index"]),
                windows=tuple(Window(**one) for one in mapping["windows"]),
                delays=tuple((one["channel"], float(one["delay"])) for one in mapping["delays"]),
                warnings=tuple(mapping["warnings"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise BadInputError(
                f"cannot be read ({type(error).__name__}: {error})", where="performance"
            ) from error


def _plain(number: float) -> float | None:
    return None if math.isnan(number) else float(number)


def _read_indicator(mapping: Mapping[str, Any]) -> Indicator:
    value, uncertainty = (
        math.nan if mapping[key] is None else float(mapping[key])
        for key in ("value", "uncertainty")
    )
    return Indicator(mapping["name"], mapping["unit"], value, uncertainty, mapping["reason"])

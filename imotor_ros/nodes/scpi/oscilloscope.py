"""An oscilloscope: waits for the trigger, records all inputs, hands the records over as volts."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.alignment import AFTER, BEFORE, interpolate
from imotor_ros.nodes.scpi.dialect import OscilloscopeDialect
from imotor_ros.nodes.scpi.instrument import Instrument
from imotor_ros.nodes.scpi.rates import RatePlan
from imotor_ros.nodes.scpi.settings import OscilloscopeSettings

POLL_TIME = 0.01
"""Time between two questions whether something has happened (s)."""

_RATE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Record:
    """
    What an input showed.

    Attributes
    ----------
    volts : ndarray, shape (n,)
        Voltage at the input (V).
    is_limited : ndarray of bool, shape (n,)
        Where the converter was at an end of its range.
    start, step : float
        Time of the first sample after the trigger, and time between samples (s).

    """

    volts: NDArray[np.float64]
    is_limited: NDArray[np.bool_]
    start: float
    step: float

    def covers(self, first: float, last: float) -> bool:
        """Whether the record can be read at all times (s) between two."""
        low = (first - self.start) / self.step
        high = (last - self.start) / self.step
        return low >= BEFORE and high < len(self.volts) - AFTER

    def read(
        self, first: float, interval: float, count: int
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """
        Return volts, and what rests on limited samples, at equally spaced times.

        Parameters
        ----------
        first, interval : float
            Time of the first one after the trigger, and between two (s).
        count : int
            How many.

        """
        place, stride = (first - self.start) / self.step, interval / self.step
        # times are rounded where they were printed: what is a whole sample is meant to be one
        place = round(place) if abs(place - round(place)) < 1e-6 else place
        stride = round(stride) if abs(stride - round(stride)) < 1e-12 * count else stride
        volts = interpolate(self.volts, place, stride, count)
        near = np.rint(place + np.arange(count) * stride).astype(np.int64)
        return volts, self.is_limited[np.clip(near, 0, len(self.is_limited) - 1)]


class Oscilloscope:
    """
    An oscilloscope.

    Parameters
    ----------
    instrument : Instrument
        The connection.
    dialect : OscilloscopeDialect
        How to talk to it.
    settings : OscilloscopeSettings
        Ranges, trigger and memory.
    ranges : dict
        Largest voltage (V) of every input in use, by its number.

    """

    def __init__(
        self,
        instrument: Instrument,
        dialect: OscilloscopeDialect,
        settings: OscilloscopeSettings,
        ranges: dict[str, float],
    ) -> None:
        self.instrument = instrument
        self._dialect = dialect
        self._settings = settings
        self._plan: RatePlan | None = None
        instrument.tell_all(dialect.reset, {})
        instrument.tell_all(settings.setup.splitlines(), {})
        for number, largest in ranges.items():
            values = {
                "input": number, "offset": 0, "span": 2.0 * largest,
                "scale": 2.0 * largest / dialect.divisions,
            }  # fmt: skip
            instrument.tell_all(dialect.input, values)

    def arm(self, plan: RatePlan, timeout: float) -> None:
        """
        Set the acquisition and wait until the oscilloscope waits for its trigger.

        Raises
        ------
        InstrumentError
            If it takes another rate or length, or does not get ready.

        """
        self._plan = plan
        dialect, tool = self._dialect, self.instrument
        share = 100.0 * plan.before / plan.points
        values = {
            "rate": plan.rate, "points": plan.points, "before": plan.before,
            "before_percent": share, "duration": plan.points / plan.rate,
            "centre": (plan.points / 2 - plan.before) / plan.rate,
            "trigger_source": self._settings.trigger_source,
            "trigger_level": self._settings.trigger_level,
        }  # fmt: skip
        tool.tell_all(dialect.acquire, values)
        for query, wanted in (
            (dialect.rate_query, plan.rate), (dialect.points_query, float(plan.points)),
        ):  # fmt: skip
            if query and abs(tool.ask_number(query) - wanted) > _RATE_TOLERANCE * wanted:
                raise tool.fault(query, f"answered {tool.ask(query)}, was set to {wanted:.12g}")
        tool.tell_all(dialect.arm, values)
        deadline = time.monotonic() + timeout
        while not re.fullmatch(dialect.armed, answer := tool.ask(dialect.armed_query)):
            if time.monotonic() > deadline:
                raise tool.fault(
                    dialect.armed_query,
                    f"not ready for a trigger within {timeout:g} s, the last answer was {answer!r}",
                )
            time.sleep(POLL_TIME)

    def is_done(self) -> bool:
        """Whether the record is taken."""
        dialect = self._dialect
        answer = self.instrument.ask(dialect.done_query)
        if not re.fullmatch(dialect.done, answer):
            return False
        return not (dialect.busy_bit and int(float(answer)) & dialect.busy_bit)

    def give_up(self) -> None:
        """Stop waiting for a trigger."""
        for command in self._dialect.disarm:
            self.instrument.tell(command)

    def no_trigger(self, seconds: float) -> Exception:
        """Return the fault of a record that did not come."""
        return self.instrument.fault(
            self._dialect.done_query, f"no record within {seconds:.3g} s: was there a trigger?"
        )

    def read(self, number: str) -> Record:
        """
        Return the record of an input.

        Raises
        ------
        InstrumentError
            If it is not as long as it was set, or its scaling makes no sense.

        """
        assert self._plan is not None
        dialect, tool, points = self._dialect, self.instrument, self._plan.points
        values = {"input": number, "points": points}
        tool.tell_all(dialect.select, values)
        segments = list(self._segments(points))
        tool.tell_all(dialect.segment, {**values, **segments[0]})
        scaling = self._scaling()
        words = []
        for segment in segments:
            tool.tell_all(dialect.segment, {**values, **segment})
            data = tool.ask_block(dialect.data_query)
            wanted = segment["count"] * dialect.words.dtype.itemsize
            if len(data) != wanted:
                raise tool.fault(
                    dialect.data_query,
                    f"input {number}: a record of {len(data)} bytes came, expected {wanted} "
                    f"(samples {segment['first']} to {segment['last']})",
                )
            words.append(dialect.words.decode(data))
        tool.check_errors(dialect.data_query)
        return self._record(np.concatenate(words), scaling)

    def _segments(self, points: int) -> list[dict[str, int]]:
        length = self._settings.segment_length if self._dialect.segment else points
        starts = range(0, points, length)
        ends = [min(start + length, points) for start in starts]
        return [
            {"first": start + 1, "last": end, "count": end - start}
            for start, end in zip(starts, ends, strict=True)
        ]

    def _scaling(self) -> dict[str, float]:
        dialect, tool = self._dialect, self.instrument
        answer = tool.ask(dialect.preamble_query)
        parts = [part.strip() for part in answer.split(dialect.preamble_separator)]
        try:
            pairs = zip(dialect.preamble, parts, strict=True)
            scaling = {name: float(part) for name, part in pairs if name != "-"}
        except ValueError as error:
            raise tool.fault(
                dialect.preamble_query,
                f"answered {answer!r}, expected {len(dialect.preamble)} numbers",
            ) from error
        assert self._plan is not None
        step = scaling["x_increment"]
        if not abs(step * self._plan.rate - 1.0) < 1e-6 or not scaling["y_increment"] > 0.0:
            raise tool.fault(
                dialect.preamble_query,
                f"an interval of {step:g} s and a step of {scaling['y_increment']:g} V came, "
                f"expected {1.0 / self._plan.rate:g} s and a step above 0 V",
            )
        return scaling

    def _record(self, words: NDArray[np.float64], scaling: dict[str, float]) -> Record:
        volts = (words - scaling["y_reference"]) * scaling["y_increment"] + scaling["y_origin"]
        limited = self._dialect.words.at_ends(words, self._settings.bits)
        assert self._plan is not None
        # the interval as printed is rounded; over a whole record that could be a sample
        return Record(volts, limited, scaling["x_origin"], 1.0 / self._plan.rate)

    def close(self) -> None:
        """Stop waiting and let go, as far as the connection lets."""
        self.instrument.close()

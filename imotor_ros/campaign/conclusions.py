"""
What the paper concludes (sections 7 and 8, figure 12), tested on the results of a campaign.

Every conclusion is a list of cases: a difference that the paper expects to be positive, with the
standard uncertainty of the measured values. A case holds where the difference is positive by more
than twice its uncertainty, fails where it is negative by as much, and is undecided between. A
conclusion holds where every case does. Uncertainties of two points are added as if independent;
a calibration error that both share makes that a little pessimistic.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from imotor_ros.campaign.point import PointParameters
from imotor_ros.core.indicators import FORCE, MEAN_VELOCITY, RIPPLE, START_UP_TIME, Performance

HOLDS = "holds"
FAILS = "does not hold"
UNDECIDED = "undecided"

COVERAGE = 2.0
"""Uncertainties by which a difference must stand out."""

FORCE_SPREAD = 0.10
"""Relative change of the force over frequency that still is "little influence"; our reading."""

ALMOST_ALL = 0.9
"""Share of cases that we read "in almost all cases" as."""

_LISTED = 3


@dataclass(frozen=True)
class Case:
    """
    One comparison.

    Attributes
    ----------
    where : str
        What is compared, e.g. "f_n = 9250 Hz: n = 2 over n = 3".
    difference, uncertainty : float
        What should be positive, and its standard uncertainty (unit).
    unit : str
        SI unit; empty for a pure number.
    verdict : str
        "holds", "does not hold" or "undecided".

    """

    where: str
    difference: float
    uncertainty: float
    unit: str
    verdict: str


@dataclass(frozen=True)
class Conclusion:
    """
    A statement of the paper and what the results say to it.

    Attributes
    ----------
    name, statement : str
        Name, and the statement in words, with its criterion.
    verdict : str
        "holds", "does not hold" or "undecided".
    summary : str
        The verdict in numbers.
    cases : tuple of Case
        The comparisons that it rests on.

    """

    name: str
    statement: str
    verdict: str
    summary: str
    cases: tuple[Case, ...]

    def to_mapping(self) -> dict[str, Any]:
        """Return plain JSON."""
        return {**asdict(self), "cases": [asdict(case) for case in self.cases]}


@dataclass(frozen=True)
class MeasuredPoint:
    """A point, what was measured there, and what the models predict (by model and indicator)."""

    name: str
    parameters: PointParameters
    performance: Performance
    predictions: Mapping[str, Mapping[str, Any]]

    @property
    def harmonics(self) -> int:
        """Number of harmonics."""
        return self.parameters.signal.harmonics

    @property
    def frequency(self) -> float:
        """Frequency of the highest harmonic (Hz)."""
        return self.parameters.signal.maximum_frequency

    def measured(self, name: str) -> tuple[float, float] | None:
        """Return an indicator and its uncertainty (SI), or None."""
        for one in self.performance.indicators:
            if one.name == name and one.is_available:
                return one.value, one.uncertainty
        return None


def draw_conclusions(points: Sequence[MeasuredPoint]) -> tuple[Conclusion, ...]:
    """
    Test the paper's conclusions on the points of a campaign.

    Parameters
    ----------
    points : sequence of MeasuredPoint
        Points that differ in number of harmonics and frequency; what else they differ in does
        not enter. Where several points share both, all are compared.

    Returns
    -------
    tuple of Conclusion
        Those for which there is something to compare.

    """
    fewest = min((point.harmonics for point in points), default=0)
    f_n = "f_n = {0.frequency:g} Hz: n = {0.harmonics} beside n = {1.harmonics}".format
    n = "n = {0.harmonics}: {1.frequency:g} beside {0.frequency:g} Hz".format
    by_frequency = _groups(points, lambda p: p.frequency, lambda p: p.harmonics)
    by_harmonics = _groups(points, lambda p: p.harmonics, lambda p: p.frequency)
    against_two = [(g[0], other) for g in by_frequency for other in g[1:]] if fewest == 2 else []
    along_n = [pair for group in by_frequency for pair in pairwise(group)]
    along_f = [pair for group in by_harmonics for pair in pairwise(group)]
    found = (
        _ordered(
            "two_harmonics_fastest", "Two harmonics are the fastest at every frequency.",
            MEAN_VELOCITY, -1.0, against_two, f_n,
        ),
        _ordered(
            "two_harmonics_smoothest", "Two harmonics have the least ripple at every frequency.",
            RIPPLE, 1.0, against_two, f_n,
        ),
        _ordered(
            "more_harmonics_stronger", "More harmonics give a larger force at every frequency.",
            FORCE, 1.0, along_n, f_n,
        ),
        _ordered(
            "higher_frequency_faster", "Higher frequencies give a higher velocity.",
            MEAN_VELOCITY, 1.0, along_f, n,
        ),
        _force_over_frequency(by_harmonics),
        _model_2_closer(points),
        _worst_at_lowest_fundamental(points),
    )  # fmt: skip
    return tuple(one for one in found if one is not None)


Key = Callable[[MeasuredPoint], float]
Pair = tuple[MeasuredPoint, MeasuredPoint]


def _groups(points: Sequence[MeasuredPoint], common: Key, order: Key) -> list[list[MeasuredPoint]]:
    """Return the points by what they have in common, each group in order, the groups as well."""
    keys = sorted({common(point) for point in points})
    return [sorted((p for p in points if common(p) == key), key=order) for key in keys]


def _case(where: str, difference: float, uncertainty: float, unit: str) -> Case:
    verdict = UNDECIDED
    if abs(difference) > COVERAGE * uncertainty:
        verdict = HOLDS if difference > 0.0 else FAILS
    return Case(where, difference, uncertainty, unit, verdict)


def _ordered(
    name: str,
    statement: str,
    indicator: str,
    sign: float,
    pairs: Sequence[Pair],
    label: Callable[[MeasuredPoint, MeasuredPoint], str],
) -> Conclusion | None:
    """Return the conclusion that an indicator grows (sign 1) or falls (-1) within each pair."""
    cases: list[Case] = []
    for first, second in pairs:
        a, b = first.measured(indicator), second.measured(indicator)
        if a is None or b is None or label(first, second) in (case.where for case in cases):
            continue
        unit = first.performance.indicator(indicator).unit
        where = label(first, second)
        cases.append(_case(where, sign * (b[0] - a[0]), math.hypot(a[1], b[1]), unit))
    return _concluded(name, statement, cases)


def _concluded(name: str, statement: str, cases: Sequence[Case]) -> Conclusion | None:
    """Return the conclusion that every case must hold for; None without cases."""
    if not cases:
        return None
    counts = {v: sum(case.verdict == v for case in cases) for v in (HOLDS, FAILS, UNDECIDED)}
    verdict = FAILS if counts[FAILS] else UNDECIDED if counts[UNDECIDED] else HOLDS
    summary = f"holds in {counts[HOLDS]} of {len(cases)} cases"
    for what in (FAILS, UNDECIDED):
        if counts[what]:
            places = [case.where for case in cases if case.verdict == what]
            summary += f", {what} in {counts[what]} ({_listed(places)})"
    return Conclusion(name, statement, verdict, summary, tuple(cases))


def _listed(places: Sequence[str]) -> str:
    shown = "; ".join(places[:_LISTED])
    return shown + (f"; and {len(places) - _LISTED} more" if len(places) > _LISTED else "")


def _force_over_frequency(groups: Sequence[Sequence[MeasuredPoint]]) -> Conclusion | None:
    """Return the conclusion on the force over frequency, the lowest frequency left out."""
    cases = []
    for group in groups:
        lowest = group[0].frequency
        found = [one for p in group if p.frequency > lowest and (one := p.measured(FORCE))]
        if len(found) < 2:
            continue
        (low, low_error), (high, high_error) = min(found), max(found)
        mean = sum(value for value, _ in found) / len(found)
        spread, error = (high - low) / mean, math.hypot(low_error, high_error) / mean
        where = f"n = {group[0].harmonics}: {FORCE_SPREAD:.0%} less the spread of {spread:.1%}"
        cases.append(_case(where, FORCE_SPREAD - spread, error, ""))
    return _concluded(
        "force_independent_of_frequency",
        "Above the lowest frequency the force changes little with frequency: "
        f"(max - min) / mean below {FORCE_SPREAD:.0%}.",
        cases,
    )


def _indicators(point: MeasuredPoint) -> Iterator[tuple[str, float, float, float, float]]:
    """Yield name, value, uncertainty and both predictions of what has all of them."""
    for one in point.performance.indicators:
        first, second = (
            point.predictions.get(model, {}).get(one.name) for model in ("model_1", "model_2")
        )
        if one.is_available and first is not None and second is not None:
            yield one.name, one.value, one.uncertainty, float(first), float(second)


def _model_2_closer(points: Sequence[MeasuredPoint]) -> Conclusion | None:
    """Return the conclusion on the models, over indicators and points, in relative distances."""
    cases = []
    for point in points if len(points) > 1 else ():
        for name, value, error, first, second in _indicators(point):
            scale = abs(value) or 1.0
            gain = (abs(value - first) - abs(value - second)) / scale
            # between the models the difference of the distances moves twice as far as the value
            is_between = (
                min(first, second) - COVERAGE * error
                < value
                < (max(first, second) + COVERAGE * error)
            )
            where = f"{point.name}: {name}"
            cases.append(_case(where, gain, 2.0 * error / scale if is_between else 0.0, ""))
    decided = [case for case in cases if case.verdict != UNDECIDED]
    if not decided:
        return None
    closer = sum(case.verdict == HOLDS for case in decided)
    share = closer / len(decided)
    others = _listed([case.where for case in decided if case.verdict == FAILS])
    summary = f"closer in {closer} of {len(decided)} decided cases ({share:.0%})"
    summary += f", {len(cases) - len(decided)} undecided"
    return Conclusion(
        "model_2_closer",
        "Model 2 is closer to the measurement than model 1 in almost all cases (at least "
        f"{ALMOST_ALL:.0%} of those that the uncertainty decides).",
        HOLDS if share >= ALMOST_ALL else FAILS,
        summary + (f"; model 1 closer: {others}" if others else ""),
        tuple(cases),
    )


def _worst_at_lowest_fundamental(points: Sequence[MeasuredPoint]) -> Conclusion | None:
    """Return the conclusion that model 2 deviates most where stiction matters most."""
    worst: dict[str, tuple[float, float]] = {}
    for point in points:
        found = [
            (abs(value - second) / abs(second), error / abs(second))
            for name, value, error, _, second in _indicators(point)
            if second != 0.0 and name != START_UP_TIME
        ]
        if found:
            worst[point.name] = max(found)
    if len(worst) < 2:
        return None
    measured = [point for point in points if point.name in worst]
    lowest = min(measured, key=lambda p: p.frequency / p.harmonics).name
    deviation, error = worst[lowest]
    others = [(other, *worst[other]) for other in worst if other != lowest]
    cases = [
        _case(f"{lowest} beside {name}", deviation - other, math.hypot(error, doubt), "")
        for name, other, doubt in others
    ]
    return _concluded(
        "model_2_worst_at_lowest_fundamental",
        "Model 2 deviates most, relative to its prediction and the start-up time aside, at the "
        f"lowest fundamental frequency ({lowest}: {deviation:.1%} +- {error:.1%}).",
        cases,
    )

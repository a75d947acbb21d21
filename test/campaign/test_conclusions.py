"""The paper's conclusions, tested on made-up results."""

from collections.abc import Callable

import pytest

from imotor_ros.campaign.conclusions import (
    FAILS,
    HOLDS,
    UNDECIDED,
    Conclusion,
    MeasuredPoint,
    draw_conclusions,
)
from imotor_ros.campaign.point import PointParameters
from imotor_ros.core.indicators import UNITS, Indicator, Performance

GRID = [(n, f) for n in (2, 3, 4) for f in (2312.5, 4625.0, 9250.0)]


def point(
    n: int, f: float, models: tuple[float, float] = (2.0, 1.0), **values: tuple[float, float]
) -> MeasuredPoint:
    indicators = tuple(
        Indicator(name, unit, *values[name])
        if name in values
        else Indicator(name, unit, reason="not made up")
        for name, unit in UNITS.items()
    )
    name = f"n{n}_f{f:g}"
    return MeasuredPoint(
        name,
        PointParameters.from_leaves({"signal.harmonics": n, "signal.maximum_frequency": f}, name),
        Performance(name, True, indicators, (), 1),
        {"model_1": dict.fromkeys(values, models[0]), "model_2": dict.fromkeys(values, models[1])},
    )


def find(points: list[MeasuredPoint], name: str) -> Conclusion:
    return next(one for one in draw_conclusions(points) if one.name == name)


def grid(
    value: Callable[[int, float], float], name: str, error: float = 1e-6
) -> list[MeasuredPoint]:
    return [point(n, f, **{name: (value(n, f), error)}) for n, f in GRID]


def test_order_of_harmonics_is_judged_at_each_frequency() -> None:
    points = grid(lambda n, f: f / n, "mean_velocity")
    fastest = find(points, "two_harmonics_fastest")
    assert (fastest.verdict, len(fastest.cases)) == (HOLDS, 6)
    assert find(points, "higher_frequency_faster").verdict == HOLDS
    case = fastest.cases[0]
    assert case.difference == pytest.approx(2312.5 / 2 - 2312.5 / 3)
    assert case.uncertainty == pytest.approx(2**0.5 * 1e-6)


def test_one_frequency_against_it_makes_a_conclusion_fail_and_is_named() -> None:
    points = grid(lambda n, f: n if f == 9250.0 else 1 / n, "mean_velocity")
    fastest = find(points, "two_harmonics_fastest")
    assert fastest.verdict == FAILS
    assert "holds in 4 of 6" in fastest.summary
    assert "f_n = 9250 Hz: n = 2 beside n = 3" in fastest.summary


def test_difference_within_the_uncertainty_decides_nothing() -> None:
    points = grid(lambda n, f: n, "ripple", error=0.6)
    assert find(points, "two_harmonics_smoothest").verdict == UNDECIDED


def test_force_over_frequency_leaves_the_lowest_frequency_out() -> None:
    points = grid(lambda n, f: 0.1 if f == 2312.5 else 0.3 + 1e-7 * f, "force")
    assert find(points, "force_independent_of_frequency").verdict == HOLDS
    points = grid(lambda n, f: 0.3 + 1e-5 * f, "force")
    assert find(points, "force_independent_of_frequency").verdict == FAILS


@pytest.mark.parametrize(
    ("value", "error", "verdict"),
    [
        (1.1, 0.01, HOLDS),
        (0.5, 0.01, HOLDS),  # beyond model 2: closer by the whole difference
        (1.9, 0.01, FAILS),
    ],
)
def test_models_are_compared_by_distance(value: float, error: float, verdict: str) -> None:
    points = [point(n, 9250.0, ripple=(value, error)) for n in (2, 3)]
    assert find(points, "model_2_closer").verdict == verdict


def test_distances_that_the_uncertainty_may_turn_round_do_not_count() -> None:
    points = [point(n, 9250.0, ripple=(1.45, 0.1)) for n in (2, 3)]
    assert "model_2_closer" not in {one.name for one in draw_conclusions(points)}


def test_deviation_of_model_2_is_looked_for_at_the_lowest_fundamental() -> None:
    points = [point(n, f, ripple=(1.0 + n / f, 1e-6)) for n, f in GRID]
    found = find(points, "model_2_worst_at_lowest_fundamental")
    assert (found.verdict, len(found.cases)) == (HOLDS, 8)
    assert "n4_f2312.5" in found.statement


def test_single_point_concludes_nothing() -> None:
    assert draw_conclusions([point(2, 9250.0, ripple=(1.0, 0.1))]) == ()
    assert draw_conclusions([]) == ()

"""Performance goes through JSON and comes back the same to the last bit."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imotor_ros.core.indicators import (
    UNITS,
    Indicator,
    Performance,
    StreamCount,
    Window,
)
from imotor_ros.errors import BadInputError

names = st.text(max_size=8)
numbers = st.floats(allow_nan=False, allow_infinity=False)
counts = st.integers(min_value=0, max_value=2**62)
missing = st.builds(Indicator, names, names, reason=names)
indicators = st.one_of(missing, st.builds(Indicator, names, names, numbers, numbers, names))
performances = st.builds(
    Performance,
    names,
    st.booleans(),
    st.lists(indicators, max_size=4).map(tuple),
    st.lists(st.builds(StreamCount, names, counts, counts, counts), max_size=3).map(tuple),
    counts,
    st.lists(st.builds(Window, names, counts, counts, counts), max_size=2).map(tuple),
    st.lists(st.tuples(names, numbers), max_size=3).map(tuple),
    st.lists(names, max_size=3).map(tuple),
)


@given(performances)
def test_performance_survives_json_to_the_last_bit(performance: Performance) -> None:
    text = json.dumps(performance.to_mapping(), allow_nan=False)
    assert Performance.from_mapping(json.loads(text)) == performance


def test_missing_value_is_null_in_json() -> None:
    mapping = Performance("r", True, (Indicator("force", "N", reason="no contact"),), (), 0)
    one = mapping.to_mapping()["indicators"][0]
    assert one["value"] is None
    assert one["uncertainty"] is None


@pytest.mark.parametrize("key", ["run_id", "indicators", "streams", "windows", "end_index"])
def test_mapping_without_a_key_is_refused(key: str) -> None:
    mapping = Performance("r", True, (), (), 0).to_mapping()
    del mapping[key]
    with pytest.raises(BadInputError, match=key):
        Performance.from_mapping(mapping)


def test_mapping_of_the_wrong_form_is_refused() -> None:
    mapping = Performance("r", True, (), (), 0).to_mapping()
    with pytest.raises(BadInputError, match="cannot be read"):
        Performance.from_mapping(mapping | {"streams": [{"name": "a", "many": 3}]})


def test_indicators_and_windows_are_found_by_name() -> None:
    force, load = Indicator("force", "N", 0.3, 0.01), Window("load", 3, 9, 1)
    performance = Performance("r", True, (force,), (), 0, (load,))
    assert performance.indicator("force") is force
    assert performance.window("load") is load
    assert performance.window("free_run") is None
    with pytest.raises(BadInputError, match="no such indicator"):
        performance.indicator("speed")


def test_indicator_without_value_is_not_available() -> None:
    assert not Indicator("force", "N", reason="no contact").is_available
    assert Indicator("force", "N", 0.0, 0.1).is_available
    assert math.isnan(Indicator("force", "N").value)
    assert next(iter(UNITS)) == "mean_velocity"

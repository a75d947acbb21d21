"""First roots: against polynomials made from their roots, close pairs included."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imotor_ros.core.polynomial import evaluate, first_crossing, first_root, root_workspace

WORK = root_workspace()


def _from_roots(roots):
    return np.poly(roots)[::-1].copy()


@settings(deadline=None, derandomize=True, database=None)
@given(
    st.lists(st.floats(-2.0, 3.0), min_size=1, max_size=9),
    st.lists(st.tuples(st.floats(-1.0, 2.0), st.floats(0.05, 1.0)), max_size=3),
)
def test_first_root_is_found_whatever_else_there_is(roots, pairs):
    inside = sorted(root for root in roots if 0.0 < root < 1.0)
    # close neighbours make the roots of the rounded coefficients something else
    if any(b - a < 0.05 for a, b in zip(sorted(roots), sorted(roots)[1:], strict=False)):
        return
    if any(abs(root) < 0.01 or abs(root - 1.0) < 0.01 for root in roots):
        return
    c = _from_roots(
        [*roots, *(complex(a, b) for a, b in pairs), *(complex(a, -b) for a, b in pairs)]
    )
    c = np.ascontiguousarray(c.real)
    found = first_root(c, 0, c.size - 1, 1.0, WORK)
    if inside:
        # rounding of the coefficients moves a root by eps * sum|c| over the slope there
        slope = abs(np.polyval(np.polyder(c[::-1]), inside[0]))
        assert found == pytest.approx(inside[0], abs=1e-13 + 1e-14 * np.sum(np.abs(c)) / slope)
    else:
        assert found == math.inf


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6])
def test_close_pair_of_roots_is_not_stepped_over(gap):
    c = _from_roots([0.5, 0.5 + gap, 2.0])
    found = first_root(c, 0, 3, 1.0, WORK)
    assert found == pytest.approx(0.5, abs=1e-15 / gap + 1e-15)


def test_known_roots_at_zero_are_left_out():
    c = _from_roots([0.0, 0.0, 0.3])
    assert first_root(c, 2, 3, 1.0, WORK) == pytest.approx(0.3)
    assert first_crossing(c, 0, 3, -1, 1.0, WORK) == pytest.approx(0.3)
    assert first_crossing(c, 0, 3, 1, 1.0, WORK) == 0.0


def test_no_root_is_no_root():
    assert first_root(np.array([1.0, -1.0, 0.5]), 0, 2, 3.0, WORK) == math.inf
    assert first_root(np.array([2.0]), 0, 0, 3.0, WORK) == math.inf


def test_evaluation():
    c = np.array([1.0, -2.0, 0.5, 3.0])
    assert evaluate(c, 3, 0.7) == pytest.approx(1 - 1.4 + 0.245 + 3 * 0.343, rel=1e-15)


@pytest.mark.parametrize("last", [1.0 + 1e-12, 1.0 + 1e-6, 1.2, 3.0])
def test_extreme_is_not_taken_for_a_root(last):
    # zero at the start but for rounding, highest in the middle, zero again near the end
    assert first_root(np.array([1e-20, 1.0, -1.0]), 0, 2, last, WORK) == pytest.approx(
        1.0, rel=1e-14
    )

"""The hysteresis: closed forms, memory, independence of the rate, and what table 1 asks of it."""

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.hysteresis import Hysteresis, HysteresisModel, NoHysteresis, PlayHysteresis
from imotor_ros.errors import BadInputError

PAPER = PlayHysteresis()
POINTS = 40_000


def sine_loop(model: HysteresisModel, amplitude: float, offset: float = 0.0) -> NDArray[np.float64]:
    """Return the effective voltage over one period of a sine, once the loop is closed."""
    voltage = offset + amplitude * np.sin(2.0 * np.pi * np.arange(2 * POINTS) / POINTS)
    return Hysteresis(model).process(voltage)[POINTS:]


@pytest.mark.parametrize("amplitude", [0.5, 3.0, 14.0, 40.0, 70.0])
@pytest.mark.parametrize("offset", [0.0, 50.0])
def test_describing_function_is_the_fundamental_of_the_loop(
    amplitude: float, offset: float
) -> None:
    """Sampling a loop with corners at 40 000 points leaves 1e-8 of it."""
    turn = np.exp(-2j * np.pi * np.arange(POINTS) / POINTS)
    fundamental = 2.0 * np.mean(sine_loop(PAPER, amplitude, offset) * turn) * 1j
    assert fundamental / amplitude == pytest.approx(PAPER.describing_function(amplitude), abs=1e-7)


@pytest.mark.parametrize("amplitude", [3.0, 20.0, 44.0, 70.0])
def test_loop_opening_is_that_of_the_loop(amplitude: float) -> None:
    loop = sine_loop(PAPER, amplitude)
    opening = abs(loop[POINTS // 2] - loop[0])
    assert opening / np.ptp(loop) == pytest.approx(PAPER.loop_opening(amplitude), rel=1e-9)


def test_loop_does_not_depend_on_the_rate() -> None:
    """The same voltages in the same order give the same answer, however many lie between."""
    turns = ((0.0, 80.0), (80.0, 10.0), (10.0, 60.0))
    slow = np.concatenate([np.linspace(a, b, 1000, endpoint=False) for a, b in turns])
    fast = slow[::250]
    answer = Hysteresis(PAPER).process(slow)
    assert np.array_equal(Hysteresis(PAPER).process(fast), answer[::250])


def test_minor_loop_is_forgotten_once_it_is_closed() -> None:
    """Return-point memory: a voltage that comes back to where it turned wipes out the loop."""
    straight = np.array([0.0, 100.0, 20.0, 90.0])
    with_loops = np.array([0.0, 100.0, 20.0, 60.0, 35.0, 55.0, 50.0, 35.0, 60.0, 90.0])
    ends = [Hysteresis(PAPER).process(voltage)[-1] for voltage in (straight, with_loops)]
    assert ends[0] == pytest.approx(ends[1], rel=1e-14)


def test_loop_loses_energy_whatever_the_voltage() -> None:
    """The work of u on w over a closed path is never negative (the operator is passive)."""
    path = np.random.default_rng(3).uniform(-20.0, 120.0, 200)
    fine = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(path)])
    twice = np.concatenate([fine, np.linspace(fine[-1], fine[0], 50), fine])
    effective = Hysteresis(PAPER).process(twice)
    start = len(fine) + 50
    work = np.trapezoid(twice[start:], effective[start:])
    assert effective[-1] == pytest.approx(effective[len(fine) - 1])
    assert work > 0.0


def test_sine_of_small_amplitude_meets_no_play() -> None:
    assert PAPER.describing_function(0.6) == pytest.approx(PAPER.proportional)
    assert PAPER.loop_opening(0.6) == 0.0


def test_paper_hysteresis_lags_as_in_table_1() -> None:
    """Some 9 of its 9.5 degrees at the amplitude of its first harmonic; unit gain at 40 V."""
    lag = -np.degrees(np.angle(PAPER.describing_function(np.linspace(24.0, 40.0, 50))))
    assert lag.min() > 8.5
    assert lag.max() < 9.0
    assert abs(PAPER.describing_function(40.0)) == pytest.approx(1.0, abs=1e-3)


def test_paper_hysteresis_opens_as_data_sheets_state() -> None:
    """2 % of the stroke at small signals, 10 to 15 % over the range of -20 to 120 V."""
    assert 0.015 < PAPER.loop_opening(2.0) < 0.025
    assert 0.10 < PAPER.loop_opening(70.0) < 0.15


def test_lag_of_the_paper_needs_a_wider_loop_at_its_own_amplitude() -> None:
    """tan(lag) <= 4/pi of the opening for any play, so 9 degrees need more than 12 %."""
    for threshold in np.linspace(0.01, 0.99, 30):
        play = PlayHysteresis(1e-9, (float(threshold),), (1.0,))
        gain = play.describing_function(1.0)
        # the flat top of a play's answer makes its fundamental larger than half its height
        assert -gain.imag / abs(gain) < 4.0 / math.pi * play.loop_opening(1.0)


def test_no_hysteresis_leaves_the_voltage_as_it_is() -> None:
    voltage = np.random.default_rng(1).uniform(-20.0, 120.0, 100)
    assert np.array_equal(Hysteresis(NoHysteresis()).process(voltage), voltage)
    assert np.array_equal(NoHysteresis().describing_function([1.0, 2.0]), [1.0, 1.0])


@pytest.mark.parametrize(
    ("thresholds", "weights"),
    [((1.0, 2.0), (0.1,)), ((2.0, 1.0), (0.1, 0.1)), ((0.0,), (0.1,)), ((1.0,), (-0.1,))],
)
def test_plays_that_make_no_sense_are_refused(
    thresholds: tuple[float, ...], weights: tuple[float, ...]
) -> None:
    with pytest.raises(BadInputError, match="PlayHysteresis"):
        PlayHysteresis(1.0, thresholds, weights)

"""The template driver and its card: a campaign with one line changed gives equal results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from imotor_ros.bag.evaluate import evaluate_bag
from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.bench import PerformanceReported
from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.driver import Driver
from imotor_ros.campaign.plan import RunPlan, plan_run
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.contracts.topics import TRUTH_TOPICS
from imotor_ros.core.channel import ROD_VELOCITY, VOLTAGE
from imotor_ros.core.indicators import Performance
from imotor_ros.core.stand import StandParameters
from imotor_ros.errors import InstrumentError, UnknownKeyError
from imotor_ros.nodes.node_parameters import parameters_of_nodes
from imotor_ros.nodes.ros_bench import RosBench
from imotor_ros.nodes.simulated_card import INPUTS, OUTPUT_RANGE, SimulatedCard
from imotor_ros.nodes.template_driver import TemplateParameters

SENSITIVITIES = TemplateParameters().sensitivities
GAIN = TemplateParameters().amplifier_gain
RATE = 1e6


class Clock:
    """A clock that goes on when it is told to."""

    def __init__(self) -> None:
        self.time = 100.0

    def __call__(self) -> float:
        """Return the time (s)."""
        return self.time


def make_card(*, pace: float = 0.0, memory: int = 100_000) -> tuple[SimulatedCard, Clock]:
    """Return a card at rest, and the clock by which it is paced."""
    clock = Clock()
    card = SimulatedCard(
        StandParameters(),
        amplifier_gain=GAIN,
        sensitivities=SENSITIVITIES,
        memory=memory,
        pace=pace,
        clock=clock,
    )
    card.start(RATE, 1)
    return card, clock


# ---- the card ----------------------------------------------------------------------------------


def test_card_shows_volts_that_mean_what_was_played() -> None:
    """50 V at the stator are 2.5 V at the output, and 2.5 V at the monitor."""
    card, _ = make_card()
    rise = np.linspace(0.0, 50.0 / GAIN, 10_000)
    card.write(np.concatenate([rise, np.full(10_000, rise[-1])]))
    volts, flags = card.read()
    assert set(volts) == set(INPUTS)
    assert not flags
    shown = SENSITIVITIES[VOLTAGE] * volts[VOLTAGE][-1000:].mean()
    sheet = card.data_sheets()[VOLTAGE]
    allowed = 4.0 * (sheet.gain_uncertainty * 50.0 + sheet.offset_uncertainty)
    assert shown == pytest.approx(50.0, abs=allowed)
    assert card.read() == ({}, {})


def test_card_is_paced_by_its_clock_and_holds_when_its_memory_is_empty() -> None:
    card, clock = make_card(pace=1.0)
    card.write(np.zeros(5_000))
    assert card.read() == ({}, {}), "no time has passed"
    clock.time += 2e-3
    assert len(card.read()[0][VOLTAGE]) == pytest.approx(2_000, abs=1)
    clock.time += 60.0
    assert len(card.read()[0][VOLTAGE]) == pytest.approx(3_000, abs=1), "no more than it has"
    card.write(np.zeros(5_000))
    assert card.read() == ({}, {}), "the clock stood while the memory was empty"
    assert card.underruns == 1


def test_card_is_the_same_however_it_is_read() -> None:
    voltage = 2.0 + np.sin(2e-2 * np.arange(6_000))
    whole, _ = make_card()
    whole.write(voltage)
    expected = whole.read()[0]
    paced, clock = make_card(pace=1.0)
    paced.write(voltage[:4_000])
    paced.write(voltage[4_000:])
    parts = []
    for _ in range(10):
        clock.time += 777e-6
        if volts := paced.read()[0]:
            parts.append(volts[ROD_VELOCITY])
    np.testing.assert_array_equal(np.concatenate(parts), expected[ROD_VELOCITY])


def test_card_refuses_what_it_cannot_take() -> None:
    card, _ = make_card(memory=1_000)
    with pytest.raises(InstrumentError, match="output memory of 1000 samples is full"):
        card.write(np.zeros(1_001))
    for bad in (1.01 * OUTPUT_RANGE, np.nan):
        with pytest.raises(InstrumentError, match="beyond"):
            card.write(np.array([0.0, bad]))


# ---- the driver in a campaign --------------------------------------------------------------------


def carry_out(bench: SimBench | RosBench, plan: RunPlan) -> Performance:
    """Carry out a run and return its final indicators."""
    found = [e.performance for e in bench.run(plan) if isinstance(e, PerformanceReported)]
    return found[-1]


def test_campaign_gives_equal_indicators_with_one_line_changed(
    tmp_path: Path, make_plan: Callable[..., RunPlan], namespace: str
) -> None:
    """The demonstration, shortened: within the uncertainty, though not the same samples."""
    virtual = make_plan("virtual", 0.06, **{"stand.rod_vibrometer.noise_density": 1e-6})
    point = NamedPoint("point", virtual.parameters, Driver("template_driver"))
    plan = plan_run(point, tmp_path / "template")
    expected = carry_out(SimBench(), virtual)
    with RosBench(tmp_path / "logs", namespace=namespace) as bench:
        found = carry_out(bench, plan)
        second = carry_out(bench, plan)
    assert [repr(i) for i in second.indicators] == [repr(i) for i in found.indicators]
    for one in expected.indicators:
        other = found.indicator(one.name)
        assert other.is_available, other.reason
        assert abs(other.value - one.value) < one.uncertainty, one.name
        assert other.value != one.value, "the card rounds the voltage: other samples"
    with RunBag(plan.bag_path) as bag:
        assert not {topic.name for topic in TRUTH_TOPICS} & set(bag.topics)
        assert bag.run_info["driver"] == "template_driver"
        assert not bag.facts.is_simulated
        noise = bag.facts.provenance["nodes"]["driver"]["stand.rod_vibrometer.noise_density"]
    assert noise == 1e-6
    offline = evaluate_bag(plan.bag_path)
    assert [repr(i) for i in offline.indicators] == [repr(i) for i in found.indicators]


def test_driver_gets_what_it_has_parameters_for(make_plan: Callable[..., RunPlan]) -> None:
    from dataclasses import replace

    from imotor_ros.contracts import graph

    plan = make_plan("p", 0.06)
    roles = graph.stand_with("card")
    plan = replace(plan, driver=Driver("card", {"range": 5.0, "seed": 7}))
    declared = ("range", "seed", "expected_readers", "stand.motor.slider.mass", "stand.colour")
    given = parameters_of_nodes(plan, roles, declared)["driver"]
    assert set(given) == {"range", "seed", "expected_readers", "stand.motor.slider.mass"}
    assert (given["range"], given["seed"]) == (5.0, 7), "the campaign's word is the last"
    plan = replace(plan, driver=Driver("card", {"rnage": 5.0}))
    with pytest.raises(UnknownKeyError, match="rnage: is not a parameter of card, expected one of"):
        parameters_of_nodes(plan, roles, declared)

"""The campaign of figure 12 covers the grid, and every run is long enough."""

from itertools import product
from pathlib import Path

import pytest

from imotor_ros.campaign.campaign import Campaign, load_campaign
from imotor_ros.core.friction import VelocityDependentFriction
from imotor_ros.core.model import predict
from imotor_ros.core.slider import LoadParameters, SliderParameters

FILE = Path(__file__).parents[2] / "params" / "campaigns" / "paper.yaml"


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return load_campaign(FILE)


def test_points_are_those_of_figure_12(campaign: Campaign) -> None:
    signals = [point.parameters.signal for point in campaign.points]
    found = [(one.harmonics, one.maximum_frequency) for one in signals]
    assert found == list(product((2, 3, 4), (2312.5, 4625.0, 9250.0, 18500.0)))
    assert {one.stroke for one in signals} == {15e-6}


@pytest.mark.parametrize("number", range(12))
def test_times_and_stops_follow_the_rule_in_the_file(campaign: Campaign, number: int) -> None:
    parameters = campaign.points[number].parameters
    motion = parameters.signal.motion
    model = predict(motion, SliderParameters(), VelocityDependentFriction(), LoadParameters.free())
    free = max(40 * motion.period, 4 * (model.start_up_time or 0.0), 0.030)
    load = max(60 * motion.period, 0.060)
    # times are rounded to 1 ms, stops to two digits
    assert parameters.drive.hold_time == pytest.approx(free + load, abs=0.6e-3)
    stop = parameters.stand.motor.load.upper_stop
    assert stop == pytest.approx(model.mean_velocity * free, rel=0.05)

"""Campaigns on another driver: one line of the file says which, and the run id tells them apart."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.campaign.campaign import campaign_from_mapping, load_campaign
from imotor_ros.campaign.driver import Driver
from imotor_ros.campaign.plan import plan_run, run_id_of
from imotor_ros.campaign.runner import run_campaign
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.errors import BadInputError, UnreadableFileError

CAMPAIGNS = Path(__file__).parents[2] / "params" / "campaigns"
EPOCH_2020 = 1_577_836_800 * 10**9


def test_one_line_changes_the_driver_and_the_run_id_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "stands").mkdir()
    (tmp_path / "campaigns").mkdir()
    shutil.copy(CAMPAIGNS.parent / "stands" / "paper.yaml", tmp_path / "stands")
    changed = tmp_path / "campaigns" / "demo.yaml"
    changed.write_text("driver: template_driver\n" + (CAMPAIGNS / "demo.yaml").read_text())
    plain, other = load_campaign(CAMPAIGNS / "demo.yaml"), load_campaign(changed)
    assert plain.driver.is_virtual
    assert other.driver.executable == "template_driver"
    assert [p.parameters for p in other.points] == [p.parameters for p in plain.points]
    assert run_id_of(other.points[0]) != run_id_of(plain.points[0])
    assert campaign_from_mapping(other.to_mapping()) == other
    plan = plan_run(other.points[0], Path("p"))
    assert plan.driver == other.driver
    assert plan.run_info["driver"] == "template_driver"
    assert "driver" not in plan_run(plain.points[0], Path("p")).run_info


def test_parameters_come_from_a_file_beside_the_campaign(tmp_path: Path) -> None:
    """Plain, with dotted names, or as the file that `--ros-args --params-file` takes."""
    (tmp_path / "c.yaml").write_text("driver: lab/card\ndriver_parameters: card.yaml\n")
    for text in (
        "card: {range: 10.0}\n",
        "card.range: 10.0\n",
        "/**:\n  ros__parameters:\n    card: {range: 10.0}\n",
        "ros__parameters: {card.range: 10.0}\n",
    ):
        (tmp_path / "card.yaml").write_text(text)
        assert load_campaign(tmp_path / "c.yaml").driver == Driver("lab/card", {"card.range": 10.0})
    (tmp_path / "card.yaml").unlink()
    with pytest.raises(UnreadableFileError, match=r"card\.yaml: No such file"):
        load_campaign(tmp_path / "c.yaml")


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"driver": ""}, "campaign: driver: is no driver, got '', expected \"virtual\""),
        ({"driver": 3}, "campaign: driver: is no driver, got 3"),
        ({"driver": "a/b/c"}, "campaign: driver: is no driver, got 'a/b/c'"),
        ({"driver_parameters": {"x": 1}}, "driver_parameters: has no driver that takes it"),
        ({"driver": "d", "driver_parameters": [1]}, "driver_parameters: is not a mapping"),
        ({"driver": "d", "driver_parameters": {"x": None}}, "driver_parameters: x: has no value"),
        (
            {"driver": "d", "driver_parameters": {n: {"ros__parameters": {}} for n in "ab"}},
            "driver_parameters: has parameters of several nodes",
        ),
    ],
)
def test_what_no_driver_can_be_is_refused(mapping: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError) as caught:
        campaign_from_mapping(mapping)
    assert message in str(caught.value)


def test_bench_without_nodes_refuses_a_driver(tmp_path: Path) -> None:
    campaign = campaign_from_mapping({"driver": "template_driver"})
    with pytest.raises(BadInputError, match="driver: is a node of its own") as caught:
        list(run_campaign(campaign, SimBench(), tmp_path))
    assert "'template_driver'" in str(caught.value)
    assert '"ros"' in str(caught.value)


class _NoBench:
    """Takes note of the plans it is given."""

    name = "none"

    def __init__(self) -> None:
        self.plans: list[Any] = []

    def excite(self, plan: Any, request: Any) -> Any:
        """Find the voltage as the bench in this process does, with the virtual motor."""
        return (yield from SimBench().excite(replace(plan, driver=Driver()), request))

    def run(self, plan: Any) -> Any:
        """Take note."""
        self.plans.append(plan)
        return iter(())


def test_run_on_a_driver_has_the_time_of_the_real_world(tmp_path: Path) -> None:
    point = {"drive": {"hold_time": 0.02}, "excitation": "linear"}
    epochs = {}
    for name in ("virtual", "lab/card"):
        bench = _NoBench()
        campaign = campaign_from_mapping({"driver": name, "point": point})
        list(run_campaign(campaign, bench, tmp_path / name))  # type: ignore[arg-type]
        epochs[name] = bench.plans[0].program.epoch
    assert epochs["virtual"] < EPOCH_2020 < epochs["lab/card"]

"""The friction of the models is identified by a run of its own, where a campaign asks for it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.campaign import measurement, own_friction, tasks
from imotor_ros.campaign.campaign import Campaign, campaign_from_mapping, load_campaign
from imotor_ros.campaign.excite import excite_run
from imotor_ros.campaign.own_friction import identification_points
from imotor_ros.campaign.plan import plan_run
from imotor_ros.campaign.predictions import predict_point
from imotor_ros.campaign.results import law_from_mapping
from imotor_ros.campaign.runner import run_campaign
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.errors import BadInputError, RunError

DRIVE = {"steps": 6, "step_time": 12e-3, "lowest_amplitude": 0.4e-6, "corrections": 1}
PARAMS = Path(__file__).parents[2] / "params"


def campaign(**more: Any) -> Campaign:
    point = {"drive.hold_time": 0.01, "report_interval": 0.0, "excitation": "linear"}
    mapping = {"name": "own", "point": point, "sweep": {"signal.harmonics": [2, 3]}, **more}
    return campaign_from_mapping({"identification": DRIVE, **mapping})


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Results of a campaign in one process, and the same in two."""
    folder = tmp_path_factory.mktemp("own")
    for jobs in (1, 2):
        with SimBench() as bench:
            list(run_campaign(campaign(), bench, folder / str(jobs), jobs=jobs))
    one, two = ((folder / name / "results.json").read_text() for name in "12")
    return {"one": one, "two": two, **json.loads(one)}


def test_identified_laws_are_near_those_of_the_virtual_motor(results: dict[str, Any]) -> None:
    (found,) = results["identifications"]
    assert (found["name"], found["status"]) == ("identification", "done")
    assert found["points"] == ["harmonics-2", "harmonics-3"]
    line, constant = found["models"]["model_2"], found["models"]["model_1"]
    assert (constant["law"], line["law"]) == ("coulomb", "velocity")
    # calibration errors of the heads are about one per cent; few steps add as much
    assert line["sliding_force"] == pytest.approx(0.940, rel=0.04)
    assert line["slope"] == pytest.approx(2.213, rel=0.08)
    assert line["sliding_force"] != 0.940
    assert 0.94 < constant["sliding_force"] < 1.2


def test_models_predict_by_the_identified_laws(results: dict[str, Any]) -> None:
    (found,) = results["identifications"]
    laws = {name: law_from_mapping(one) for name, one in found["models"].items()}
    for point, one in zip(campaign().points, results["points"], strict=True):
        assert one["predictions"] == predict_point(point.parameters, laws)
        assert one["predictions"] != predict_point(point.parameters)


def test_results_do_not_depend_on_the_number_of_processes(results: dict[str, Any]) -> None:
    assert results["one"] == results["two"]


def test_each_stand_has_its_run_whatever_load_and_seed() -> None:
    swept = {"stand.motor.slider.mass": [5e-3, 7e-3], "seed": [1, 2]}
    swept["stand.motor.load.upper_stop"] = [1e-3, 2e-3]
    runs = identification_points(campaign(sweep=swept))
    assert [run.name for run, _ in runs] == ["identification", "identification_2"]
    assert [len(points) for _, points in runs] == [4, 4]
    assert [run.parameters.stand.motor.slider.mass for run, _ in runs] == [5e-3, 7e-3]
    assert identification_points(campaign(identification=None)) == []


def test_failed_identification_leaves_the_points_without_models(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, instant_bench: Any
) -> None:
    def fail(_: Path) -> dict[str, Any]:
        raise RunError("no friction law: it sticks")

    monkeypatch.setattr(tasks, "identify_models", fail)
    monkeypatch.setattr(tasks, "measure_run", _instantly)
    list(run_campaign(campaign(), instant_bench(), tmp_path))
    content = json.loads((tmp_path / "results.json").read_text())
    assert content["identifications"][0]["error"] == "no friction law: it sticks"
    assert [one["status"] for one in content["points"]] == ["done", "done"]
    assert [one["predictions"] for one in content["points"]] == [{}, {}]


def _instantly(plan: Any, bench: Any) -> Iterator[Any]:
    for event in bench.run(plan):
        yield event
    return event.performance, ""


def test_campaign_takes_the_steps_from_a_file_or_as_they_are(tmp_path: Path) -> None:
    short = load_campaign(PARAMS / "campaigns" / "friction_short.yaml")
    paper = load_campaign(PARAMS / "campaigns" / "paper.yaml")
    assert paper.identification == short.points[0].parameters.drive
    assert campaign_from_mapping(paper.to_mapping()) == paper
    (tmp_path / "steady.yaml").write_text("name: steady\npoint: {drive: {hold_time: 1.0}}\n")
    (tmp_path / "c.yaml").write_text("name: c\nidentification: steady.yaml\n")
    with pytest.raises(BadInputError, match=r"steady\.yaml: is not driven by a stepped sine"):
        load_campaign(tmp_path / "c.yaml")
    with pytest.raises(BadInputError, match="identification"):
        campaign(identification={"stepps": 3})
    assert own_friction.FOLDER == "identification"


def test_trials_without_bags_find_the_same_voltages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a bench plays without recording it is what it would have recorded."""
    ((run, _),) = identification_points(campaign())

    def program() -> object:
        steps = excite_run(plan_run(run, tmp_path / "run"), SimBench())
        while True:
            try:
                next(steps)
            except StopIteration as end:
                return end.value.program

    found = program()
    assert not (tmp_path / "run" / "trials").exists()
    monkeypatch.setattr(measurement, "TrialPlayer", int)
    assert program() == found
    assert (tmp_path / "run" / "trials").exists()

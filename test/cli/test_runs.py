"""The verbs around runs and bags: run, demo, evaluate, info, recover, replay."""

from __future__ import annotations

import dataclasses
import json
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.bag.evaluate import evaluate_bag
from imotor_ros.campaign import sim_bench
from imotor_ros.campaign.bench import PerformanceReported, PhaseEntered
from imotor_ros.cli import demo
from imotor_ros.core.indicators import Performance
from imotor_ros.errors import DriveFaultError

Imotor = Callable[..., Any]


# ---- run ---------------------------------------------------------------------------------------


def test_run_prints_one_object_with_all_points(
    imotor: Imotor, campaign_file: Path, tmp_path: Path
) -> None:
    output = tmp_path / "out"
    answer = imotor("run", campaign_file, "--bench", "sim", "--output", output, "--json")
    assert answer.code == 0
    content = answer.json
    assert content["output"] == str(output)
    stored = json.loads(Path(content["results"]).read_text())["points"]
    assert [point["name"] for point in content["points"]] == ["seed-1", "seed-2"]
    for shown, kept in zip(content["points"], stored, strict=True):
        assert shown["performance"] == kept["performance"]
        assert evaluate_bag(shown["bag"]).to_mapping() == kept["performance"]
    lines = sorted(answer.err.splitlines())  # they run at the same time: either may end first
    assert [line.split(",")[0] for line in lines] == ["seed-1 (1/2): done", "seed-2 (2/2): done"]


def test_run_prints_a_table_for_people(imotor: Imotor, results_folder: Path,
                                       campaign_file: Path) -> None:  # fmt: skip
    options = ("--bench", "sim", "--output", results_folder, "--resume")
    answer = imotor("run", campaign_file, *options)
    assert answer.code == 0
    assert answer.out.count("steady-state velocity") == 2
    assert "model 1" in answer.out
    assert ", 0 lost" in answer.out
    assert f"results: {results_folder / 'results.json'}" in answer.out
    assert answer.err == "", "both points had been done"


def test_run_writes_nothing_over(imotor: Imotor, results_folder: Path,
                                 campaign_file: Path) -> None:  # fmt: skip
    before = (results_folder / "results.json").read_bytes()
    answer = imotor("run", campaign_file, "--bench", "sim", "--output", results_folder)
    assert answer.code == 2
    assert f"{results_folder}: holds results already, expected a new folder, or --resume" in (
        answer.error
    )
    assert (results_folder / "results.json").read_bytes() == before


def test_resume_needs_a_folder(imotor: Imotor, campaign_file: Path) -> None:
    answer = imotor("run", campaign_file, "--bench", "sim", "--resume")
    assert answer.code == 2
    assert answer.error == "--resume: needs --output"


def test_default_output_is_a_new_folder_below_results(
    imotor: Imotor, campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    content = imotor("run", campaign_file, "--bench", "sim", "--json").json
    assert content["output"].startswith("results/short-2")
    assert (tmp_path / content["results"]).is_file()


def test_failed_point_is_code_1_and_the_others_are_shown(
    imotor: Imotor, campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = sim_bench.SimBench.run

    def run(self: sim_bench.SimBench, plan: Any) -> Any:
        if plan.name == "seed-1":
            raise DriveFaultError("plant: the amplifier tripped")
        yield from original(self, plan)

    monkeypatch.setattr(sim_bench.SimBench, "run", run)
    output = tmp_path / "out"
    one = ("--bench", "sim", "--jobs", 1)  # where the patch is
    answer = imotor("run", campaign_file, *one, "--output", output, "--json")
    assert answer.code == 1
    assert [point["status"] for point in answer.json["points"]] == ["failed", "done"]
    assert "plant: the amplifier tripped" in answer.err
    again = imotor("run", campaign_file, *one, "--output", output, "--resume")
    assert again.code == 1
    assert "failed: plant: the amplifier tripped" in again.out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nmae: x", "c.yaml: nmae: is not a key of a campaign"),
        ("point: {drive: {hold_time: 0}}", "DriveParameters.hold_time: is out of bounds, got 0"),
        ("name: [", "c.yaml: does not parse"),
    ],
)
def test_bad_campaign_is_code_2(imotor: Imotor, tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "c.yaml").write_text(text)
    answer = imotor("run", tmp_path / "c.yaml", "--bench", "sim", "--output", tmp_path / "out")
    assert answer.code == 2
    assert message in answer.error
    assert not (tmp_path / "out").exists()


def test_output_that_cannot_be_made_is_code_2(
    imotor: Imotor, campaign_file: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    output = tmp_path / "file" / "out"
    answer = imotor("run", campaign_file, "--bench", "sim", "--output", output)
    assert answer.code == 2
    assert f"{output}: cannot be made: Not a directory" in answer.error


def test_interrupted_run_says_how_to_go_on(
    imotor: Imotor, campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(self: sim_bench.SimBench, plan: Any) -> Any:
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(sim_bench.SimBench, "run", run)
    output = ("--output", tmp_path / "out")
    answer = imotor("run", campaign_file, "--bench", "sim", "--jobs", 1, *output)
    assert answer.code == 130
    assert f"go on with: --output {tmp_path / 'out'} --resume" in answer.err
    assert "interrupted" in answer.err
    assert answer.out == ""


# ---- demo --------------------------------------------------------------------------------------


def test_demo_leaves_results_bag_and_picture(imotor: Imotor, tmp_path: Path) -> None:
    answer = imotor("demo", "--bench", "sim", "--output", tmp_path / "out", "--json")
    assert answer.code == 0
    point = answer.json["points"][0]
    final = Performance.from_mapping(point["performance"])
    assert all(one.is_available for one in final.indicators), final.indicators
    assert (tmp_path / "out" / "run.png").read_bytes().startswith(b"\x89PNG")
    assert Path(point["bag"], "metadata.yaml").is_file()


def test_picture_that_cannot_be_drawn_is_code_1_beside_the_results(
    imotor: Imotor, campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "find_params", lambda _: campaign_file)
    (tmp_path / "run.png").mkdir()
    answer = imotor("demo", "--bench", "sim", "--output", tmp_path, "--json")
    assert answer.code == 1
    assert [point["status"] for point in answer.json["points"]] == ["done", "done"]
    last = answer.err.splitlines()[-1]
    assert last == f"error: {tmp_path / 'run.png'}: cannot be written: Is a directory"


# ---- evaluate, info, recover ---------------------------------------------------------------------


def test_evaluate_gives_the_indicators_of_the_run(
    imotor: Imotor, bag: Path, results_folder: Path
) -> None:
    answer = imotor("evaluate", bag, "--json")
    assert answer.code == 0
    stored = json.loads((results_folder / "results.json").read_text())["points"][0]
    assert answer.json == {"bag": str(bag), **stored["performance"]}
    table = imotor("evaluate", bag)
    assert "mm/s" in table.out
    assert table.code == 0


def test_info_describes_the_run(imotor: Imotor, bag: Path) -> None:
    content = imotor("info", bag, "--json").json
    assert content["end_state"] == "completed"
    assert content["run_info"]["parameters"]["seed"] == 1
    assert content["provenance"], "versions and host"
    text = imotor("info", bag).out
    assert "completed" in text


def test_recover_leaves_a_whole_bag_alone(imotor: Imotor, bag: Path) -> None:
    content = imotor("recover", bag, "--json").json
    assert content["was_whole"] is True
    assert imotor("recover", bag).out == f"{bag}: nothing to mend\n"


def test_recover_mends_a_copy_that_was_cut(imotor: Imotor, bag: Path, tmp_path: Path) -> None:
    broken = tmp_path / "bag"
    shutil.copytree(bag, broken)
    file = broken / "bag.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    (broken / "metadata.yaml").unlink()
    content = imotor("recover", broken, "--output", tmp_path / "mended", "--json").json
    assert content["was_whole"] is False
    assert content["samples"]["rod/velocity"] >= 10_000
    evaluated = imotor("evaluate", tmp_path / "mended", "--json")
    assert evaluated.code == 0
    assert evaluated.json["is_final"] is False
    in_place = imotor("recover", broken)
    assert in_place.code == 0
    assert "the damaged file is kept as" in in_place.out
    assert imotor("info", broken, "--json").json["end_state"] == "recovered"


@pytest.mark.parametrize("verb", ["evaluate", "info", "recover", "replay"])
def test_what_is_no_bag_is_code_2(imotor: Imotor, verb: str, tmp_path: Path) -> None:
    if verb == "replay":
        pytest.importorskip("rclpy", reason="needs ROS 2")
    (tmp_path / "text").write_text("no bag")
    (tmp_path / "empty").mkdir()
    for name in ("nothing", "text", "empty"):
        for extra in ([], ["--json"]):
            answer = imotor(verb, tmp_path / name, *extra)
            assert answer.code == 2
            assert str(tmp_path / name) in answer.error


# ---- replay --------------------------------------------------------------------------------------


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch, bag: Path) -> list[Performance]:
    """Put the evaluation of the bag in place of the nodes; test/nodes replays on real ones."""
    replay = pytest.importorskip("imotor_ros.nodes.replay", reason="needs ROS 2")
    final = evaluate_bag(bag)
    said = [dataclasses.replace(final, is_final=False), final]

    def play(path: Path, logs: Path) -> Any:
        assert logs.is_dir()
        yield PhaseEntered("replay")
        yield from map(PerformanceReported, said)

    monkeypatch.setattr(replay, "replay", play)
    return said


def test_replay_prints_the_last_word_of_the_evaluator(
    imotor: Imotor, bag: Path, played: list[Performance]
) -> None:
    answer = imotor("replay", bag, "--json")
    assert answer.code == 0
    assert answer.json == {"bag": str(bag), **played[-1].to_mapping()}
    assert imotor("replay", bag).out == imotor("evaluate", bag).out


def test_replay_without_a_word_is_code_1(
    imotor: Imotor, bag: Path, played: list[Performance]
) -> None:
    played.clear()
    answer = imotor("replay", bag, "--json")
    assert answer.code == 1
    assert answer.error == "the evaluator reported nothing"


def test_namespace_is_for_nodes(imotor: Imotor, campaign_file: Path, tmp_path: Path) -> None:
    answer = imotor(
        "run", campaign_file, "--bench", "sim", "--namespace", "mine", "--output", tmp_path / "out"
    )
    assert answer.code == 2
    assert "--namespace: is for nodes" in answer.error
    assert not (tmp_path / "out").exists()
    for bench, jobs in (("sim", 0), ("ros", 2)):
        answer = imotor(
            "run", campaign_file, "--bench", bench, "--jobs", jobs, "--output", tmp_path / "out"
        )
        assert answer.code == 2
        assert "--jobs: is out of bounds" in answer.error
        assert not (tmp_path / "out").exists()
    answer = imotor("run", tmp_path / "missing.yaml", "--bench", "sim", "--jobs", 0)
    assert "--jobs: is out of bounds" in answer.error, "before the campaign is read"


# ---- progress ------------------------------------------------------------------------------------


def test_no_thread_of_the_progress_bar_is_left(
    imotor: Imotor, campaign_file: Path, tmp_path: Path
) -> None:
    before = threading.active_count()
    imotor("run", campaign_file, "--bench", "sim", "--output", tmp_path / "out")
    assert threading.active_count() == before

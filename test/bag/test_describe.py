from __future__ import annotations

import json
import subprocess
from pathlib import Path

import imotor_ros
from imotor_ros.bag import provenance as origin
from imotor_ros.bag.describe import describe
from imotor_ros.bag.provenance import provenance


def test_description_is_json_and_says_what_the_bag_holds(stand_run, tmp_path):
    run = stand_run()
    path = run.write(tmp_path / "bag", provenance=provenance())
    found = json.loads(json.dumps(describe(path).to_mapping(), allow_nan=False))
    assert found["run_id"] == "run-1"
    assert found["end_state"] == "completed"
    assert found["damage"] == ""
    assert found["start"] == "2000-01-01T00:00:00.000000000Z"
    assert found["size"] == (path / "bag.mcap").stat().st_size
    assert found["messages"]["rod/velocity"] == 5
    counts = {"received": 500, "lost": 0, "rejected": 0}
    assert found["streams"]["rod/velocity"] == {**counts, "flags": [], "sample_rate": 1e6}
    assert found["channels"]["load/force"]["unit"] == "N"
    assert found["program"]["segments"] == [{"label": "hold", "length": 500}]
    assert found["run_info"] == run.info
    assert found["provenance"]["versions"]["imotor_ros"] == imotor_ros.__version__
    assert found["result"] == {"verdict": "good"}


def test_description_in_words_names_losses_and_flags(stand_run, tmp_path):
    run = stand_run()
    path = tmp_path / "bag"
    from dataclasses import replace

    from imotor_ros.bag.writer import RunWriter

    flagged = run.block_message(replace(run.block("slider/velocity", 3), flags=3))
    with RunWriter(path, run_id="run-1", run_info={}) as writer:
        writer.write("slider/velocity", flagged.data, flagged.time)
    text = str(describe(path))
    assert "slider/velocity: 100 samples at 1e+06 Hz, 300 lost, OVER_RANGE DROP_OUT" in text


def test_unfinished_bag_is_described(stand_run, tmp_path):
    path = stand_run(blocks=10, size=1000).write(tmp_path / "bag")
    content = (path / "bag.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) // 2])
    found = describe(tmp_path / "cut.mcap")
    assert found.end_state == "unfinished"
    assert "its end is missing" in str(found)
    assert 0 < found.streams["rod/velocity"]["received"] < 10_000


def git(folder, *arguments):
    subprocess.run(
        ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(folder), *arguments],
        check=True,
        capture_output=True,
    )


def test_provenance_tells_revision_and_changes_of_a_checkout(tmp_path, monkeypatch):
    monkeypatch.setattr("imotor_ros.__file__", str(tmp_path / "imotor_ros" / "__init__.py"))
    assert provenance()["revision"] is None
    git(tmp_path, "init", "-q")
    (tmp_path / "file").write_text("one")
    git(tmp_path, "add", "file")
    git(tmp_path, "commit", "-q", "-m", "first")
    found = provenance()
    assert len(found["revision"]) == 40
    assert found["is_dirty"] is False
    (tmp_path / "file").write_text("two")
    assert provenance()["is_dirty"] is True


def test_provenance_does_without_git(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(origin.Path, "exists", lambda _: True)
    found = provenance()
    assert (found["revision"], found["is_dirty"]) == (None, None)
    assert found["versions"]["rosbags"].startswith("0.11")
    assert json.loads(json.dumps(found)) == found
    assert Path(imotor_ros.__file__).is_file()

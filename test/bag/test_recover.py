from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from imotor_ros.bag import recover as recovery
from imotor_ros.bag.describe import describe
from imotor_ros.bag.layout import METADATA, UNFINISHED
from imotor_ros.bag.reader import RunBag
from imotor_ros.bag.recover import recover
from imotor_ros.bag.writer import RunWriter
from imotor_ros.contracts import topics
from imotor_ros.errors import BadInputError, RecordingError, UnreadableFileError

PROCESS = Path(__file__).with_name("recorder_process.py")
ROOT = Path(__file__).resolve().parents[2]
SAMPLED = [topic.name for topic in topics.ALL_TOPICS if topics.is_sampled(topic)]


def messages_of(path, **options):
    with RunBag(path, **options) as bag:
        return [(m.topic, m.time, m.data) for m in bag.messages()]


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def truncated(source, target, size):
    """Copy a bag as its recorder would have left it, had it been killed after `size` bytes."""
    shutil.copytree(source, target)
    file = next(target.glob("*.mcap"))
    os.truncate(file, size)
    (target / METADATA).unlink()
    marker = {"imotor_schema": "1", "imotor_run_id": "run-1", "imotor_run_info": '{"seed": 1}'}
    (target / UNFINISHED).write_text(json.dumps(marker))
    return target


@pytest.fixture(scope="module", params=[True, False], ids=["zstd", "plain"])
def whole(request, stand_run, tmp_path_factory):
    """A bag of several chunks, and its messages."""
    path = tmp_path_factory.mktemp("whole") / "bag"
    stand_run(blocks=12, size=2000).write(path, is_compressed=request.param)
    return path, messages_of(path)


# ---- a recorder that is really killed --------------------------------------------------------


@pytest.mark.parametrize("compression", ["zstd", "plain"])
@pytest.mark.parametrize("committed", ["open", "150", "written"])
def test_killed_recorder_loses_no_committed_message(tmp_path, stand_run, committed, compression):
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH')}"}
    process = subprocess.Popen(
        [sys.executable, str(PROCESS), str(tmp_path / "bag"), "60", "500", compression],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    assert process.stdout is not None
    seen = 0
    for line in process.stdout:
        if line.strip().isdigit():
            seen = int(line)
        if line.strip() == committed:
            break
    process.kill()
    process.communicate()

    with pytest.raises(UnreadableFileError, match="imotor recover"):
        RunBag(tmp_path / "bag")
    assert describe(tmp_path / "bag").end_state == "unfinished"
    report = recover(tmp_path / "bag")
    run = stand_run(blocks=60, size=500)
    sent = [(m.topic, m.time + i, m.data) for i, m in enumerate(run.in_order())]
    found = messages_of(tmp_path / "bag")
    assert len(found) >= seen
    assert found == sent[: len(found)]
    assert report.messages == len(found)
    with RunBag(tmp_path / "bag") as bag:
        assert bag.end_state == "recovered"
        assert bag.run_info == run.info
        assert bag.facts.provenance == {"host": "here"}
        for name in SAMPLED:
            samples, _, first = bag.samples(name)
            assert first == 0
            assert len(samples) == report.samples[name]
            assert np.array_equal(samples, run.samples(name)[: len(samples)])
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == len(found)


# ---- files cut off or spoilt in all places ---------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_cut_file_gives_back_a_beginning_of_the_run(whole, tmp_path, seed):
    source, messages = whole
    full = next(source.glob("*.mcap")).stat().st_size
    size = random.Random(seed).randrange(full)
    target = truncated(source, tmp_path / "bag", size)
    report = recover(target)
    found = messages_of(target)
    assert not report.was_whole
    assert found == messages[: len(found)]
    if not is_compressed(source):  # all is saved but the message that was cut, and the topics
        assert sum(len(data) for _, _, data in found) >= min(size, 1_700_000) - 50_000
    assert recover(target).was_whole
    assert messages_of(target) == found


def is_compressed(path):
    return next(path.glob("*.mcap")).stat().st_size < 1_000_000


def test_more_of_the_file_never_gives_fewer_messages(whole, tmp_path):
    source, messages = whole
    full = next(source.glob("*.mcap")).stat().st_size
    counts = []
    for number, size in enumerate(np.linspace(0, full - 1, 8, dtype=int)):
        target = truncated(source, tmp_path / f"cut-{number}", int(size))
        counts.append(recover(target).messages)
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] == len(messages)


@pytest.mark.parametrize("seed", range(4))
def test_garbage_tail_is_left_off(whole, tmp_path, seed):
    source, _ = whole
    rng = random.Random(seed)
    file = next(source.glob("*.mcap"))
    size = rng.randrange(file.stat().st_size)
    target = truncated(source, tmp_path / "bag", size)
    clean = messages_of(target, allow_damaged=True)
    tail = bytes(5000) if seed % 2 else rng.randbytes(5000)
    with next(target.glob("*.mcap")).open("ab") as stream:
        stream.write(tail)
    recover(target)
    found = messages_of(target)
    if is_compressed(source):  # a chunk that fails its checksum is not trusted at all
        assert found == clean[: len(found)]
        assert sum(len(data) for _, _, data in clean[len(found) :]) < 2**20 + 20_000
    else:  # without checksum, garbage may complete the message that was cut
        assert found[: len(clean)] == clean
        assert len(found) <= len(clean) + 1


def test_tail_after_the_end_of_a_whole_file_is_left_off(whole, tmp_path):
    source, messages = whole
    shutil.copytree(source, tmp_path / "bag")
    with next((tmp_path / "bag").glob("*.mcap")).open("ab") as stream:
        stream.write(b"tail")
    assert not recover(tmp_path / "bag").was_whole
    assert messages_of(tmp_path / "bag") == messages


def test_flipped_bit_in_a_compressed_chunk_costs_that_chunk_only(stand_run, tmp_path):
    path = stand_run(blocks=40, size=5000).write(tmp_path / "bag")
    before = messages_of(path)
    file = next(path.glob("*.mcap"))
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x10
    file.write_bytes(content)
    with pytest.raises(UnreadableFileError, match="is damaged at byte"):
        messages_of(path)
    report = recover(path)
    found = messages_of(path)
    assert set(found) < set(before)
    assert len(before) - len(found) <= 30  # 1 MiB in messages of 40 kB
    assert "does not unpack" in report.damage
    assert sum(report.lost.values()) > 0
    with RunBag(path) as bag:
        lost = {name: count["lost"] for name, count in bag.stream_counts.items()}
        assert lost == report.lost
        hurt = max(lost, key=lost.__getitem__)
        samples, _, _ = bag.samples(hurt, allow_gaps=True)
        assert np.isnan(samples).sum() == lost[hurt]


# ---- odd bags --------------------------------------------------------------------------------


def test_whole_bag_is_left_alone(whole, tmp_path):
    source, _ = whole
    shutil.copytree(source, tmp_path / "bag")
    before = {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in (tmp_path / "bag").iterdir()}
    report = recover(tmp_path / "bag")
    after = {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in (tmp_path / "bag").iterdir()}
    assert report.was_whole
    assert str(report).endswith("nothing to mend")
    assert before == after


@pytest.mark.parametrize("content", [None, "", "not: a bag", "a: [1"])
def test_missing_or_broken_metadata_are_written_anew(whole, tmp_path, content):
    source, messages = whole
    shutil.copytree(source, tmp_path / "bag")
    target = tmp_path / "bag" / METADATA
    before = target.read_text()
    target.unlink()
    if content is not None:
        target.write_text(content)
    assert messages_of(tmp_path / "bag") == messages  # readable all the same
    assert not recover(tmp_path / "bag").was_whole
    assert target.read_text() == before
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == len(messages)
    assert recover(tmp_path / "bag").was_whole


def test_empty_file_beside_its_marker_becomes_an_empty_bag(whole, tmp_path):
    target = truncated(whole[0], tmp_path / "bag", 0)
    assert recover(target).messages == 0
    with RunBag(target) as bag:
        assert bag.run_id == "run-1"
        assert len(bag.topics) == len(topics.ALL_TOPICS)
        assert bag.times == (0, 0)


def test_empty_file_alone_cannot_be_mended(tmp_path):
    (tmp_path / "run.mcap").write_bytes(b"")
    with pytest.raises(UnreadableFileError, match="holds nothing of a run"):
        recover(tmp_path / "run.mcap")
    assert names_in(tmp_path) == ["run.mcap"]


def test_file_without_its_folder_is_mended_in_place(whole, tmp_path, stand_run):
    source, messages = whole
    content = next(source.glob("*.mcap")).read_bytes()
    (tmp_path / "moved.mcap").write_bytes(content[: len(content) * 3 // 4])
    report = recover(tmp_path / "moved.mcap")
    assert names_in(tmp_path) == ["moved.mcap", "moved.mcap.damaged"]
    found = messages_of(tmp_path / "moved.mcap")
    assert found == messages[: len(found)]
    assert report.messages == len(found) > 0
    with RunBag(tmp_path / "moved.mcap") as bag:  # from the run/info message
        assert bag.run_info == stand_run().info


def test_output_leaves_the_original_alone(whole, tmp_path):
    source, _ = whole
    target = truncated(source, tmp_path / "bag", 40_000)
    before = {p.name: p.read_bytes() for p in target.iterdir()}
    report = recover(target, tmp_path / "out")
    assert {p.name: p.read_bytes() for p in target.iterdir()} == before
    assert report.path == str(tmp_path / "out")
    assert report.original == ""
    assert messages_of(tmp_path / "out") == messages_of(target, allow_damaged=True)
    with pytest.raises(BadInputError, match="exists already"):
        recover(target, tmp_path / "out")


@pytest.mark.parametrize("has_metadata", [True, False])
def test_whole_bag_is_copied_to_the_output(whole, tmp_path, has_metadata):
    source, messages = whole
    shutil.copytree(source, tmp_path / "bag")
    if not has_metadata:
        (tmp_path / "bag" / "metadata.yaml").unlink()
    before = names_in(tmp_path / "bag")
    report = recover(tmp_path / "bag", tmp_path / "out")
    assert report.path == str(tmp_path / "out")
    assert report.was_whole == has_metadata
    assert messages_of(tmp_path / "out") == messages
    assert names_in(tmp_path / "out") == names_in(source)
    assert names_in(tmp_path / "bag") == before
    with pytest.raises(BadInputError, match="exists already"):
        recover(tmp_path / "bag", tmp_path / "out")


def test_bag_being_recorded_is_refused(stand_run, tmp_path):
    with RunWriter(tmp_path / "bag", run_id="run-1", run_info={}) as writer:
        message = stand_run().in_order()[0]
        writer.write(message.topic, message.data, message.time)
        with pytest.raises(BadInputError, match="is being recorded"):
            recover(tmp_path / "bag")
        with pytest.raises(UnreadableFileError, match="is being recorded"):
            RunBag(tmp_path / "bag")
    assert recover(tmp_path / "bag").was_whole


# ---- a recovery that is interrupted ----------------------------------------------------------


class Interrupted(BaseException):
    """Stands for the moment at which the recovering process dies."""


STEPS = ["_save", "_keep", "_restore_metadata"]


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("is_done", [False, True], ids=["before", "after"])
def test_interrupted_recovery_leaves_the_bag_as_it_was_or_mended(
    whole, tmp_path, monkeypatch, step, is_done
):
    source, _ = whole
    target = truncated(source, tmp_path / "bag", 60_000)
    damaged = next(target.glob("*.mcap")).read_bytes()
    expected = messages_of(target, allow_damaged=True)
    action = getattr(recovery, step)

    def interrupted(*arguments):
        if is_done:
            action(*arguments)
        raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(recovery, step, interrupted)
        patch.setattr(recovery.shutil, "rmtree", lambda *_, **__: None)  # nobody tidies up
        with pytest.raises(Interrupted):
            recover(target)
    assert messages_of(target, allow_damaged=True) == expected
    recover(target)
    assert messages_of(target) == expected
    assert recover(target).was_whole
    assert names_in(target) == ["bag.mcap", "bag.mcap.damaged", METADATA]
    assert (target / "bag.mcap.damaged").read_bytes() == damaged


def test_recovery_on_a_full_disk_leaves_the_bag_as_it_was(whole, tmp_path, monkeypatch):
    target = truncated(whole[0], tmp_path / "bag", 60_000)
    before = {p.name: p.read_bytes() for p in target.iterdir()}

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("imotor_ros.bag.storage.RunStorage.close_chunk", full)
    with pytest.raises(RecordingError, match="No space left on device"):
        recover(target)
    assert {p.name: p.read_bytes() for p in target.iterdir()} == before

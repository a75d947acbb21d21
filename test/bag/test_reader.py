from __future__ import annotations

import shutil

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from imotor_ros.bag.reader import RunBag
from imotor_ros.bag.types import installed_types
from imotor_ros.bag.writer import RunWriter
from imotor_ros.contracts import topics
from imotor_ros.errors import BadInputError, SamplesLostError, UnreadableFileError

EPOCH = 946_684_800 * 10**9


@pytest.fixture(scope="module")
def path(stand_run, tmp_path_factory):
    return stand_run().write(tmp_path_factory.mktemp("bags") / "bag")


def write_blocks(path, messages):
    with RunWriter(path, run_id="run-1", run_info={}) as writer:
        for number, message in enumerate(messages):
            writer.write(message.topic, message.data, EPOCH + number)
    return path


@pytest.mark.parametrize("name", ["", "bag.mcap", "metadata.yaml"])
def test_bag_is_found_by_its_folder_or_a_file_in_it(path, name):
    with RunBag(path / name) as bag:
        assert bag.run_id == "run-1"


def test_bag_gives_back_what_was_recorded(path, stand_run):
    run = stand_run()
    sent = run.in_order()
    with RunBag(path) as bag:
        assert (bag.run_info, bag.end_state) == (run.info, "completed")
        assert bag.result == {"verdict": "good"}
        assert bag.program == run.program
        assert bag.channels == {channel.name: channel for channel in run.channels}
        assert bag.performance.is_final
        assert [(m.topic, m.data) for m in bag.messages()] == [(m.topic, m.data) for m in sent]
        assert bag.message_counts == {
            topic.name: sum(m.topic == topic.name for m in sent) for topic in topics.ALL_TOPICS
        }
        assert bag.times == (EPOCH, EPOCH + len(sent) - 1)
        assert bag.namespace == "/stand"


def test_messages_of_some_topics_keep_their_order(path):
    wanted = ["drive/progress", "channels", "rod/velocity"]
    with RunBag(path) as bag:
        every = [m for m in bag.messages() if m.topic in wanted]
        assert list(bag.messages(*wanted)) == every


def test_blocks_and_samples_are_those_recorded(path, stand_run):
    run = stand_run()
    with RunBag(path) as bag:
        for topic in topics.MEASURED_TOPICS:
            samples, rate, first = bag.samples(topic.name)
            assert np.array_equal(samples, run.samples(topic.name))
            assert (rate, first) == (1e6, 0)
        blocks = list(bag.blocks())
    assert len(blocks) == run.blocks * 9
    expected = run.block("load/force", 2)
    found = next(b for b in blocks if b.stream == "load/force" and b.sequence == 2)
    assert (found.time, found.first_index, found.unit) == (expected.time, 200, "N")


def test_samples_are_writable_and_aligned_as_kernels_want_them(path):
    with RunBag(path) as bag:
        for block in bag.blocks():
            assert block.samples.flags.writeable
            assert block.samples.flags.aligned
            assert block.samples.flags.c_contiguous


def test_bag_is_read_without_installed_definitions(path, monkeypatch, tmp_path):
    installed_types.cache_clear()
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    monkeypatch.setattr("imotor_ros.__file__", str(tmp_path / "a" / "b.py"))
    with RunBag(path) as bag:
        assert len(bag.samples("rod/velocity")[0]) == 500
        assert bag.program.length == 500


@pytest.mark.parametrize("namespace", ["/", "/lab/stand2", "stand"])
def test_topics_are_named_as_in_the_contracts_whatever_the_namespace(
    stand_run, tmp_path, namespace
):
    stand_run().write(tmp_path / "bag", namespace=namespace)
    with RunBag(tmp_path / "bag") as bag:
        assert set(bag.topics) == {topic.name for topic in topics.ALL_TOPICS}
        assert bag.namespace == "/" + namespace.strip("/")


def test_last_program_counts(stand_run, tmp_path):
    run, cut = stand_run(), stand_run(blocks=2)
    programs = [next(m for m in r.latched() if m.topic == "drive/program") for r in (run, cut)]
    path = write_blocks(tmp_path / "bag", programs)
    with RunBag(path) as bag:
        assert bag.program == cut.program


def test_missing_samples_are_an_error_or_nan(stand_run, tmp_path):
    run = stand_run()
    messages = list(run.stream("rod/velocity"))
    path = write_blocks(tmp_path / "bag", [messages[1], messages[3], messages[4]])
    with RunBag(path) as bag:
        with pytest.raises(SamplesLostError, match="expected sample 200, got sample 300"):
            bag.samples("rod/velocity")
        samples, _, first = bag.samples("rod/velocity", allow_gaps=True)
    assert first == 100
    assert np.array_equal(np.flatnonzero(np.isnan(samples)), np.arange(100, 200))
    assert np.array_equal(samples[200:], run.samples("rod/velocity")[300:])


def test_samples_that_come_twice_are_an_error(stand_run, tmp_path):
    message = next(stand_run().stream("rod/velocity"))
    path = write_blocks(tmp_path / "bag", [message, message])
    with RunBag(path) as bag, pytest.raises(SamplesLostError):
        bag.samples("rod/velocity", allow_gaps=True)


def test_empty_bag_has_topics_but_no_program(tmp_path):
    path = write_blocks(tmp_path / "bag", [])
    with RunBag(path) as bag:
        assert bag.times == (0, 0)
        assert list(bag.blocks()) == []
        assert bag.channels == {}
        assert len(bag.samples("rod/velocity")[0]) == 0
        with pytest.raises(UnreadableFileError, match="holds no message on drive/program"):
            _ = bag.program


def test_unknown_stream_is_bad_input_and_lists_the_known(path):
    with RunBag(path) as bag, pytest.raises(BadInputError, match="rod/velocity"):
        bag.samples("rod/position")


# ---- what is no bag of a run -----------------------------------------------------------------


def test_missing_path_is_named(tmp_path):
    with pytest.raises(UnreadableFileError, match="nowhere: does not exist"):
        RunBag(tmp_path / "nowhere")


def test_folder_and_file_that_are_no_bag(tmp_path):
    with pytest.raises(UnreadableFileError, match="is not the bag of a run"):
        RunBag(tmp_path)
    (tmp_path / "notes.txt").write_text("no bag at all")
    with pytest.raises(UnreadableFileError, match="is not an MCAP file"):
        RunBag(tmp_path / "notes.txt")


def test_cut_bag_names_the_remedy_and_is_read_on_demand(stand_run, tmp_path):
    path = stand_run(blocks=10, size=1000).write(tmp_path / "bag")
    content = (path / "bag.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) // 2])
    with pytest.raises(UnreadableFileError, match=r"its end is missing.*imotor recover"):
        RunBag(tmp_path / "cut.mcap")
    with RunBag(tmp_path / "cut.mcap", allow_damaged=True) as bag:
        assert bag.end_state == "unfinished"
        assert bag.program.length == 10_000
        assert "the file ends within a chunk" in bag.damage
        assert bag.times[0] == EPOCH
        received = bag.stream_counts["rod/velocity"]["received"]
        assert 0 < received < 10_000
        assert received == len(bag.samples("rod/velocity")[0])


def test_bag_of_something_else_is_told_from_that_of_a_run(tmp_path):
    writer = Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:
        types = installed_types()
        writer.add_connection("/x", "std_msgs/msg/Header", typestore=types.store)
    with pytest.raises(UnreadableFileError, match="holds no run"):
        RunBag(tmp_path / "bag")


def test_bag_of_a_newer_version_is_told(stand_run, tmp_path, monkeypatch):
    monkeypatch.setattr("imotor_ros.bag.facts.SCHEMA_VERSION", 2)
    stand_run().write(tmp_path / "bag")
    monkeypatch.undo()
    with pytest.raises(UnreadableFileError, match=r"newer version, got 'schema 2', expected.* 1"):
        RunBag(tmp_path / "bag")


def test_folder_with_two_files_is_refused(path, tmp_path):
    shutil.copytree(path, tmp_path / "bag")
    shutil.copy(path / "bag.mcap", tmp_path / "bag" / "other.mcap")
    with pytest.raises(UnreadableFileError, match=r"bag\.mcap.*other\.mcap"):
        RunBag(tmp_path / "bag")

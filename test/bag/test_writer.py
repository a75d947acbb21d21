from __future__ import annotations

import contextlib
import json
import resource
import shutil
import signal

import numpy as np
import pytest
from rosbags.interfaces import QosDurability, QosHistory, QosReliability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from imotor_ros.bag.layout import UNFINISHED
from imotor_ros.bag.reader import RunBag
from imotor_ros.bag.records import McapFile
from imotor_ros.bag.writer import RunWriter
from imotor_ros.contracts import topics
from imotor_ros.errors import BadInputError, RecordingError

EPOCH = 946_684_800 * 10**9


@pytest.fixture
def make_writer(tmp_path):
    """A maker of the writer of run "run-1"; it is closed when the test ends."""
    made = []

    def make(**options):
        made.append(RunWriter(tmp_path / "bag", run_id="run-1", run_info={"seed": 1}, **options))
        return made[-1]

    yield make
    for writer in made:
        with contextlib.suppress(RecordingError):
            writer.close("test ended")


def write_all(writer, messages):
    for number, message in enumerate(messages):
        writer.write(message.topic, message.data, EPOCH + number)


def test_rosbags_reads_all_topics_with_their_qos(stand_run, tmp_path):
    run = stand_run()
    run.write(tmp_path / "bag", namespace="/lab/stand2")
    with Reader(tmp_path / "bag") as reader:
        found = {c.topic: c for c in reader.connections}
        times = [time for _, time, _ in reader.messages()]
    assert set(found) == {
        name if name.startswith("/") else f"/lab/stand2/{name}"
        for name in (topic.name for topic in topics.ALL_TOPICS)
    }
    assert found["/diagnostics"].msgcount == 0
    assert found["/lab/stand2/channels"].msgcount == 5
    offered = {
        name: (q.history, q.depth, q.reliability, q.durability)
        for name in ("/lab/stand2/rod/velocity", "/lab/stand2/channels", "/diagnostics")
        for q in found[name].ext.offered_qos_profiles
    }
    reliable = QosReliability.RELIABLE
    assert offered == {
        "/lab/stand2/rod/velocity": (QosHistory.KEEP_ALL, 0, reliable, QosDurability.VOLATILE),
        "/lab/stand2/channels": (
            *(QosHistory.KEEP_LAST, 32),
            *(reliable, QosDurability.TRANSIENT_LOCAL),
        ),
        "/diagnostics": (QosHistory.KEEP_LAST, 10, reliable, QosDurability.VOLATILE),
    }
    assert times == sorted(set(times))


def test_definitions_in_the_bag_hash_as_those_of_the_types(stand_run, tmp_path):
    run = stand_run()
    run.write(tmp_path / "bag")
    with Reader(tmp_path / "bag") as reader:
        for connection in reader.connections:
            assert connection.digest == run.types.type_hash(connection.msgtype)


def test_diagnostics_type_is_that_of_the_distribution(stand_run):
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = topics.DIAGNOSTICS.type_name
    assert stand_run().types.type_hash(kind) == store.hash_rihs01(kind)


def test_same_messages_give_the_same_file_whatever_the_provenance(stand_run, tmp_path):
    run = stand_run()
    for name, start in (("a", "2024"), ("b", "2025")):
        run.write(tmp_path / name / "bag", provenance={"start": start, "versions": {}})
    contents = []
    for name in ("a", "b"):
        with RunBag(tmp_path / name / "bag") as bag:
            contents.append([(m.topic, m.time, m.data) for m in bag.messages()])
    assert contents[0] == contents[1]


def test_missing_samples_are_counted_not_refused(make_writer, stand_run, tmp_path):
    messages = list(stand_run(blocks=6, size=100).stream("rod/velocity"))
    writer = make_writer()
    write_all(writer, [messages[0], *messages[3:]])
    writer.close("completed")
    with RunBag(tmp_path / "bag") as bag:
        count = bag.stream_counts["rod/velocity"]
        assert (count["received"], count["lost"], count["rejected"]) == (400, 200, 0)
        assert bag.message_counts["rod/velocity"] == 4


def test_blocks_of_another_run_and_bad_bytes_are_rejected(make_writer, stand_run, tmp_path):
    good, bad = stand_run(), stand_run(run_id="run-2")
    writer = make_writer()
    writer.write("load/force", next(bad.stream("load/force")).data, EPOCH)
    writer.write("load/force", b"\x00\x01no message", EPOCH + 1)
    writer.write("load/force", next(good.stream("load/force")).data, EPOCH + 2)
    writer.close("completed")
    with RunBag(tmp_path / "bag") as bag:
        count = bag.stream_counts["load/force"]
        assert (count["received"], count["lost"], count["rejected"]) == (100, 0, 2)
        assert bag.message_counts["load/force"] == 1


def test_gaps_between_fields_are_zero_in_the_bag(make_writer, stand_run, tmp_path):
    run = stand_run(run_id="run-1")
    message = next(run.stream("rod/velocity"))
    place = message.data.index(b"run-1\0") + 6  # before the sequence number, aligned to 8 bytes
    assert message.data[place : place + 2] == b"\0\0"
    noisy = message.data[:place] + b"\xab\xcd" + message.data[place + 2 :] + b"\0\0"
    writer = make_writer()
    writer.write(message.topic, noisy, EPOCH)
    writer.close("completed")
    with RunBag(tmp_path / "bag") as bag:
        assert [m.data for m in bag.messages()] == [message.data]


def test_metadata_hold_facts_and_their_digest(make_writer, tmp_path):
    info = {"seed": 7, "gain": np.float64(0.5), "bounds": (1, 2), "unknown": float("nan")}
    writer = RunWriter(tmp_path / "b2", run_id="12:30:00", run_info=info, provenance={"host": "x"})
    writer.close("on", {"speed": np.float32(1.5)})
    with RunBag(tmp_path / "b2") as bag:
        assert bag.run_info == {"seed": 7, "gain": 0.5, "bounds": [1, 2], "unknown": None}
        # texts that YAML 1.1 takes for a number and for a truth value
        assert (bag.run_id, bag.end_state) == ("12:30:00", "on")
        assert bag.result == {"speed": 1.5}
        assert bag.facts.provenance == {"host": "x"}
        digest = bag.facts.run_info_digest
    text = (tmp_path / "b2" / "metadata.yaml").read_text()
    assert digest in text
    assert not (tmp_path / "b2" / UNFINISHED).exists()


def test_info_that_json_cannot_hold_is_refused_at_once(tmp_path):
    with pytest.raises(BadInputError, match="run_info: cannot be written as JSON"):
        RunWriter(tmp_path / "bag", run_id="r", run_info={"what": object()})
    assert not (tmp_path / "bag").exists()


def test_result_that_json_cannot_hold_does_not_cost_the_bag(make_writer, tmp_path):
    writer = make_writer()
    with pytest.raises(BadInputError, match="result"):
        writer.close("completed", {"what": object()})
    with RunBag(tmp_path / "bag") as bag:
        assert bag.result is None


def test_existing_folder_is_refused(tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(BadInputError, match="exists already"):
        RunWriter(tmp_path / "bag", run_id="r", run_info={})


def test_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="file/bag: cannot be written: Not a directory"):
        RunWriter(tmp_path / "file" / "bag", run_id="r", run_info={})


def test_time_that_does_not_increase_and_unknown_topic_are_refused(make_writer, stand_run):
    message = next(stand_run().progress())
    writer = make_writer()
    writer.write("drive/progress", message.data, EPOCH)
    with pytest.raises(BadInputError, match="does not increase"):
        writer.write("drive/progress", message.data, EPOCH)
    with pytest.raises(BadInputError, match="has no such topic"):
        writer.write("rod/position", message.data, EPOCH + 1)


def test_exception_in_the_block_becomes_the_end_state(stand_run, tmp_path):
    run = stand_run()

    def record():
        with RunWriter(tmp_path / "bag", run_id="run-1", run_info={}) as writer:
            write_all(writer, run.in_order())
            _ = 1 / 0

    with pytest.raises(ZeroDivisionError):
        record()
    with RunBag(tmp_path / "bag") as bag:
        assert bag.end_state == "failed: ZeroDivisionError: division by zero"
        assert sum(bag.message_counts.values()) == len(run.in_order())


def test_closing_twice_is_closing_once(make_writer, tmp_path):
    writer = make_writer()
    writer.close("completed")
    writer.close("failed: too late")
    with RunBag(tmp_path / "bag") as bag:
        assert bag.end_state == "completed"


# ---- what a killed recorder leaves -----------------------------------------------------------


def in_the_file(path):
    mcap = McapFile(path)
    try:
        return sum(1 for _ in mcap.messages())
    finally:
        mcap.close()


def test_open_chunk_is_written_after_the_interval(make_writer, stand_run):
    now = [0.0]
    writer = make_writer(commit_interval=1.0, clock=lambda: now[0])
    messages = iter(stand_run(blocks=20).stream("rod/velocity"))
    times = iter(range(EPOCH, EPOCH + 100))

    def write():
        message = next(messages)
        writer.write(message.topic, message.data, next(times))

    write()
    assert in_the_file(writer.file) == 0
    now[0] = 0.99
    write()
    assert in_the_file(writer.file) == 0
    now[0] = 1.0
    write()
    assert in_the_file(writer.file) == 3
    write()
    now[0] = 2.5
    writer.commit_if_due()  # by a timer, when nothing more comes
    assert in_the_file(writer.file) == 4


def test_chunk_is_written_when_it_is_full(make_writer, stand_run):
    run = stand_run(blocks=20, size=10_000)  # 80 kB each, chunks of 1 MiB
    writer = make_writer(clock=lambda: 0.0)
    write_all(writer, run.stream("rod/velocity"))
    assert in_the_file(writer.file) == 14


def test_facts_and_topics_are_in_the_file_system_from_the_start(make_writer):
    writer = make_writer()
    facts = json.loads((writer.path / UNFINISHED).read_text())
    assert json.loads(facts["imotor_run_info"]) == {"seed": 1}
    mcap = McapFile(writer.file)
    assert list(mcap.messages()) == []
    assert len(mcap.channels) == len(topics.ALL_TOPICS)
    mcap.close()


# ---- what the disk does ----------------------------------------------------------------------


@contextlib.contextmanager
def file_size_limit(size):
    """Let no file of this process grow beyond a size, as on a full disk."""
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)


def fill_disk(writer, run, limit):
    """Write until the disk is full."""
    with file_size_limit(limit), pytest.raises(RecordingError, match="File too large") as caught:
        write_all(writer, run.stream("rod/velocity"))
    assert str(writer.path) in str(caught.value)
    with pytest.raises(RecordingError):  # and says so again
        writer.write("load/force", next(run.stream("load/force")).data, EPOCH + 10**6)


def test_bag_on_a_full_disk_is_closed_with_its_whole_chunks(make_writer, stand_run, tmp_path):
    run = stand_run(blocks=60, size=10_000)
    writer = make_writer(is_compressed=False, clock=lambda: 0.0)
    fill_disk(writer, run, 3_000_000)  # two chunks of 1.12 MB fit, what ends the file too
    with file_size_limit(3_000_000), pytest.raises(RecordingError):
        writer.close("completed")
    with RunBag(tmp_path / "bag") as bag:
        assert "File too large" in bag.end_state
        samples, _, first = bag.samples("rod/velocity")
        assert (len(samples), first) == (280_000, 0)
        assert np.array_equal(samples, run.samples("rod/velocity")[:280_000])
        assert bag.stream_counts["rod/velocity"]["received"] == 280_000
        assert bag.times == (EPOCH, EPOCH + 27)
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 28
        assert reader.end_time == EPOCH + 28


def test_bag_that_cannot_even_be_closed_keeps_its_whole_chunks(make_writer, stand_run):
    run = stand_run(blocks=60, size=10_000)
    writer = make_writer(is_compressed=False, clock=lambda: 0.0)
    fill_disk(writer, run, 3_000_000)
    size = writer.file.stat().st_size
    with file_size_limit(size + 1000), pytest.raises(RecordingError, match="File too large"):
        writer.close("completed")
    assert writer.file.stat().st_size == size
    assert (writer.path / UNFINISHED).exists()
    assert in_the_file(writer.file) == 28


def test_folder_that_vanishes_is_noticed_at_the_next_chunk(make_writer, stand_run):
    writer = make_writer(clock=lambda: 0.0)
    message = next(stand_run().stream("rod/velocity"))
    writer.write(message.topic, message.data, EPOCH)
    shutil.rmtree(writer.path)
    with pytest.raises(RecordingError, match="the file was removed"):
        writer.commit()
    with pytest.raises(RecordingError):
        writer.close("completed")


def test_folder_that_is_renamed_fails_at_the_end(make_writer, stand_run, tmp_path):
    writer = make_writer()
    write_all(writer, stand_run().in_order())
    (tmp_path / "bag").rename(tmp_path / "elsewhere")
    with pytest.raises(RecordingError, match="No such file or directory"):
        writer.close("completed")
    assert [path.name for path in tmp_path.iterdir()] == ["elsewhere"]

from __future__ import annotations

import random
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imotor_ros.bag.ordering import MessageOrder, OrderedMessage
from imotor_ros.contracts import topics

AWAITED = tuple(
    topic.name
    for topic in topics.ALL_TOPICS
    if topic.intent is topics.Intent.STREAM or topic is topics.PERFORMANCE
)
COUNTS = {topics.RUN_INFO.name: 1, topics.DRIVE_PROGRAM.name: 1, topics.CHANNELS.name: 5}
EVEN_EPOCH = 10**18


@pytest.fixture(scope="module")
def queues(stand_run):
    """The messages of a run by topic, and two publishers of channels."""
    return stand_run(blocks=6, size=50).by_topic()


def feed(queues, shuffle, diagnostics=()):
    """Feed messages in a random interleaving that keeps the order within a topic."""
    order = MessageOrder(AWAITED, COUNTS)
    names = [name for name, queue in queues.items() for _ in queue]
    shuffle.shuffle(names)
    queues = {name: list(queue) for name, queue in queues.items()}
    shuffle.shuffle(queues[topics.CHANNELS.name])  # several publishers: no order within the topic
    for number in diagnostics:
        names.insert(number % (len(names) + 1), topics.DIAGNOSTICS.name)
    for name in names:
        if name == topics.DIAGNOSTICS.name:
            order.add(name, b"status", shuffle.randrange(2**62))
        else:
            message = queues[name].pop(0)
            order.add(name, message.data, message.time, message.end)
        yield from order.ready()
    yield from order.flush()
    assert order.pending_bytes == 0
    assert order.late_count == 0


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), diagnostics=st.lists(st.integers(0, 10**6), max_size=40))
def test_order_does_not_depend_on_arrival_nor_on_diagnostics(queues, seed, diagnostics):
    reference = list(feed(queues, random.Random(0)))
    found = list(feed(queues, random.Random(seed), diagnostics))
    assert all(a.time < b.time for a, b in pairwise(found))
    of_the_run = [m for m in found if m.topic != topics.DIAGNOSTICS.name]
    assert of_the_run == reference
    assert len(found) == len(reference) + len(diagnostics)


def test_log_time_is_own_time_plus_twice_the_rank(queues):
    ranks = {topic.name: rank for rank, topic in enumerate(topics.ALL_TOPICS)}
    times = {}
    for queue in queues.values():
        for message in queue:
            times.setdefault(message.data, message.time)
    start = min(times.values())
    found = list(feed(queues, random.Random(1)))
    for message in found:
        own = times[message.data]
        if own > start:  # at the start the five channels push back what follows
            assert message.time == own + 2 * ranks[message.topic]
    at_start = [m.time for m in found if times[m.data] == start]
    assert at_start == list(range(start, start + 2 * len(at_start), 2))


def test_channels_share_a_time_and_are_told_apart_by_content(queues):
    slots = [m for m in feed(queues, random.Random(2)) if m.topic == topics.CHANNELS.name]
    assert [b.time - a.time for a, b in pairwise(slots)] == [2, 2, 2, 2]
    assert [m.data for m in slots] == sorted(m.data for m in slots)


def test_message_leaves_only_when_no_earlier_one_can_come():
    order = MessageOrder(["drive/voltage", "rod/velocity"])
    order.add("rod/velocity", b"r0", EVEN_EPOCH, EVEN_EPOCH + 1000)
    assert list(order.ready()) == []
    order.add("drive/voltage", b"v0", EVEN_EPOCH, EVEN_EPOCH + 1000)
    assert [m.data for m in order.ready()] == [b"v0", b"r0"]
    order.add("drive/voltage", b"v1", EVEN_EPOCH + 1000, EVEN_EPOCH + 2000)
    assert list(order.ready()) == []
    assert [m.data for m in order.flush()] == [b"v1"]


def test_counted_topics_are_waited_for():
    order = MessageOrder(["drive/voltage"], {"channels": 2})
    order.add("drive/voltage", b"v", EVEN_EPOCH, EVEN_EPOCH + 1000)
    order.add("channels", b"b", EVEN_EPOCH)
    assert list(order.ready()) == []
    order.add("channels", b"a", EVEN_EPOCH)
    assert [m.data for m in order.ready()] == [b"a", b"b", b"v"]


def test_late_message_fills_a_gap_and_is_counted():
    order = MessageOrder(["drive/voltage"])
    order.add("drive/voltage", b"v0", EVEN_EPOCH, EVEN_EPOCH + 1000)
    first = list(order.ready())
    order.add("drive/program", b"cut short", EVEN_EPOCH)
    order.add("drive/voltage", b"v1", EVEN_EPOCH + 1000, EVEN_EPOCH + 2000)
    rest = [*order.ready(), *order.flush()]
    rank = topics.ALL_TOPICS.index(topics.DRIVE_VOLTAGE)
    assert first == [OrderedMessage("drive/voltage", b"v0", EVEN_EPOCH + 2 * rank)]
    assert [m.data for m in rest] == [b"v1", b"cut short"]
    assert rest[0].time == EVEN_EPOCH + 1000 + 2 * rank
    assert rest[1].time % 2 == 1
    assert order.late_count == 1


def test_many_diagnostics_between_two_dense_blocks_move_no_block():
    # at 500 MHz blocks of one sample are 2 ns apart: one odd time between two even ones
    order = MessageOrder(["drive/voltage"])
    found = []
    for number in range(20):
        time = EVEN_EPOCH + 2 * number
        order.add("drive/voltage", bytes([number]), time, time + 2)
        order.add("/diagnostics", b"d", 5)
        order.add("/diagnostics", b"d", 5)
        found += order.ready()
    found += order.flush()
    rank = topics.ALL_TOPICS.index(topics.DRIVE_VOLTAGE)
    blocks = [m.time for m in found if m.topic == "drive/voltage"]
    assert blocks == [EVEN_EPOCH + 2 * n + 2 * rank for n in range(20)]
    assert len(found) == 60
    assert all(a.time < b.time for a, b in pairwise(found))


def test_stalled_topic_is_given_up_before_memory_runs_out():
    order = MessageOrder(["drive/voltage", "rod/velocity"], pending_limit=1000)
    found = []
    for number in range(20):
        time = EVEN_EPOCH + 1000 * number
        order.add("drive/voltage", bytes(100), time, time + 1000)
        found += order.ready()
        assert order.pending_bytes <= 1100
    assert order.given_up == ["rod/velocity"]
    assert len(found) >= 9
    order.add("rod/velocity", b"late", EVEN_EPOCH)
    assert b"late" in [m.data for m in [*order.ready(), *order.flush()]]


def test_hardware_run_takes_the_time_of_reception_made_increasing():
    order = MessageOrder(AWAITED, COUNTS, is_simulated=False)
    found = []
    for number, time in enumerate([100, 103, 103, 90, 200]):
        order.add("drive/voltage", bytes([number]), time)
        found += order.ready()
    assert [m.time for m in found] == [100, 103, 104, 105, 200]


def test_messages_after_the_flush_still_leave():
    order = MessageOrder(["drive/voltage"])
    order.add("drive/voltage", b"v", EVEN_EPOCH, EVEN_EPOCH + 10)
    first = list(order.flush())
    order.add("performance", b"p", EVEN_EPOCH + 10)
    rest = list(order.ready())
    assert [m.data for m in rest] == [b"p"]
    assert rest[0].time > first[-1].time


def test_bag_of_diagnostics_alone_keeps_their_own_time():
    order = MessageOrder(["drive/voltage"])
    order.add("/diagnostics", b"d", EVEN_EPOCH)
    assert list(order.ready()) == []
    assert [m.time for m in order.flush()] == [EVEN_EPOCH + 1]

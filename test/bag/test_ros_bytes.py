"""The bytes in a bag are those that ROS 2 itself writes and reads."""

from __future__ import annotations

import array
import json
import math
import random
from pathlib import Path

import numpy as np
import pytest
from rosbags.interfaces import Nodetype

from imotor_ros.bag.types import find_definitions, installed_types
from imotor_ros.contracts import topics

pytest.importorskip("imotor_msgs.msg", reason="needs the interface package")
pytest.importorskip("rclpy.serialization", reason="needs ROS 2")

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message, serialize_message

from imotor_ros.nodes.message_types import message_class
from imotor_ros.nodes.qos import qos_profile

OWN_TYPES = [f"imotor_msgs/msg/{path.stem}" for path in sorted(find_definitions().glob("*.msg"))]
TYPES = [*OWN_TYPES, topics.DIAGNOSTICS.type_name]
NUMBERS = [0.0, -0.0, math.pi, -1e300, 5e-324, math.inf, -math.inf, math.nan, 1.0, 1 / 3]
TEXTS = ["", "a", "ab", "abc", "abcd", "slider/velocity", "m/s", "µm Ω", "x" * 37]


def made_up(type_name, rng):
    """Return a message of rosbags and one of rclpy with the same random content."""
    types = installed_types()
    fields = types.store.fielddefs[type_name][1]
    pairs = {name: value(kind, rng) for name, kind in fields}
    ours = types.message(type_name, **{name: pair[0] for name, pair in pairs.items()})
    theirs = message_class(type_name)()
    for name, (_, content) in pairs.items():
        setattr(theirs, name, content)
    return ours, theirs


def value(kind, rng):
    node, detail = kind
    if node == Nodetype.NAME:
        return made_up(detail, rng)
    if node == Nodetype.SEQUENCE:
        count = rng.choice([0, 1, 2, 3, 100])
        if detail[0] == (Nodetype.BASE, ("float64", 0)):
            numbers = np.array([rng.choice(NUMBERS) for _ in range(count)])
            return numbers, array.array("d", numbers.tobytes())
        pairs = [value(detail[0], rng) for _ in range(min(count, 3))]
        return [a for a, _ in pairs], [b for _, b in pairs]
    found = {
        "string": lambda: rng.choice(TEXTS),
        "bool": lambda: rng.random() < 0.5,
        "float64": lambda: rng.choice(NUMBERS),
        "uint64": lambda: rng.choice([0, 1, 2**63, 2**64 - 1]),
        "uint32": lambda: rng.choice([0, 1, 2**31, 2**32 - 1]),
        "int32": lambda: rng.choice([0, -1, 2**31 - 1, -(2**31)]),
        "uint8": lambda: rng.choice([0, 1, 255]),
        "byte": lambda: rng.randrange(4),
    }[detail[0]]()
    if detail[0] == "byte":  # rclpy wants bytes of length 1
        return found, bytes([found])
    return found, found


@pytest.mark.parametrize("type_name", TYPES)
def test_content_written_by_rosbags_or_rclpy_is_read_by_the_other(type_name):
    types = installed_types()
    for seed in range(20):
        ours, theirs = made_up(type_name, random.Random(seed))
        written = types.serialize(ours)
        read = deserialize_message(written, message_class(type_name))
        assert same(read, theirs)
        # serialize_message returns a buffer that may be longer than what it wrote
        assert types.canonical(serialize_message(theirs)[: len(written)], type_name) == written


def same(a, b):
    """Whether two rclpy messages are equal, NaN being equal to NaN."""
    if hasattr(a, "get_fields_and_field_types"):
        return all(same(getattr(a, n), getattr(b, n)) for n in a.get_fields_and_field_types())
    if isinstance(a, (list, array.array)):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b or (a != a and b != b)


@pytest.mark.parametrize("type_name", TYPES)
def test_bytes_differ_from_those_of_rclpy_in_gaps_only(type_name):
    types = installed_types()
    for seed in range(20):
        ours, theirs = made_up(type_name, random.Random(seed))
        written, other = types.serialize(ours), serialize_message(theirs)
        # a byte that makes a difference when it is changed is content, any other is in a gap
        for place in [i for i in range(4, len(written)) if written[i] != other[i]]:
            assert written[place] == 0
            changed = bytearray(written)
            changed[place] = other[place]
            assert types.canonical(bytes(changed), type_name) == written


@pytest.mark.parametrize("type_name", OWN_TYPES)
def test_type_hash_is_the_one_that_ros_announces(type_name):
    package, kind, name = type_name.split("/")
    built = Path(find_definitions(), f"{name}.json")
    if not built.exists():
        pytest.skip("the definitions found are not those of an installation")
    hashes = {
        one["type_name"]: one["hash_string"] for one in json.loads(built.read_text())["type_hashes"]
    }
    assert installed_types().type_hash(f"{package}/{kind}/{name}") == hashes[type_name]


def test_raw_subscription_gives_the_same_canonical_bytes(monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    wanted = (topics.ROD_VELOCITY, topics.CHANNELS, topics.PERFORMANCE)
    context = Context()
    rclpy.init(context=context, domain_id=101)
    node = rclpy.create_node("bytes", context=context, namespace="bag_test")
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    received = {topic.name: [] for topic in wanted}
    sent = {topic.name: [] for topic in wanted}
    publishers = {}
    try:
        for topic in wanted:
            kind = message_class(topic.type_name)
            publishers[topic] = node.create_publisher(kind, topic.name, qos_profile(topic))
            node.create_subscription(
                kind, topic.name, received[topic.name].append, qos_profile(topic), raw=True
            )
        clock = node.get_clock()
        deadline = clock.now().nanoseconds + 20 * 10**9
        while any(p.get_subscription_count() < 1 for p in publishers.values()):
            assert clock.now().nanoseconds < deadline, "publishers and subscriptions did not match"
            executor.spin_once(timeout_sec=0.01)
        for seed in range(15):
            for topic, publisher in publishers.items():
                ours, theirs = made_up(topic.type_name, random.Random(seed))
                sent[topic.name].append(installed_types().serialize(ours))
                publisher.publish(theirs)
        while any(len(received[name]) < len(sent[name]) for name in sent):
            assert clock.now().nanoseconds < deadline, "messages did not come"
            executor.spin_once(timeout_sec=0.01)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
    canonical = {
        topic.name: [installed_types().canonical(d, topic.type_name) for d in received[topic.name]]
        for topic in wanted
    }
    assert canonical == sent

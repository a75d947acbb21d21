"""
How a run lies in a bag: names of its files, names and QoS of its topics.

A bag is a folder `<name>` in the standard layout of rosbag2: `<name>.mcap` and `metadata.yaml`.
While it is written, and after its recorder was killed, `unfinished.json` lies beside them with
what the metadata will hold and a killed recorder cannot add any more (`imotor_ros.bag.facts`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from imotor_ros.contracts.topics import ALL_TOPICS, Intent, Topic
from imotor_ros.errors import UnreadableFileError

UNFINISHED = "unfinished.json"
"""File that marks a bag as being written, or as left behind by a killed recorder."""

METADATA = "metadata.yaml"

_INFINITE = QosTime(9_223_372_036, 854_775_807)
_LATCHED_DEPTH = 32
_STATUS_DEPTH = 10
_ABSOLUTE = {topic.name for topic in ALL_TOPICS if topic.name.startswith("/")}


def absolute_name(namespace: str, name: str) -> str:
    """
    Return a topic's name in the bag.

    >>> absolute_name("/stand", "slider/velocity"), absolute_name("/stand", "/diagnostics")
    ('/stand/slider/velocity', '/diagnostics')
    """
    if name.startswith("/"):
        return name
    space = namespace.strip("/")
    return f"/{space}/{name}" if space else f"/{name}"


def relative_name(namespace: str, name: str) -> str:
    """
    Return the name below the namespace, or the name itself if it is not below.

    >>> relative_name("/stand", "/stand/slider/velocity"), relative_name("/stand", "/diagnostics")
    ('slider/velocity', '/diagnostics')
    """
    return name if name in _ABSOLUTE else name.removeprefix(absolute_name(namespace, ""))


def namespace_of(topics: Mapping[str, str]) -> str:
    """
    Return the namespace of the stand, from the types of a bag's topics by absolute name.

    >>> namespace_of({"/lab/stand/channels": "imotor_msgs/msg/Channel"})
    '/lab/stand'
    """
    for name, type_name in topics.items():
        for topic in ALL_TOPICS:
            if type_name == topic.type_name and name.endswith("/" + topic.name):
                return name.removesuffix("/" + topic.name) or "/"
    return "/"


def offered_qos(topic: Topic) -> Qos:
    """Return what the writers of a topic offer, which a player offers again."""
    history, depth, durability = {
        Intent.STREAM: (QosHistory.KEEP_ALL, 0, QosDurability.VOLATILE),
        Intent.LATCHED: (QosHistory.KEEP_LAST, _LATCHED_DEPTH, QosDurability.TRANSIENT_LOCAL),
        Intent.STATUS: (QosHistory.KEEP_LAST, _STATUS_DEPTH, QosDurability.VOLATILE),
    }[topic.intent]
    return Qos(
        history=history,
        depth=depth,
        reliability=QosReliability.RELIABLE,
        durability=durability,
        deadline=_INFINITE,
        lifespan=_INFINITE,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_INFINITE,
        avoid_ros_namespace_conventions=False,
    )


def find_mcap(path: Path) -> Path:
    """
    Return the MCAP file of a bag, given as its folder or one of its files.

    Raises
    ------
    UnreadableFileError
        If there is none, or more than one.

    """
    if not path.exists():
        raise UnreadableFileError("does not exist", where=str(path))
    folder = path.parent if path.name in (METADATA, UNFINISHED) else path
    if not folder.is_dir():
        return folder
    files = sorted(folder.glob("*.mcap"))
    if len(files) != 1:
        raise UnreadableFileError(
            "is not the bag of a run",
            where=str(path),
            value=[file.name for file in files],
            bound="a folder with one .mcap file",
        )
    return files[0]

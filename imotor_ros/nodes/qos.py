"""QoS profiles of the topics' intents."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from imotor_ros.contracts.topics import Intent, Topic

_LATCHED_DEPTH = 32


def qos_profile(topic: Topic) -> QoSProfile:
    """
    Return the profile for both ends of a topic.

    Sampled streams keep all on both sides: reliable alone loses samples once a history of
    fixed depth overflows.
    """
    if topic.intent is Intent.STREAM:
        return QoSProfile(
            history=HistoryPolicy.KEEP_ALL,
            depth=0,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.VOLATILE,
        )
    if topic.intent is Intent.LATCHED:
        return QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_LATCHED_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=10,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )

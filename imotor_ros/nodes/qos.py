"""QoS profiles of the topics' intents."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from imotor_ros.contracts.topics import Intent, Topic

_LATCHED_DEPTH = 32

PULSE_DEADLINE = 1.0
"""Time (s) within which a pulse comes again, as its writer offers it to readers who ask."""


def pulse_profile(*, is_writer: bool) -> QoSProfile:
    """Return the profile of a pulse; the writer offers a deadline, our readers ask for none."""
    profile = QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=1 if is_writer else 10,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    if is_writer:
        profile.deadline = Duration(seconds=PULSE_DEADLINE)
    return profile


def qos_profile(topic: Topic) -> QoSProfile:
    """
    Return the profile for both ends of a topic; a pulse's writer uses `pulse_profile`.

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
    if topic.intent is Intent.PULSE:
        return pulse_profile(is_writer=False)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=10,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )

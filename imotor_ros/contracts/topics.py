"""
The topics of the stand: names, message types, QoS intents and units.

Names are relative; the namespace of a stand, by default `stand`, is put before them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from imotor_ros.core import channel

DEFAULT_NAMESPACE = "/stand"


class Intent(Enum):
    """
    What the two ends of a topic need from the middleware.

    STREAM: nothing may be lost, the writer waits for slow readers (reliable, keep all).
    LATCHED: a fact that late joiners need too (reliable, transient local).
    STATUS: the latest few matter (reliable, keep last).
    PULSE: the latest matters, also to late joiners, and that it does not stop coming (reliable,
    transient local, keep last 1, with a deadline).
    """

    STREAM = "stream"
    LATCHED = "latched"
    STATUS = "status"
    PULSE = "pulse"


@dataclass(frozen=True)
class Topic:
    """
    One topic of the stand.

    Attributes
    ----------
    name : str
        Name relative to the stand's namespace, or absolute.
    type_name : str
        Message type, e.g. "imotor_msgs/msg/SampleBlock".
    intent : Intent
        What its two ends need.
    unit : str
        SI unit of the samples; empty where there are none.

    """

    name: str
    type_name: str
    intent: Intent
    unit: str = ""


def _stream(name: str, unit: str) -> Topic:
    return Topic(name, "imotor_msgs/msg/SampleBlock", Intent.STREAM, unit)


RUN_INFO = Topic("run/info", "imotor_msgs/msg/RunInfo", Intent.LATCHED)
DRIVE_PROGRAM = Topic("drive/program", "imotor_msgs/msg/DriveProgram", Intent.LATCHED)
CHANNELS = Topic("channels", "imotor_msgs/msg/Channel", Intent.LATCHED)
DRIVE_VOLTAGE = _stream("drive/voltage", "V")
DRIVE_PROGRESS = Topic("drive/progress", "imotor_msgs/msg/DriveProgress", Intent.STREAM)
VOLTAGE_MONITOR = _stream(channel.VOLTAGE, "V")
CURRENT = _stream(channel.CURRENT, "A")
TRUE_ROD_VELOCITY = _stream("truth/rod_velocity", "m/s")
TRUE_SLIDER_VELOCITY = _stream("truth/slider_velocity", "m/s")
TRUE_LOAD_FORCE = _stream("truth/load_force", "N")
ROD_VELOCITY = _stream(channel.ROD_VELOCITY, "m/s")
SLIDER_VELOCITY = _stream(channel.SLIDER_VELOCITY, "m/s")
LOAD_FORCE = _stream(channel.LOAD_FORCE, "N")
PERFORMANCE = Topic("performance", "imotor_msgs/msg/Performance", Intent.LATCHED)
RECORDING = Topic("recording", "imotor_msgs/msg/RecordingState", Intent.LATCHED)
STATE = Topic("state", "imotor_msgs/msg/StandState", Intent.PULSE)
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", Intent.STATUS)

ALL_TOPICS = (
    RUN_INFO,
    DRIVE_PROGRAM,
    CHANNELS,
    DRIVE_VOLTAGE,
    DRIVE_PROGRESS,
    VOLTAGE_MONITOR,
    CURRENT,
    TRUE_ROD_VELOCITY,
    TRUE_SLIDER_VELOCITY,
    TRUE_LOAD_FORCE,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    LOAD_FORCE,
    PERFORMANCE,
    DIAGNOSTICS,
)
"""Every topic that a bag holds; its place here is the rank that orders messages of one time."""

MEASURED_TOPICS = (ROD_VELOCITY, SLIDER_VELOCITY, LOAD_FORCE, VOLTAGE_MONITOR, CURRENT)
"""What a driver publishes, and an evaluator needs."""

TRUTH_TOPICS = (TRUE_ROD_VELOCITY, TRUE_SLIDER_VELOCITY, TRUE_LOAD_FORCE)
"""What no instrument sees: from the virtual plant to the virtual instruments."""

_BY_NAME = {topic.name: topic for topic in (*ALL_TOPICS, RECORDING, STATE)}


def topic_named(name: str) -> Topic:
    """
    Return the topic with this relative (or absolute) name.

    Raises
    ------
    KeyError
        If the stand has no such topic.

    """
    return _BY_NAME[name]


def is_sampled(topic: Topic) -> bool:
    """Whether the topic carries blocks of samples."""
    return topic.type_name == "imotor_msgs/msg/SampleBlock"

"""Which role publishes and reads which streams: from it follows how many readers each has."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from imotor_ros.contracts import topics
from imotor_ros.contracts.topics import Topic


@dataclass(frozen=True)
class Role:
    """
    What a node of the stand is started as.

    Attributes
    ----------
    executable : str
        Name of the executable.
    name : str
        Name of the node.
    publishes, reads : tuple of Topic
        Streams that it writes and reads, after remapping.
    remappings : mapping
        Names in the executable, and what they become.

    """

    executable: str
    name: str
    publishes: tuple[Topic, ...] = ()
    reads: tuple[Topic, ...] = ()
    remappings: Mapping[str, str] = field(default_factory=dict)


def _vibrometer(name: str, truth: Topic, measured: Topic) -> Role:
    names = {"true_velocity": truth.name, "velocity": measured.name}
    return Role("vibrometer", name, (measured,), (truth,), names)


SIGNAL_GENERATOR = Role(
    "signal_generator",
    "signal_generator",
    (topics.DRIVE_VOLTAGE,),
    (topics.DRIVE_PROGRESS, topics.ROD_VELOCITY),
)
PLANT = Role(
    "plant",
    "plant",
    (*topics.TRUTH_TOPICS, topics.VOLTAGE_MONITOR, topics.CURRENT, topics.DRIVE_PROGRESS),
    (topics.DRIVE_VOLTAGE,),
)
ROD_VIBROMETER = _vibrometer("rod_vibrometer", topics.TRUE_ROD_VELOCITY, topics.ROD_VELOCITY)
SLIDER_VIBROMETER = _vibrometer(
    "slider_vibrometer", topics.TRUE_SLIDER_VELOCITY, topics.SLIDER_VELOCITY
)
FORCE_SENSOR = Role("force_sensor", "force_sensor", (topics.LOAD_FORCE,), (topics.TRUE_LOAD_FORCE,))
EVALUATOR = Role("evaluator", "evaluator", (), topics.MEASURED_TOPICS)
RECORDER = Role(
    "recorder",
    "recorder",
    (),
    tuple(topic for topic in topics.ALL_TOPICS if topic.intent is topics.Intent.STREAM),
)
PLAYER = Role(
    "player",
    "player",
    (*topics.MEASURED_TOPICS, topics.DRIVE_VOLTAGE, topics.DRIVE_PROGRESS),
)

VIRTUAL_STAND = (
    SIGNAL_GENERATOR,
    PLANT,
    ROD_VIBROMETER,
    SLIDER_VIBROMETER,
    FORCE_SENSOR,
    EVALUATOR,
    RECORDER,
)
"""The whole stand with the virtual motor."""

DRIVER_NAME = "driver"
"""Name of the node that takes the place of the virtual motor and its instruments."""

_CORRECTION = (SIGNAL_GENERATOR.name, PLANT.name, ROD_VIBROMETER.name, DRIVER_NAME)


def stand_with(driver: str) -> tuple[Role, ...]:
    """
    Return the whole stand with a driver in the place of plant and virtual instruments.

    Parameters
    ----------
    driver : str
        Its executable, or "package/executable".

    """
    published = (*topics.MEASURED_TOPICS, topics.DRIVE_PROGRESS)
    role = Role(driver, DRIVER_NAME, published, (topics.DRIVE_VOLTAGE,))
    return (SIGNAL_GENERATOR, role, EVALUATOR, RECORDER)


def in_correction(roles: Iterable[Role]) -> tuple[Role, ...]:
    """Return what of a stand has to be active while the generator finds a voltage."""
    return tuple(role for role in roles if role.name in _CORRECTION)


def expected_readers(role: Role, roles: Iterable[Role]) -> str:
    """
    Return how many readers each stream of a role has, as its node's parameter wants it.

    Parameters
    ----------
    role : Role
        The writer.
    roles : iterable of Role
        All roles that are started, the writer among them or not.

    """
    counts = Counter(topic.name for other in roles for topic in other.reads)
    return " ".join(f"{topic.name}={counts[topic.name]}" for topic in role.publishes)

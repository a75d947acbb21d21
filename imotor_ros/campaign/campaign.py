"""A campaign: a named list of points, read from YAML."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from imotor_ros.campaign.driver import Driver
from imotor_ros.campaign.leaves import flatten
from imotor_ros.campaign.order import sequence_of
from imotor_ros.campaign.point import PointParameters
from imotor_ros.core.identification.stepped_sine import SteppedSineParameters
from imotor_ros.core.parameters import all_leaves, deciding_choice
from imotor_ros.errors import BadInputError, UnknownKeyError, UnreadableFileError

_KEYS = (
    "name", "description", "driver", "driver_parameters", "stand", "point", "sweep", "points",
    "repetitions", "order", "order_seed", "identification",
)  # fmt: skip
_RESERVED = (".", "..", "logs", "results.json", "identification")


@dataclass(frozen=True)
class NamedPoint:
    """A point, its name, which is also that of its folder, and the driver it is measured with."""

    name: str
    parameters: PointParameters
    driver: Driver = field(default_factory=Driver)


@dataclass(frozen=True)
class Campaign:
    """
    What to measure: a value that does nothing by itself.

    Attributes
    ----------
    name, description : str
        Name, also that of the results, and a sentence on its purpose.
    points : tuple of NamedPoint
        The runs, in order.
    driver : Driver
        What all of them are measured with.
    identification : SteppedSineParameters or None
        Drive of the run that the models' friction is identified from; None where the models have
        the friction of the paper.

    """

    name: str
    description: str
    points: tuple[NamedPoint, ...]
    driver: Driver = field(default_factory=Driver)
    identification: SteppedSineParameters | None = None

    def to_mapping(self) -> dict[str, Any]:
        """Return a mapping from which `campaign_from_mapping` makes an equal campaign."""
        own = self.identification
        return {
            "name": self.name,
            "description": self.description,
            **self.driver.to_mapping(),
            **({} if own is None else {"identification": own.to_mapping()}),
            "points": [
                {"name": point.name, **point.parameters.to_mapping()} for point in self.points
            ],
        }


def read_yaml(path: Path) -> Any:
    """
    Read a YAML file.

    Raises
    ------
    UnreadableFileError
        If it is missing or does not parse.

    """
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UnreadableFileError(error.strerror or str(error), where=str(path)) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        text = " ".join(str(error).split())
        raise UnreadableFileError(f"does not parse: {text}", where=str(path)) from error


def load_campaign(path: Path) -> Campaign:
    """
    Read a campaign from a YAML file.

    The file holds ``name``, ``description``, optionally ``stand`` (a YAML file beside it with
    the parameters of the stand), ``point`` (what all points have in common), ``sweep`` (lists of
    values by dotted name: every combination is a point) and ``points`` (single points, each with
    what is special in it). What comes later in this list overrides what comes before.
    ``repetitions`` says how often each point is measured, every time with the next seed;
    ``order`` is "rounds" (all points, then all again), "together" (repetitions in a row) or
    "random", as ``order_seed`` determines. ``driver`` names the executable that takes the place
    of the virtual motor and its instruments, ``driver_parameters`` its parameters, as a mapping
    or as a YAML file beside this one. ``identification`` asks for a run of its own that the
    friction of the models is identified from: the parameters of a stepped sine, or a campaign
    file with such a point beside this one, of which only these are used.

    Raises
    ------
    UnreadableFileError
        If a file is missing or does not parse.
    BadInputError
        If a key is unknown or a value not accepted.

    """
    mapping = read_yaml(path)
    if isinstance(mapping, Mapping) and isinstance(mapping.get("stand"), str):
        stand_path = path.parent / mapping["stand"]
        mapping = {**mapping, "stand": read_yaml(stand_path)}
    if isinstance(mapping, Mapping) and isinstance(mapping.get("driver_parameters"), str):
        driver_path = path.parent / mapping["driver_parameters"]
        mapping = {**mapping, "driver_parameters": read_yaml(driver_path)}
    if isinstance(mapping, Mapping) and isinstance(mapping.get("identification"), str):
        drive = _drive_in(path.parent / mapping["identification"])
        mapping = {**mapping, "identification": drive}
    return campaign_from_mapping(mapping, str(path))


def _drive_in(path: Path) -> dict[str, Any]:
    """Return the parameters of the stepped sine that the point of a campaign file is driven by."""
    content = read_yaml(path)
    point = content.get("point") if isinstance(content, Mapping) else None
    drive = point.get("drive") if isinstance(point, Mapping) else None
    if not isinstance(drive, Mapping) or drive.get("kind") != "stepped_sine":
        raise BadInputError(
            "is not driven by a stepped sine", where=str(path),
            bound="point: drive: kind: stepped_sine",
        )  # fmt: skip
    return {key: value for key, value in drive.items() if key != "kind"}


def campaign_from_mapping(mapping: Any, where: str = "campaign") -> Campaign:
    """
    Make a campaign from a plain mapping; see `load_campaign` for its keys.

    Raises
    ------
    BadInputError
        If a key is unknown or a value not accepted.

    """
    if not isinstance(mapping, Mapping):
        raise BadInputError("is not a mapping", where=where, value=mapping)
    for key in mapping:
        if key not in _KEYS:
            raise UnknownKeyError(
                "is not a key of a campaign",
                where=f"{where}: {key}",
                bound="one of " + ", ".join(_KEYS),
            )
    for key in ("name", "description"):
        _check_text(mapping.get(key, ""), f"{where}: {key}")
    stand = flatten(mapping.get("stand") or {}, f"{where}: stand")
    common = {f"stand.{name}": value for name, value in stand}
    shared = dict(flatten(mapping.get("point") or {}, f"{where}: point"))
    combinations = _combinations(mapping.get("sweep", {}), f"{where}: sweep")
    single = mapping.get("points", [{}])
    if not isinstance(single, list) or not single:
        raise BadInputError("is not a list of points", where=f"{where}: points", value=single)
    points = [
        _point(_Layers(common, shared, swept, dict(flatten(extra, f"{where}: points"))), where)
        for extra in single
        for swept in combinations
    ]
    driver = Driver.from_mapping(mapping, where)
    in_order = _in_order(tuple(_unique(points)), mapping, where)
    return Campaign(
        name=str(mapping.get("name", "campaign")),
        description=str(mapping.get("description", "")),
        points=tuple(replace(point, driver=driver) for point in in_order),
        driver=driver,
        identification=_identification(mapping, where),
    )


def _identification(mapping: Mapping[str, Any], where: str) -> SteppedSineParameters | None:
    drive = mapping.get("identification")
    if drive is None:
        return None
    return SteppedSineParameters.from_mapping(drive, f"{where}: identification")


def _in_order(
    points: tuple[NamedPoint, ...], mapping: Mapping[str, Any], where: str
) -> Iterable[NamedPoint]:
    """Return the points as often and in the order that the campaign asks for."""
    repetitions = mapping.get("repetitions", 1)
    try:
        sequence = sequence_of(
            len(points), repetitions, mapping.get("order", "rounds"), mapping.get("order_seed", 0)
        )
    except BadInputError as error:
        raise BadInputError(
            error.what, where=f"{where}: {error.where}", value=error.value, bound=error.bound
        ) from error
    runs = []
    for number, repeat in sequence:
        name, parameters = points[number].name, points[number].parameters
        if repetitions > 1:
            name = f"{name}_r{repeat + 1}"
            parameters = parameters.replace(seed=parameters.seed + repeat)
        runs.append(NamedPoint(name, parameters))
    return _unique(runs)


def _combinations(sweep: Any, where: str) -> list[dict[str, Any]]:
    if not isinstance(sweep, Mapping):
        raise BadInputError("is not a mapping of lists of values", where=where, value=sweep)
    for name, values in sweep.items():
        if not isinstance(values, list) or not values:
            raise BadInputError("is not a list of values", where=f"{where}: {name}", value=values)
    product = itertools.product(*sweep.values())
    return [dict(zip(sweep.keys(), values, strict=True)) for values in product]


class _Layers(NamedTuple):
    """Values by dotted name that make up a point; a later one overrides an earlier one."""

    stand: Mapping[str, Any]
    point: Mapping[str, Any]
    sweep: Mapping[str, Any]
    special: Mapping[str, Any]

    def depth(self, leaf: str) -> int:
        """Return the number of the last layer that holds a name, -1 if none does."""
        return max((i for i, layer in enumerate(self) if leaf in layer), default=-1)


def _point(layers: _Layers, where: str) -> NamedPoint:
    leaves = {name: value for layer in layers for name, value in layer.items()}
    name = leaves.pop("name", "") or "_".join(
        f"{key.rpartition('.')[2]}-{value}" for key, value in layers.sweep.items()
    )
    _check_text(name, f"{where}: name")
    known = _choices()
    for leaf in leaves:
        if leaf not in known:
            raise UnknownKeyError("is not a parameter of a point", where=f"{where}: {leaf}")
    parameters = PointParameters.from_leaves(leaves, where)
    for leaf in leaves:
        if known[leaf] and not _has(parameters, leaf):
            _check_left_out(leaf, known[leaf], layers, parameters, where)
    return NamedPoint(str(name) or "point", parameters)


@cache
def _choices() -> Mapping[str, str]:
    """Return every parameter of a point, and the key that decides whether there is one."""
    return {
        leaf: deciding_choice(PointParameters, leaf) for leaf, _, _ in all_leaves(PointParameters)
    }


def _has(parameters: PointParameters, leaf: str) -> bool:
    group: Any = parameters
    for part in leaf.split("."):
        if not hasattr(group, part):
            return False
        group = getattr(group, part)
    return True


def _check_left_out(
    leaf: str, key: str, layers: _Layers, parameters: PointParameters, where: str
) -> None:
    """
    Refuse a parameter of a law that the point does not have.

    It is left out where a later layer chooses another law than the one it was meant for, as a
    point may do with the law of the stand; but nobody sweeps over what has no effect.
    """
    if leaf not in layers.sweep and layers.depth(key) > layers.depth(leaf):
        return
    chosen = {name: value for name, value, _ in parameters.leaves()}
    group = key.rpartition(".")[0] + "."
    raise BadInputError(
        f"is not a parameter of {key} = {chosen[key]}",
        where=f"{where}: {leaf}",
        bound="one of " + ", ".join(n for n in chosen if n.startswith(group) and n != key),
    )


def _check_text(value: Any, where: str) -> None:
    """Refuse a name that is none; a number will do."""
    if not isinstance(value, (str, int, float)) or isinstance(value, bool):
        raise BadInputError("is not a text", where=where, value=value)


def _unique(points: list[NamedPoint]) -> Iterable[NamedPoint]:
    """Give every point a name of its own, under which a folder can stand among the results."""
    taken = set(_RESERVED)
    for point in points:
        name = "".join(c if c.isalnum() or c in "-_." else "-" for c in point.name)
        numbered = (f"{name}_{number}" for number in itertools.count(2))
        unique = next(n for n in itertools.chain([name], numbered) if n not in taken)
        taken.add(unique)
        yield NamedPoint(unique, point.parameters)

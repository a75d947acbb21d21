"""What takes the place of the virtual motor and its instruments: a driver node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from imotor_ros.campaign.leaves import flatten
from imotor_ros.errors import BadInputError

VIRTUAL = "virtual"
"""Name that stands for no driver: the virtual motor and the virtual instruments."""

_ROS_KEY = "ros__parameters"


@dataclass(frozen=True)
class Driver:
    """
    The driver of a campaign.

    Attributes
    ----------
    executable : str
        "virtual"; or an executable of imotor_ros, or "package/executable" of another package.
    parameters : mapping
        Values of its node's parameters by dotted name; the others keep what the node has.

    """

    executable: str = VIRTUAL
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_virtual(self) -> bool:
        """Whether there is none, but the virtual motor."""
        return self.executable == VIRTUAL

    def to_mapping(self) -> dict[str, Any]:
        """Return the keys of a campaign that make this driver; none for the virtual motor."""
        if self.is_virtual:
            return {}
        return {"driver": self.executable, "driver_parameters": dict(self.parameters)}

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], where: str) -> Driver:
        """
        Return the driver that the keys of a campaign ask for.

        Parameters
        ----------
        mapping : mapping
            With "driver" and "driver_parameters", both optional. The latter is nested or has
            dotted names, and may have the form of a ROS parameter file for one node.
        where : str
            Name of the campaign, for errors.

        Raises
        ------
        BadInputError
            If there is no such driver, or parameters that nothing would take.

        """
        executable = mapping.get("driver", VIRTUAL)
        if not isinstance(executable, str) or not executable or executable.count("/") > 1:
            raise BadInputError(
                "is no driver", where=f"{where}: driver", value=executable,
                bound=f'"{VIRTUAL}", an executable, or "package/executable"',
            )  # fmt: skip
        place = f"{where}: driver_parameters"
        given = mapping.get("driver_parameters") or {}
        parameters = dict(flatten(_of_one_node(given, place), place))
        if parameters and executable == VIRTUAL:
            raise BadInputError(
                "has no driver that takes it", where=place, value=next(iter(parameters)),
                bound="a campaign with a key driver",
            )  # fmt: skip
        return cls(executable, parameters)


def _of_one_node(mapping: Any, where: str) -> Any:
    """Return what a ROS parameter file has for its one node; anything else as it is."""
    if not isinstance(mapping, Mapping):
        return mapping
    if _ROS_KEY in mapping:
        return mapping[_ROS_KEY]
    nodes = [one for one in mapping.values() if isinstance(one, Mapping) and _ROS_KEY in one]
    if not nodes:
        return mapping
    if len(mapping) > 1:
        raise BadInputError("has parameters of several nodes", where=where, value=list(mapping))
    return nodes[0][_ROS_KEY]

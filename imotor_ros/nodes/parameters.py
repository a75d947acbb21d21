"""ROS parameters from parameter classes: declaration, descriptors and the check of changes."""

from __future__ import annotations

import array
from collections.abc import Mapping
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from imotor_ros.core.parameters import FieldInfo, Parameters, all_leaves
from imotor_ros.errors import BadInputError, UnknownKeyError

P = TypeVar("P", bound=Parameters)

_RESERVED = ("use_sim_time", "start_type_description_service", "qos_overrides")


class ParameterBinding(Generic[P]):
    """
    Ties the ROS parameters of a node to one parameter class.

    Every leaf of the class becomes a ROS parameter of the same dotted name. Where a key chooses
    between classes, the leaves of all of them are declared, not set, which means the default of
    the class chosen; those of the classes not chosen are ignored. Values are checked by the
    class itself, at start and at each change.

    Parameters
    ----------
    node : Node
        The node whose parameters they are.
    parameters_class : type
        Class derived from `Parameters`.

    Raises
    ------
    UnknownKeyError
        If the node was given a parameter that the class does not have.
    BadInputError
        If a given value is not accepted.

    """

    def __init__(self, node: Node, parameters_class: type[P]) -> None:
        self._node = node
        self._class = parameters_class
        self._known = {
            name: (default, info) for name, default, info in all_leaves(parameters_class)
        }
        self.is_locked = False
        self._refuse_unknown()
        for name, (default, info) in self._known.items():
            node.declare_parameter(name, _to_ros(default), _descriptor(name, default, info))
        self.value: P = self._build({})
        node.add_on_set_parameters_callback(self._on_set_parameters)

    def _refuse_unknown(self) -> None:
        for name in self._node._parameter_overrides:
            if name not in self._known and not name.startswith(_RESERVED):
                raise UnknownKeyError(
                    "is not a parameter",
                    where=f"{self._node.get_name()}: {name}",
                    bound="one of " + ", ".join(self._known),
                )

    def _build(self, changes: Mapping[str, Any]) -> P:
        values = {name: _from_ros(self._node.get_parameter(name).value) for name in self._known}
        values.update(changes)
        try:
            return self._class.from_leaves(values)
        except BadInputError as error:
            where = f"{self._node.get_name()}: {error.where}"
            raise BadInputError(
                error.what, where=where, value=error.value, bound=error.bound
            ) from error

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        changes = {p.name: _from_ros(p.value) for p in parameters if p.name in self._known}
        if not changes:
            return SetParametersResult(successful=True)
        if self.is_locked:
            reason = f"{', '.join(changes)}: cannot change while the node is active; deactivate it"
            return SetParametersResult(successful=False, reason=reason)
        try:
            self.value = self._build(changes)
        except BadInputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


def _to_ros(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _from_ros(value: Any) -> Any:
    return list(value) if isinstance(value, array.array) else value


def _descriptor(name: str, default: Any, info: FieldInfo) -> ParameterDescriptor:
    # dynamic typing lets a user write 1 for 1.0; the class checks what comes
    descriptor = ParameterDescriptor(name=name, dynamic_typing=True)
    unit = f" ({info.unit})" if info.unit else ""
    descriptor.description = f"{info.meaning}{unit}"
    descriptor.additional_constraints = info.bound if not isinstance(default, (str, bool)) else ""
    if info.options:
        descriptor.additional_constraints = info.bound
    is_bounded = abs(info.low) < float("inf") and abs(info.high) < float("inf")
    if isinstance(default, float) and is_bounded and not info.excludes_low:
        limits = FloatingPointRange(from_value=float(info.low), to_value=float(info.high))
        descriptor.floating_point_range = [limits]
    return descriptor


def parameter_values(parameters: Parameters, prefix: str = "") -> dict[str, Any]:
    """Return dotted names and values of all leaves, as `Parameter` or YAML takes them."""
    return {name: _to_ros(value) for name, value, _ in parameters.leaves(prefix)}

"""
Parameters as data: every field of a parameter class carries unit, bounds, meaning and source.

From one frozen dataclass come the check of a value, the reading of a YAML mapping, the
declaration of ROS parameters, the reference table of the documentation and the provenance
in a bag. A field is a number, a truth value, a text, a tuple of numbers, or a group: another
parameter class, or one of several chosen by a key (see `group` and `choice`).
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from imotor_ros.errors import BadInputError, UnknownKeyError

_KEY = "imotor"

_NUMBER_AS_TEXT = re.compile(r"(?P<mantissa>[-+]?(\d+\.?\d*|\.\d+))([eE](?P<exponent>[-+]?\d+))?")


@dataclass(frozen=True)
class FieldInfo:
    """
    What is known about one parameter beside its value.

    Attributes
    ----------
    meaning : str
        What it is, in half a sentence.
    unit : str
        SI unit, empty for a pure number or a text.
    low, high : float
        Bounds, inclusive unless `excludes_low`.
    excludes_low : bool
        True if the lower bound itself is not allowed.
    options : tuple of str
        Allowed texts; empty if any.
    source : str
        Where the default comes from.

    """

    meaning: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    excludes_low: bool = False
    options: tuple[str, ...] = ()
    source: str = ""

    @property
    def bound(self) -> str:
        """The accepted values in words, with unit."""
        if self.options:
            return "one of " + ", ".join(self.options)
        parts = []
        if self.low > -math.inf:
            parts.append(f"{'>' if self.excludes_low else '>='} {self.low:g}")
        if self.high < math.inf:
            parts.append(f"<= {self.high:g}")
        words = " and ".join(parts) or "a finite number"
        return f"{words} {self.unit}".rstrip()


@dataclass(frozen=True)
class _Group:
    """A nested parameter class, or several of them by the value of a key."""

    classes: Mapping[str, type[Parameters]]
    key: str = ""


def parameter(default: Any, meaning: str, **info: Any) -> Any:
    """
    Declare one parameter of a class derived from `Parameters`.

    Parameters
    ----------
    default : int, float, bool, str or tuple of float
        Default value; its type is the type of the parameter.
    meaning : str
        What it is, in half a sentence.
    **info
        The other attributes of `FieldInfo`.

    """
    return dataclasses.field(default=default, metadata={_KEY: FieldInfo(meaning, **info)})


def group(parameters_class: type[Parameters]) -> Any:
    """Declare a nested group of parameters, by default with all its defaults."""
    return dataclasses.field(
        default_factory=parameters_class, metadata={_KEY: _Group({"": parameters_class})}
    )


def choice(key: str, default: str, classes: Mapping[str, type[Parameters]]) -> Any:
    """
    Declare a group whose class is chosen by the text under `key` in the same mapping.

    Parameters
    ----------
    key : str
        Key that holds the choice, e.g. "law".
    default : str
        Choice taken where the key is missing.
    classes : mapping of str to type
        Parameter class of each choice.

    """
    return dataclasses.field(
        default_factory=classes[default], metadata={_KEY: _Group(dict(classes), key)}
    )


@dataclass(frozen=True)
class Parameters:
    """Base of all parameter classes: checks itself, and goes to and from plain mappings."""

    def __post_init__(self) -> None:
        """Check every field against its type and bounds."""
        for field, info in _checked_fields(type(self)):
            value = getattr(self, field.name)
            if isinstance(info, FieldInfo):
                if value is field.default:  # checked once for all
                    continue
                where = f"{type(self).__name__}.{field.name}"
                object.__setattr__(self, field.name, _checked(value, field, info, where))
            elif not isinstance(value, tuple(info.classes.values())):
                raise BadInputError(
                    "is of the wrong class",
                    where=f"{type(self).__name__}.{field.name}",
                    value=type(value).__name__,
                    bound=" or ".join(c.__name__ for c in info.classes.values()),
                )
        self.check()

    def check(self) -> None:
        """Check what concerns several fields at once; derived classes extend it."""

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], where: str = "") -> Self:
        """
        Make parameters from a plain mapping, as YAML gives it.

        Parameters
        ----------
        mapping : mapping
            Values by key; a group is a mapping of its own. Missing keys keep their defaults.
        where : str, optional
            Name of the mapping, for errors, e.g. "params/motor.yaml".

        Raises
        ------
        UnknownKeyError
            If a key is not a parameter.
        BadInputError
            If a value has the wrong type or is out of bounds.

        """
        name = where or cls.__name__
        if not isinstance(mapping, Mapping):
            raise BadInputError("is not a mapping", where=name, value=mapping)
        known = {field.name: field for field in dataclasses.fields(cls)}
        for key in mapping:
            if key not in known:
                raise UnknownKeyError(
                    "is not a parameter",
                    where=f"{name}: {key}",
                    bound="one of " + ", ".join(sorted(known)),
                )
        values = {key: _read(known[key], value, f"{name}: {key}") for key, value in mapping.items()}
        try:
            return cls(**values)
        except BadInputError as error:
            if not where:
                raise
            raise BadInputError(
                error.what, where=f"{where}: {error.where}", value=error.value, bound=error.bound
            ) from error

    @classmethod
    def from_leaves(cls, leaves: Mapping[str, Any], where: str = "") -> Self:
        """
        Make parameters from dotted names, as `leaves` yields them.

        Leaves of classes that a `choice` offers but that are not chosen are left out, so that
        the leaves of all of them may be given, as `all_leaves` lists them.

        Parameters
        ----------
        leaves : mapping
            Values by dotted name, e.g. {"slider.mass": 0.007}; None leaves the default.
        where : str, optional
            Name of the mapping, for errors.

        Raises
        ------
        UnknownKeyError
            If a name is not a parameter.
        BadInputError
            If a value has the wrong type or is out of bounds.

        """
        return cls.from_mapping(_nest(cls, leaves, where or cls.__name__), where)

    def to_mapping(self) -> dict[str, Any]:
        """Return a plain mapping from which `from_mapping` makes an equal object."""
        result: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            info = field.metadata[_KEY]
            value = getattr(self, field.name)
            if isinstance(info, FieldInfo):
                result[field.name] = list(value) if isinstance(value, tuple) else value
                continue
            inner = value.to_mapping()
            if info.key:
                chosen = next(k for k, c in info.classes.items() if c is type(value))
                inner = {info.key: chosen, **inner}
            result[field.name] = inner
        return result

    def leaves(self, prefix: str = "") -> Iterator[tuple[str, Any, FieldInfo]]:
        """
        Yield every single parameter: dotted name, value and what is known about it.

        The key of a `choice` comes first in its group, as a text with options.
        """
        for field in dataclasses.fields(self):
            info = field.metadata[_KEY]
            value = getattr(self, field.name)
            name = prefix + field.name
            if isinstance(info, FieldInfo):
                yield name, value, info
                continue
            if info.key:
                chosen = next(k for k, c in info.classes.items() if c is type(value))
                options = FieldInfo(f"which {field.name}", options=tuple(info.classes))
                yield f"{name}.{info.key}", chosen, options
            yield from value.leaves(name + ".")

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some fields changed."""
        return dataclasses.replace(self, **changes)


_Fields = tuple[tuple[dataclasses.Field[Any], FieldInfo | _Group], ...]

_known_fields: dict[type[Parameters], _Fields] = {}


def _checked_fields(parameters_class: type[Parameters]) -> _Fields:
    """Return the fields of a class and what is known about each; their defaults are accepted."""
    if parameters_class in _known_fields:
        return _known_fields[parameters_class]
    found = []
    for field in dataclasses.fields(parameters_class):
        info = field.metadata[_KEY]
        if isinstance(info, FieldInfo):
            where = f"{parameters_class.__name__}.{field.name}"
            _checked(field.default, field, info, where)
        found.append((field, info))
    return _known_fields.setdefault(parameters_class, tuple(found))


def deciding_choice(parameters_class: type[Parameters], leaf: str) -> str:
    """
    Return the key that decides whether a parameter exists, by dotted names; empty if none does.

    Parameters
    ----------
    parameters_class : type
        Where it is looked for.
    leaf : str
        One of `all_leaves`.

    """
    head, _, rest = leaf.partition(".")
    field = next(one for one in dataclasses.fields(parameters_class) if one.name == head)
    info = field.metadata[_KEY]
    if not isinstance(info, _Group) or rest == info.key:
        return ""
    if info.key:
        return f"{head}.{info.key}"
    inner = deciding_choice(info.classes[""], rest)
    return f"{head}.{inner}" if inner else ""


def all_leaves(
    parameters_class: type[Parameters], prefix: str = ""
) -> Iterator[tuple[str, Any, FieldInfo]]:
    """
    Yield dotted name, default and what is known of every parameter a class can have.

    Where a key chooses between classes, the parameters of all of them are listed, each name
    once and with the default None: what it is depends on the choice.
    """
    own = parameters_class()
    for field in dataclasses.fields(parameters_class):
        info = field.metadata[_KEY]
        name = prefix + field.name
        if isinstance(info, FieldInfo):
            yield name, getattr(own, field.name), info
        elif not info.key:
            yield from all_leaves(info.classes[""], name + ".")
        else:
            options = FieldInfo(f"which {field.name}", options=tuple(info.classes))
            yield f"{name}.{info.key}", _default_choice(field), options
            yield from _leaves_of_choices(info, name + ".")


def varying_leaves(objects: Sequence[Parameters]) -> list[dict[str, Any]]:
    """
    Return, for each of several objects of one class, the parameters in which they differ.

    By dotted name, in one order for all; None where an object's choice does not have it.
    """
    found: list[dict[str, Any]] = [{} for _ in objects]
    _collect_varying(objects, "", found)
    return found


def _collect_varying(
    objects: Sequence[Parameters | None], prefix: str, found: Sequence[dict[str, Any]]
) -> None:
    classes = dict.fromkeys(type(one) for one in objects if one is not None)
    names = dict.fromkeys((f.name, f) for c in classes for f in dataclasses.fields(c))
    for name, field in names:
        values = [getattr(one, name, None) for one in objects]
        if all(value == values[0] for value in values):
            continue
        info = field.metadata[_KEY]
        if isinstance(info, FieldInfo):
            for row, value in zip(found, values, strict=True):
                row[prefix + name] = list(value) if isinstance(value, tuple) else value
            continue
        if len({type(value) for value in values}) > 1:
            keys = {inner: key for key, inner in info.classes.items()}
            for row, value in zip(found, values, strict=True):
                row[f"{prefix}{name}.{info.key}"] = keys.get(type(value))
        _collect_varying(values, f"{prefix}{name}.", found)


def _leaves_of_choices(info: _Group, prefix: str) -> Iterator[tuple[str, Any, FieldInfo]]:
    seen: set[str] = set()
    for inner in info.classes.values():
        for name, _, leaf in all_leaves(inner, prefix):
            if name not in seen:
                seen.add(name)
                yield name, None, leaf


def _nest(cls: type[Parameters], leaves: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Turn dotted names into nested mappings, without the leaves of classes not chosen."""
    fields = {field.name: field for field in dataclasses.fields(cls)}
    nested: dict[str, Any] = {}
    inner: dict[str, dict[str, Any]] = {}
    for name, value in leaves.items():
        if value is None:
            continue
        head, _, rest = name.partition(".")
        if head not in fields or bool(rest) != isinstance(fields[head].metadata[_KEY], _Group):
            raise UnknownKeyError(
                "is not a parameter",
                where=f"{where}: {name}",
                bound="one of " + ", ".join(n for n, _, _ in all_leaves(cls)),
            )
        if rest:
            inner.setdefault(head, {})[rest] = value
        else:
            nested[head] = value
    for head, values in inner.items():
        nested[head] = _nest_group(fields[head], values, f"{where}: {head}")
    return nested


def _nest_group(field: dataclasses.Field[Any], values: dict[str, Any], where: str) -> Any:
    group_info: _Group = field.metadata[_KEY]
    if not group_info.key:
        return _nest(group_info.classes[""], values, where)
    chosen = values.pop(group_info.key, None) or _default_choice(field)
    if not _is_offered(chosen, group_info):
        return {group_info.key: chosen, **values}
    own = {name for name, _, _ in all_leaves(group_info.classes[chosen])}
    others = {n for c in group_info.classes.values() for n, _, _ in all_leaves(c)} - own
    kept = {name: value for name, value in values.items() if name not in others}
    return {group_info.key: chosen, **_nest(group_info.classes[chosen], kept, where)}


def _default_choice(field: dataclasses.Field[Any]) -> str:
    classes: Mapping[str, type[Parameters]] = field.metadata[_KEY].classes
    return next(key for key, one in classes.items() if one is field.default_factory)


def _is_offered(chosen: Any, info: _Group) -> bool:
    return isinstance(chosen, str) and chosen in info.classes


def _read(field: dataclasses.Field[Any], value: Any, where: str) -> Any:
    info = field.metadata[_KEY]
    if isinstance(info, FieldInfo):
        return value
    if isinstance(value, Parameters):
        return value
    if not info.key:
        return info.classes[""].from_mapping(value, where)
    if not isinstance(value, Mapping):
        raise BadInputError("is not a mapping", where=where, value=value)
    chosen = value.get(info.key, _default_choice(field))
    if not _is_offered(chosen, info):
        raise BadInputError(
            "is not a choice",
            where=f"{where}.{info.key}",
            value=chosen,
            bound="one of " + ", ".join(info.classes),
        )
    rest = {key: inner for key, inner in value.items() if key != info.key}
    return info.classes[chosen].from_mapping(rest, where)


def _checked(value: Any, field: dataclasses.Field[Any], info: FieldInfo, where: str) -> Any:
    wanted: type = type(field.default)
    if wanted is tuple:
        if not isinstance(value, (tuple, list)):
            raise BadInputError("is not a list of numbers", where=where, value=value)
        return tuple(_number(v, float, info, f"{where}[{i}]") for i, v in enumerate(value))
    if wanted is bool or wanted is str:
        if not isinstance(value, wanted):
            raise BadInputError(f"is not a {wanted.__name__}", where=where, value=value)
        if info.options and value not in info.options:
            raise BadInputError("is not a choice", where=where, value=value, bound=info.bound)
        return value
    return _number(value, wanted, info, where)


def _hint(value: Any) -> str:
    """Return how to write a number that YAML takes for a text, as it does with 15e-6."""
    found = _NUMBER_AS_TEXT.fullmatch(value.strip()) if isinstance(value, str) else None
    if found is None:
        return ""
    mantissa, exponent = found["mantissa"], found["exponent"]
    if "." not in mantissa and exponent:
        mantissa += ".0"
    if exponent and exponent[0] not in "+-":
        exponent = "+" + exponent
    return f", written {mantissa}" + (f"e{exponent}" if exponent else "")


def _number(value: Any, wanted: type, info: FieldInfo, where: str) -> float | int:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not is_number:
        bound = info.bound + _hint(value)
        raise BadInputError("is not a number", where=where, value=value, bound=bound)
    if wanted is int and math.isfinite(value) and value != int(value):
        raise BadInputError("is not a whole number", where=where, value=value)
    result: float | int = (
        float(value) if wanted is float or not math.isfinite(value) else int(value)
    )
    too_low = result <= info.low if info.excludes_low else result < info.low
    if not math.isfinite(result) or too_low or result > info.high:
        raise BadInputError("is out of bounds", where=where, value=value, bound=info.bound)
    return result

"""Nested mappings as YAML gives them, by dotted name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from imotor_ros.errors import BadInputError


def flatten(mapping: Any, where: str, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """
    Yield the dotted names of a nested mapping, and their values.

    Parameters
    ----------
    mapping : mapping
        What was read.
    where : str
        Its name, for errors.
    prefix : str
        What is put before the names.

    Raises
    ------
    BadInputError
        If it is no mapping, or a key has no value.

    """
    if not isinstance(mapping, Mapping):
        raise BadInputError("is not a mapping", where=where, value=mapping)
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            yield from flatten(value, where, f"{prefix}{key}.")
        elif value is None:
            raise BadInputError("has no value", where=f"{where}: {prefix}{key}")
        else:
            yield f"{prefix}{key}", value

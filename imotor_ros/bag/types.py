"""Message classes and their bytes, from the definitions alone: no ROS needs to be installed."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

import imotor_ros
from imotor_ros.errors import BadInputError, UnreadableFileError

_PACKAGE = "imotor_msgs"


def find_definitions() -> Path:
    """
    Return the folder with the .msg files of `imotor_msgs`.

    That of the installed package comes first, because the nodes use it; then that of the
    checkout this package lies in.

    Raises
    ------
    UnreadableFileError
        If there is neither.

    """
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    places = [prefix / "share" / _PACKAGE / "msg" for prefix in prefixes]
    places.append(Path(imotor_ros.__file__).resolve().parents[1] / "msg_defs" / "msg")
    for place in places:
        if (place / "SampleBlock.msg").is_file():
            return place
    raise UnreadableFileError(
        "no message definitions",
        where=_PACKAGE,
        bound="a sourced installation, or one of: " + ", ".join(map(str, places)),
    )


class BagTypes:
    """
    Messages of a set of definitions: made from fields, written as CDR and read back.

    Satisfies `imotor_ros.contracts.messages.MessageTypes`.

    Parameters
    ----------
    store : Typestore
        The definitions.

    """

    def __init__(self, store: Typestore) -> None:
        self.store = store

    @classmethod
    def from_folder(cls, folder: Path) -> Self:
        """
        Return the standard types of Jazzy and those of `imotor_msgs` in a folder of .msg files.

        Raises
        ------
        UnreadableFileError
            If a definition does not parse.

        """
        store = get_typestore(Stores.ROS2_JAZZY)
        types: dict[str, Any] = {}
        for path in sorted(folder.glob("*.msg")):
            types.update(_parsed(path.read_text(encoding="utf-8"), f"{_PACKAGE}/msg/{path.stem}"))
        store.register(types)
        return cls(store)

    @classmethod
    def from_definitions(cls, definitions: Mapping[str, str]) -> Self:
        """
        Return the types that a bag defines itself.

        Parameters
        ----------
        definitions : mapping of str to str
            By type name, the definition in .msg form followed by those of the types it uses.

        Raises
        ------
        UnreadableFileError
            If a definition does not parse.

        """
        store = get_typestore(Stores.EMPTY)
        for name, text in definitions.items():
            try:
                store.register(_parsed(text, name))
            except TypesysError as error:
                raise UnreadableFileError("is defined twice", where=name) from error
        return cls(store)

    def message(self, type_name: str, **fields: Any) -> Any:
        """
        Return a message of the type, e.g. "imotor_msgs/msg/SampleBlock", with its fields.

        Raises
        ------
        BadInputError
            If there is no such type.

        """
        return self._known(type_name)(**fields)

    def floats(self, values: NDArray[np.float64] | Sequence[float]) -> NDArray[np.float64]:
        """Return what a float64[] field wants: a contiguous array."""
        return np.ascontiguousarray(values, dtype=np.float64)

    def serialize(self, message: Any) -> bytes:
        """
        Return the message as CDR: little-endian, with its encapsulation header, gaps zero.

        Raises
        ------
        BadInputError
            If a field cannot hold its value.

        """
        name = message.__msgtype__
        try:
            return bytes(self.store.serialize_cdr(message, name, little_endian=True))
        except (SerdeError, struct.error) as error:
            raise BadInputError(f"cannot be serialised ({error})", where=name) from error

    def canonical(self, data: bytes | memoryview, type_name: str) -> bytes:
        """
        Return the bytes of `serialize` for the content of `data`, whoever serialised it.

        Fast CDR leaves whatever was in memory in the gaps before aligned fields, and the
        middleware may fill messages up to a multiple of four bytes: the bytes that a
        subscription gets differ from run to run where their content does not.

        Raises
        ------
        BadInputError
            If there is no such type, or the data are not a message of it.

        """
        return self.serialize(self.deserialize(data, type_name))

    def deserialize(self, data: bytes | memoryview, type_name: str) -> Any:
        """
        Return the message in `data`; its arrays are read-only, unaligned views of `data`.

        Raises
        ------
        BadInputError
            If there is no such type, or the data are not a message of it.

        """
        self._known(type_name)
        try:
            return self.store.deserialize_cdr(memoryview(data), type_name)
        except (SerdeError, AssertionError) as error:
            raise BadInputError(f"does not decode ({error})", where=type_name) from error

    def definition(self, type_name: str) -> str:
        """Return the definition in .msg form, followed by those of the types it uses."""
        self._known(type_name)
        return self.store.generate_msgdef(type_name, ros_version=2)[0]

    def type_hash(self, type_name: str) -> str:
        """Return the type's hash as ROS 2 announces it ("RIHS01_...")."""
        self._known(type_name)
        return self.store.hash_rihs01(type_name)

    def _known(self, type_name: str) -> Any:
        try:
            return cast("Any", self.store.types[type_name])
        except KeyError:
            raise BadInputError("no such message type", where=type_name) from None


def _parsed(text: str, name: str) -> dict[str, Any]:
    try:
        return cast("dict[str, Any]", get_types_from_msg(text, name))
    except TypesysError as error:
        raise UnreadableFileError(f"definition does not parse ({error})", where=name) from error


@cache
def installed_types() -> BagTypes:
    """Return the types of the stand, from the definitions that `find_definitions` finds."""
    return BagTypes.from_folder(find_definitions())

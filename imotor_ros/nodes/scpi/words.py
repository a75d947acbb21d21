"""Samples as the binary words that cross the wire, and the blocks that hold them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imotor_ros.errors import BadInputError

_TYPES = {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"}
_ORDERS = {"little": "<", "big": ">"}


@dataclass(frozen=True)
class WordFormat:
    """
    How a sample is a binary word.

    Attributes
    ----------
    type : str
        "int8", "uint8", "int16" or "uint16".
    byte_order : str
        "little" or "big".
    zero : int
        Word of 0 V, in an upload.
    full_scale : int
        How much more the word of the highest voltage is, in an upload.

    """

    type: str
    byte_order: str = "little"
    zero: int = 0
    full_scale: int = 0

    @classmethod
    def from_mapping(cls, mapping: Any, where: str) -> WordFormat:
        """
        Return the format that a dialect gives.

        Raises
        ------
        BadInputError
            If a key is unknown or a value is none of a word's.

        """
        if not isinstance(mapping, Mapping):
            raise BadInputError("is not a mapping", where=where, value=mapping)
        for key in mapping:
            if key not in ("type", "byte_order", "zero", "full_scale"):
                raise BadInputError("is not a key", where=f"{where}.{key}")
        made = cls(**mapping)
        for key, options in (("type", _TYPES), ("byte_order", _ORDERS)):
            if getattr(made, key) not in options:
                raise BadInputError(
                    "is not a choice", where=f"{where}.{key}", value=getattr(made, key),
                    bound="one of " + ", ".join(options),
                )  # fmt: skip
        low, high = made.zero - made.full_scale, made.zero + made.full_scale
        if low < made.lowest or high > made.highest:
            raise BadInputError(
                "does not fit the type", where=where, value=(low, high),
                bound=f"{made.lowest} to {made.highest}",
            )  # fmt: skip
        return made

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the array whose bytes are the words."""
        return np.dtype(_ORDERS[self.byte_order] + _TYPES[self.type])

    @property
    def bits(self) -> int:
        """Bits of a word."""
        return 8 * self.dtype.itemsize

    @property
    def lowest(self) -> int:
        """Lowest word."""
        return int(np.iinfo(self.dtype).min)

    @property
    def highest(self) -> int:
        """Highest word."""
        return int(np.iinfo(self.dtype).max)

    def encode(self, samples: NDArray[np.float64]) -> bytes:
        """Return the words of samples between -1 and 1, rounded to the nearest."""
        words = self.zero + np.rint(samples * self.full_scale)
        return words.astype(self.dtype).tobytes()

    def decode(self, data: bytes) -> NDArray[np.float64]:
        """Return the words in bytes, whose number is that of whole words."""
        return np.frombuffer(data, self.dtype).astype(np.float64)

    def at_ends(self, words: NDArray[np.float64], bits: int) -> NDArray[np.bool_]:
        """Return which words are the first or last of a converter of so many bits."""
        step = 2 ** (self.bits - bits) if bits < self.bits else 1
        return (words < self.lowest + step) | (words > self.highest - step)


def block_of(payload: bytes) -> bytes:
    """
    Return a definite-length block of IEEE 488.2.

    Examples
    --------
    >>> block_of(b"abc")
    b'#13abc'

    """
    count = str(len(payload)).encode()
    return b"#" + str(len(count)).encode() + count + payload

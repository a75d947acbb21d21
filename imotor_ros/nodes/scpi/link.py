"""A connection to one instrument: what the rest needs of VISA, and nothing more."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class LinkError(Exception):
    """What became of a command or an answer, in words: "no answer within 5 s", "cut", ..."""


class Link(Protocol):
    """A connection: lines of text, and blocks of bytes; all of it may raise a `LinkError`."""

    def write(self, line: bytes) -> None:
        """Send a line; its end is added."""

    def read_line(self) -> str:
        """Return the next line of the answer, without its end."""

    def read_exactly(self, count: int) -> bytes:
        """Return so many bytes of the answer, whatever they are."""

    def close(self) -> None:
        """Let go of the connection."""


LinkMaker = Callable[[str, float, float], Link]
"""Makes a link from resource name, time-out of the connection and time-out of an answer (s)."""

"""Tasks for test_workers.py, in a module of their own that other processes can import."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

from imotor_ros.errors import BadInputError


@dataclass(frozen=True)
class Square:
    """Squares its number; some numbers end otherwise."""

    number: int
    ending: str = ""
    folder: Path = Path()

    def carry_out(self) -> Generator[str, None, int]:
        yield f"begin {self.number}"
        if self.ending == "bad input":
            raise BadInputError("is odd", where="number", value=self.number, bound="even")
        if self.ending == "failure":
            raise ZeroDivisionError("by nothing")
        if self.ending == "death":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.ending == "long":
            try:
                while True:
                    yield "still"
            finally:
                (self.folder / f"closed {self.number}").touch()
        return self.number**2

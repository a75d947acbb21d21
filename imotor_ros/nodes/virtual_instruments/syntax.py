"""Program messages: units, headers in long and short form, numeric suffixes, blocks of bytes."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

Handler = Callable[["Unit"], "str | bytes | None"]

UNDEFINED_HEADER = (-113, "Undefined header")
ILLEGAL_PARAMETER = (-224, "Illegal parameter value")
OUT_OF_RANGE = (-222, "Data out of range")
TOO_MUCH_DATA = (-223, "Too much data")
BLOCK_ERROR = (-161, "Invalid block data")

_TEXT_END = b"\n"


@dataclass(frozen=True)
class Unit:
    """One command or query: its header, numeric suffixes, parameters, and block of bytes."""

    header: str
    suffixes: tuple[int, ...]
    parameters: tuple[str, ...]
    block: bytes | None = None

    def number(self, place: int = 0) -> float:
        """Return a parameter as a number; ValueError if it is none."""
        if place >= len(self.parameters):
            raise ValueError("a parameter is missing")
        return float(self.parameters[place])

    def switch(self) -> bool:
        """Return ON or OFF."""
        word = self.parameters[0].upper() if self.parameters else ""
        if word not in ("ON", "OFF", "1", "0"):
            raise ValueError("neither ON nor OFF")
        return word in ("ON", "1")


class MessageReader:
    """Cuts a stream of bytes into program messages; an end of line in a block ends nothing."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[str, bytes | None]]:
        """Take bytes; yield the messages that are complete, as text and block."""
        self._bytes += data
        while (message := self._next()) is not None:
            yield message

    def _next(self) -> tuple[str, bytes | None] | None:
        buffer = self._bytes
        end, mark = buffer.find(_TEXT_END), buffer.find(b"#")
        if mark < 0 or (0 <= end < mark):
            if end < 0:
                return None
            text = bytes(buffer[:end]).decode("ascii", "replace")
            del buffer[: end + 1]
            return text.strip(), None
        if len(buffer) < mark + 2:
            return None
        digits = buffer[mark + 1] - ord("0")
        if len(buffer) < mark + 2 + digits:
            return None
        first = mark + 2 + digits
        count = int(bytes(buffer[mark + 2 : first]))
        if len(buffer) <= first + count:
            return None
        text = bytes(buffer[:mark]).decode("ascii", "replace")
        block = bytes(buffer[first : first + count])
        del buffer[: first + count + 1]
        return text.strip().rstrip(","), block


class CommandTable:
    """Headers as manuals print them, "SOURce#:FUNCtion", and what each of them does."""

    def __init__(self, commands: dict[str, Handler]) -> None:
        self._commands = [(re.compile(_pattern(header)), do) for header, do in commands.items()]

    def find(self, header: str) -> tuple[Handler, tuple[int, ...]] | None:
        """Return what does a header, and its numeric suffixes."""
        for pattern, do in self._commands:
            if found := pattern.fullmatch(header):
                return do, tuple(int(digits or 1) for digits in found.groups())
        return None


def _pattern(header: str) -> str:
    is_query = header.endswith("?")
    nodes = []
    for node in header.rstrip("?").split(":"):
        name = node.rstrip("#")
        short = "".join(letter for letter in name if not letter.islower())
        form = f"(?:{re.escape(name.upper())}|{re.escape(short.upper())})"
        nodes.append(form + (r"(\d*)" if node.endswith("#") else ""))
    return ":".join(nodes) + (r"\?" if is_query else "")


def split_units(text: str) -> Iterator[tuple[str, str]]:
    """
    Yield header, in capitals and from the root, and parameters of each unit of a message.

    Examples
    --------
    >>> list(split_units("WFMO:XIN?;yof?;:DAT:WID 2;*OPC?"))
    [('WFMO:XIN?', ''), ('WFMO:YOF?', ''), ('DAT:WID', '2'), ('*OPC?', '')]

    """
    path = ""
    for unit in re.findall(r'(?:"[^"]*"|[^;])+', text):
        header, _, rest = unit.strip().partition(" ")
        header = header.upper()
        if header.startswith("*"):
            yield header, rest.strip()
            continue
        full = header[1:] if header.startswith(":") else path + header
        path = full.rpartition(":")[0]
        path = path + ":" if path else ""
        yield full, rest.strip()


class Instrument:
    """
    A virtual instrument: takes messages, gives answers, keeps its errors.

    Parameters
    ----------
    identity : str
        Answer to ``*IDN?``.

    """

    def __init__(self, identity: str) -> None:
        self.identity = identity
        self.faults: dict[str, float] = {}
        self._errors: deque[tuple[int, str]] = deque(maxlen=20)
        self._table = CommandTable({**self.common(), **self.commands()})

    def commands(self) -> dict[str, Handler]:
        """Return what the instrument understands."""
        return {}

    def reset(self) -> None:
        """Go back to what it is after ``*RST``."""

    def common(self) -> dict[str, Handler]:
        """Return what every instrument understands."""
        return {
            "*IDN?": lambda _: "NOBODY,NOTHING,0,0" if "identity" in self.faults else self.identity,
            "*RST": self._on_reset,
            "*CLS": lambda _: self._errors.clear(),
            "*OPC?": lambda _: "1",
            "SYSTem:ERRor?": lambda _: '{:+d},"{}"'.format(*self.pop_error()),
        }

    def _on_reset(self, _unit: Unit) -> None:
        self.reset()

    def pop_error(self) -> tuple[int, str]:
        """Return the oldest error."""
        return self._errors.popleft() if self._errors else (0, "No error")

    def push_error(self, error: tuple[int, str], what: str = "") -> None:
        """Add an error to the queue."""
        code, text = error
        self._errors.append((code, f"{text}; {what}" if what else text))

    def execute(self, text: str, block: bytes | None) -> list[str | bytes]:
        """Carry out a message; return its answers."""
        answers = []
        for header, rest in split_units(text):
            found = self._table.find(header)
            if found is None:
                self.push_error(UNDEFINED_HEADER, header)
                continue
            do, suffixes = found
            parameters = tuple(part.strip() for part in rest.split(",")) if rest else ()
            try:
                answer = do(Unit(header, suffixes, parameters, block))
            except ValueError as error:
                self.push_error(ILLEGAL_PARAMETER, f"{header} {rest}: {error}")
                continue
            if answer is not None:
                answers.append(answer)
        return answers

"""What generator and oscilloscope have in common: identity, error queue, faults that say which."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from imotor_ros.errors import InstrumentError
from imotor_ros.nodes.scpi.link import Link, LinkError, LinkMaker
from imotor_ros.nodes.scpi.words import block_of

_MOST_ERRORS = 20
_SHOWN = 60


class _Dialect(Protocol):
    @property
    def family(self) -> str: ...
    @property
    def identity(self) -> str: ...
    @property
    def error_query(self) -> str: ...
    @property
    def no_error(self) -> str: ...


class Instrument:
    """
    A connection to an instrument that is what it should be.

    Parameters
    ----------
    name : str
        What faults call it, e.g. "generator".
    address : str
        Its resource name.
    serial : str
        Serial number that it must have; empty: any.
    dialect : GeneratorDialect or OscilloscopeDialect
        How to talk to it.
    make_link : callable
        Makes the connection.
    timeouts : tuple of float
        Of the connection and of an answer (s).

    Attributes
    ----------
    identity : str
        Make, model and serial number.

    Raises
    ------
    InstrumentError
        If there is no connection, or another instrument at its end.

    """

    def __init__(
        self,
        name: str,
        address: str,
        serial: str,
        dialect: _Dialect,
        make_link: LinkMaker,
        timeouts: tuple[float, float],
    ) -> None:
        self.name = f"{name} at {address}"
        self._dialect = dialect
        self._timeouts = timeouts
        self._link: Link | None = None
        try:
            self._link = make_link(address, *timeouts)
        except LinkError as error:
            raise InstrumentError(self.name, "", str(error)) from error
        try:
            self.identity = self._identify(serial)
        except InstrumentError:
            self.close()
            raise

    def _identify(self, serial: str) -> str:
        answer = self.ask("*IDN?")
        if not re.match(self._dialect.identity, answer):
            raise InstrumentError(
                self.name, "*IDN?", f"answered {answer!r}, expected a {self._dialect.family}"
            )
        maker, model, number, *_ = [part.strip() for part in answer.split(",")] + ["", ""]
        if serial and number != serial:
            raise InstrumentError(
                self.name, "*IDN?", f"has the serial number {number!r}, expected {serial!r}"
            )
        return f"{maker} {model} {number}".strip()

    def fault(self, command: str, what: str) -> InstrumentError:
        """Return the error that says which instrument, which command and what became of it."""
        shown = command if len(command) <= _SHOWN else command[: _SHOWN - 3] + "..."
        return InstrumentError(self.name, shown, what)

    def tell(self, command: str, payload: bytes | None = None) -> None:
        """Send a command, with a block of bytes after it if there is one."""
        if self._link is None:
            raise self.fault(command, "the connection is closed")
        line = command.encode()
        try:
            self._link.write(line if payload is None else line + block_of(payload))
        except LinkError as error:
            raise self.fault(command, str(error)) from error

    def tell_all(self, templates: Iterable[str], values: Mapping[str, Any]) -> None:
        """Send commands, filled in, and see that none was in error."""
        told = [fill(template, values) for template in templates]
        for command in told:
            self.tell(command)
        if told:
            self.check_errors("; ".join(told))

    def ask(self, query: str) -> str:
        """Return the answer to a query."""
        self.tell(query)
        assert self._link is not None
        try:
            return self._link.read_line()
        except LinkError as error:
            raise self.fault(query, str(error)) from error

    def ask_number(self, query: str) -> float:
        """Return the number that answers a query."""
        answer = self.ask(query)
        try:
            return float(answer)
        except ValueError as error:
            raise self.fault(query, f"answered {answer!r}, expected a number") from error

    def ask_block(self, query: str) -> bytes:
        """Return the payload of the block that answers a query."""
        self.tell(query)
        assert self._link is not None
        try:
            head = self._link.read_exactly(2)
            if head[:1] != b"#" or not b"1" <= head[1:] <= b"9":
                raise self.fault(query, f"answered {head!r}..., expected a block #<n><length>")
            digits = self._link.read_exactly(int(head[1:]))
            if not digits.isdigit():
                raise self.fault(query, f"a block has the length {digits!r}")
            payload = self._link.read_exactly(int(digits))
            self._link.read_line()
        except LinkError as error:
            raise self.fault(query, str(error)) from error
        return payload

    def check_errors(self, after: str) -> None:
        """
        Empty the error queue.

        Raises
        ------
        InstrumentError
            If there was something in it, with all of it.

        """
        found: list[str] = []
        while len(found) < _MOST_ERRORS:
            answer = self.ask(self._dialect.error_query)
            if re.match(self._dialect.no_error, answer):
                break
            found.append(answer)
        if found:
            raise self.fault(after, "error queue: " + "; ".join(found))

    def close(self) -> None:
        """Let go of the connection."""
        if self._link is not None:
            self._link.close()
            self._link = None


def fill(template: str, values: Mapping[str, Any]) -> str:
    """
    Return a command with its values.

    Examples
    --------
    >>> fill("SOUR{output}:FUNC:ARB:SRAT {rate}", {"output": 1, "rate": 1e6})
    'SOUR1:FUNC:ARB:SRAT 1000000'
    >>> fill("VOLT {peak_to_peak}", {"peak_to_peak": 0.1 + 0.2})
    'VOLT 0.3'

    """
    return template.format_map({name: _number(value) for name, value in values.items()})


def _number(value: Any) -> str:
    return format(value, ".12g") if isinstance(value, float) else str(value)

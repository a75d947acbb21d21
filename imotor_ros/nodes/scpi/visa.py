"""Links made with PyVISA and its backend in Python; the only module that knows them."""

from __future__ import annotations

import array
import fcntl
import os
import select
import socket
import termios
from typing import Any

import pyvisa
from pyvisa.resources import MessageBasedResource

from imotor_ros.nodes.scpi.link import LinkError

_PIECE = 1 << 16
_SENT_AT_ONCE = 1 << 12


class VisaLink:
    """
    A connection over VISA.

    Parameters
    ----------
    address : str
        Resource name, e.g. "TCPIP0::192.168.0.5::5025::SOCKET".
    connect_timeout, reply_timeout : float
        Longest waits (s).

    Raises
    ------
    LinkError
        If there is no connection.

    """

    def __init__(self, address: str, connect_timeout: float, reply_timeout: float) -> None:
        self._timeout = reply_timeout
        try:
            resource = pyvisa.ResourceManager("@py").open_resource(
                address, open_timeout=round(1000.0 * connect_timeout)
            )
        except Exception as error:  # the backend raises bare exceptions as well
            raise LinkError(f"no connection: {_words(error)}") from error
        if not isinstance(resource, MessageBasedResource):
            resource.close()
            raise LinkError("no connection: not a resource that takes messages")
        self._resource = resource
        resource.timeout = 1000.0 * reply_timeout
        resource.write_termination = ""
        self._check_connected()

    def _check_connected(self) -> None:
        """Ask the socket: the backend takes a connection refused for one made."""
        if (peer := self._socket()) is None:
            return
        if code := peer.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self.close()
            raise LinkError(f"no connection: {os.strerror(code)}")
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _socket(self) -> socket.socket | None:
        """Return the socket of a TCPIP SOCKET resource of the backend in Python."""
        sessions: Any = getattr(self._resource.visalib, "sessions", {})
        found = getattr(sessions.get(self._resource.session), "interface", None)
        return found if isinstance(found, socket.socket) else None

    def write(self, line: bytes) -> None:
        """Send a line; see `Link.write`."""
        data = line + b"\n"
        for start in range(0, len(data), _SENT_AT_ONCE):
            peer = self._socket()
            if peer is not None and not select.select([], [peer], [], self._timeout)[1]:
                raise LinkError(f"takes nothing for {self._timeout:g} s, after {start} bytes")
            try:
                self._resource.write_raw(data[start : start + _SENT_AT_ONCE])
            except (pyvisa.Error, OSError) as error:
                raise LinkError(self._reason(error)) from error

    def read_line(self) -> str:
        """Return a line; see `Link.read_line`."""
        self._resource.read_termination = "\n"
        self._await_bytes()
        try:
            return str(self._resource.read()).strip()
        except (pyvisa.Error, OSError, UnicodeDecodeError) as error:
            raise LinkError(self._reason(error)) from error

    def read_exactly(self, count: int) -> bytes:
        """Return bytes; see `Link.read_exactly`."""
        self._resource.read_termination = None
        data = bytearray()
        while len(data) < count:
            try:
                there = self._await_bytes()
                data += self._resource.read_bytes(min(there, count - len(data)))
            except LinkError as error:
                raise LinkError(f"{error} after {len(data)} of {count} bytes") from error
            except (pyvisa.Error, OSError) as error:
                raise LinkError(self._reason(error)) from error
        return bytes(data)

    def _await_bytes(self) -> int:
        """
        Wait for bytes of an answer; return how many can be read without waiting.

        The backend would spin until the time-out on a connection that was cut, and drop what
        came before.
        """
        if (peer := self._socket()) is None:
            return _PIECE
        sessions: Any = getattr(self._resource.visalib, "sessions", {})
        kept = len(getattr(sessions[self._resource.session], "_pending_buffer", b""))
        if not kept and not select.select([peer], [], [], self._timeout)[0]:
            raise LinkError(f"no answer within {self._timeout:g} s")
        there = array.array("i", [0])
        fcntl.ioctl(peer, termios.FIONREAD, there)
        if not kept + there[0]:
            raise LinkError("the connection was cut")
        return min(kept + there[0], _PIECE)

    def _reason(self, error: Exception) -> str:
        if self._is_cut() or isinstance(error, OSError):
            return "the connection was cut"
        timeout = pyvisa.constants.StatusCode.error_timeout
        if isinstance(error, pyvisa.VisaIOError) and error.error_code == timeout:
            return f"no answer within {self._timeout:g} s"
        return _words(error)

    def _is_cut(self) -> bool:
        """Whether the other end is closed: the backend shows that as a time-out."""
        if (peer := self._socket()) is None:
            return False
        try:
            return peer.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True

    def close(self) -> None:
        """Let go of the connection."""
        try:
            self._resource.close()
        except (pyvisa.Error, OSError):
            return


def _words(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__

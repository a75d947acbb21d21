"""The claim of a stand on its namespace, among those that one user runs on one host."""

from __future__ import annotations

import fcntl
import os
import re
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from imotor_ros.errors import BadInputError

DISCOVERY_TIME = 1.0
"""Time (s) in which nodes on this host find each other, with some to spare."""


class NamespaceClaim:
    """
    Keeps other stands of this user, host and domain out of a namespace until it is released.

    Discovery tells of other stands too, also of those on other hosts and of nodes started by hand,
    but only after some time, which is longer the busier the host is. A lock answers at once, and
    goes with the process that holds it.

    Parameters
    ----------
    namespace : str
        Namespace of the stand.

    Raises
    ------
    BadInputError
        If another stand has claimed it.

    """

    def __init__(self, namespace: str) -> None:
        self._file = _lock_file(namespace)
        if self._file is None:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.seek(0)
            holder = self._file.read().strip()
            self._file.close()
            raise namespace_taken(namespace, holder or "unknown process") from None
        with suppress(OSError):  # a full disk: the lock holds without a name in it
            self._file.truncate(0)
            self._file.write(f"process {os.getpid()}")
            self._file.flush()

    def release(self) -> None:
        """Leave the namespace to others."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()


def namespace_taken(
    namespace: str, holder: str, way_out: str = "another ROS_DOMAIN_ID"
) -> BadInputError:
    """Return the error of a namespace that somebody else has."""
    return BadInputError(
        "is taken by a stand that is running",
        where=f"namespace {namespace.rstrip('/')}",
        value=holder,
        bound=f"another --namespace, or {way_out}",
    )


def _lock_file(namespace: str) -> TextIO | None:
    """Open the file that stands for a namespace; None where there is no place for it."""
    folder = Path(tempfile.gettempdir()) / f"imotor-stands-{os.getuid()}"
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    name = re.sub(r"\W", "-", f"{domain}{namespace.rstrip('/')}")
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        return (folder / f"{name}.lock").open("a+")
    except OSError:
        return None

"""One set-up at a time, also after a kill."""

from __future__ import annotations

import errno
import fcntl
import os
import time
from collections.abc import Callable


class SetupLock:
    """
    A lock on a file, held until the process and every child that inherited it have ended.

    Children get the descriptor (`fileno`) on purpose: when a set-up is killed while pip still
    writes, the next one waits until pip has ended too.

    Parameters
    ----------
    path : str
        The file, made with its folder where they are missing.
    on_wait : callable
        Called once if another process holds the lock.
    """

    def __init__(self, path: str, on_wait: Callable[[], None]) -> None:
        self._path = path
        self._on_wait = on_wait
        self._descriptor = -1

    def __enter__(self) -> SetupLock:
        waited = False
        while True:
            descriptor = self._open()
            while not _try_lock(descriptor):
                if not waited:
                    self._on_wait()
                    waited = True
                time.sleep(0.1)
            if self._is_current(descriptor):
                self._descriptor = descriptor
                return self
            # `imotor clean` removed the file while we waited for it.
            os.close(descriptor)

    def __exit__(self, *_: object) -> None:
        os.close(self._descriptor)
        self._descriptor = -1

    def fileno(self) -> int:
        """Return the descriptor, for children to inherit."""
        return self._descriptor

    def _open(self) -> int:
        os.makedirs(os.path.dirname(self._path), exist_ok=True)
        return os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)

    def _is_current(self, descriptor: int) -> bool:
        try:
            return os.path.samestat(os.fstat(descriptor), os.stat(self._path))
        except FileNotFoundError:
            return False


def _try_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES, errno.EINTR):
            return False
        raise
    return True

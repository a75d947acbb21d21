"""Runs the programs of a set-up: output to the log, progress to the user, nothing left behind."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import time
from collections.abc import Callable, Mapping

from bootstrap.errors import SetupError
from bootstrap.lockfile import SetupLock

GRACE = 5.0
"""Time a program has to end after SIGTERM (s)."""


class Programs:
    """
    Runs programs one after the other.

    Parameters
    ----------
    log_path : str
        Where their output goes.
    lock : SetupLock
        Inherited by every program.
    show : callable
        Given the last line of output, and "" now and then while there is none.
    """

    def __init__(self, log_path: str, lock: SetupLock, show: Callable[[str], None]) -> None:
        self._log_path = log_path
        self._lock = lock
        self._show = show

    def run(self, command: list[str], environ: Mapping[str, str], folder: str) -> str:
        """
        Run a program to its end.

        Returns
        -------
        str
            Its output.

        Raises
        ------
        SetupError
            If it cannot be started or its exit code is not zero.
        """
        with open(self._log_path, "ab", buffering=0) as log:
            log.write(("\n$ " + " ".join(command) + "\n").encode())
            try:
                # A session of its own: when we are stopped, all of its descendants are.
                process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    env=dict(environ),
                    cwd=folder,
                    start_new_session=True,
                    pass_fds=[self._lock.fileno()],
                )
            except OSError as error:
                raise SetupError(f"cannot start {command[0]}: {error.strerror}") from error
            output = bytearray()
            try:
                self._follow(process, log.write, output)
            finally:
                _end(process)
        text = output.decode(errors="replace")
        if process.returncode:
            raise SetupError(explain(text, os.path.basename(command[0]), process.returncode))
        return text

    def _follow(
        self, process: subprocess.Popen[bytes], log: Callable[[bytes], object], output: bytearray
    ) -> None:
        assert process.stdout is not None
        last_line = ""
        with process.stdout as pipe:
            while True:
                ready, _, _ = select.select([pipe], [], [], 0.5)
                if ready:
                    chunk = os.read(pipe.fileno(), 65536)
                    if not chunk:
                        break
                    log(chunk)
                    output += chunk
                    lines = chunk.decode(errors="replace").split("\n")
                    last_line = next((line for line in reversed(lines) if line.strip()), last_line)
                self._show(last_line.strip())
        process.wait()


def _end(process: subprocess.Popen[bytes]) -> None:
    """Stop the program and all it started, if it still runs."""
    if process.poll() is not None:
        return
    os.killpg(process.pid, signal.SIGTERM)
    deadline = time.monotonic() + GRACE
    while process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


# What a failed program printed, and what that says to the user.
CAUSES = (
    ("No space left on device", "the disk is full"),
    ("Disk quota exceeded", "the disk quota is used up"),
    ("Read-only file system", "the checkout is on a read-only file system"),
    ("Permission denied", "a file cannot be written: permission denied"),
    ("Temporary failure in name resolution", "no network: the package index cannot be reached"),
    ("Name or service not known", "no network: the package index cannot be reached"),
    ("Network is unreachable", "no network: the package index cannot be reached"),
    ("Connection refused", "no network: the package index cannot be reached"),
    ("NewConnectionError", "no network: the package index cannot be reached"),
    ("ConnectTimeoutError", "no network: the package index cannot be reached"),
    ("CERTIFICATE_VERIFY_FAILED", "the package index's certificate is not trusted"),
    ("ensurepip is not available", "this Python lacks the venv module"),
    ("No matching distribution found for", "the package index cannot be reached, or lacks"),
    ("is not able to compile a simple test program", "the C or C++ compiler does not work"),
    ("Killed signal terminated program", "out of memory while compiling"),
)


def explain(output: str, program: str, code: int) -> str:
    """Return in one line why a program failed, from what it printed."""
    for text, cause in CAUSES:
        if text in output:
            if cause.endswith("lacks"):
                line = next(line for line in output.splitlines() if text in line)
                cause += " " + line.split(text)[1].split("(")[0].strip()
            return cause
    lines = [line.strip() for line in output.splitlines() if "error" in line.lower()]
    first_error = f": {lines[0]}" if lines else ""
    return f"{program} failed with exit code {code}{first_error}"

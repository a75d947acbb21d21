"""Shows on standard error how far a set-up is: a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import shutil
import sys
import time

REFRESH = 0.1
"""Shortest time between two live lines (s)."""


class Progress:
    """Numbered steps with their elapsed time."""

    def __init__(self) -> None:
        self._count = 0
        self._number = 0
        self._title = ""
        self._start = 0.0
        self._shown = 0.0
        self._is_live = sys.stderr.isatty()

    def expect(self, count: int) -> None:
        """Say how many steps there will be."""
        self._count = count

    def begin(self, title: str) -> None:
        """Start the next step."""
        self._number += 1
        self._title = title
        self._start = time.monotonic()
        if self._is_live:
            self.update("")
        else:
            say(f"{self._label()} ...")

    def update(self, detail: str) -> None:
        """Show what the step is at, and its elapsed time; on a terminal only."""
        now = time.monotonic()
        if not self._is_live or now < self._shown + REFRESH:
            return
        self._shown = now
        text = f"imotor: {self._label()}  {self._elapsed():3.0f} s  {detail}"
        width = shutil.get_terminal_size().columns - 1
        self._write("\r\033[K" + text[:width])

    def end(self, outcome: str = "done") -> None:
        """Finish the step."""
        if self._is_live:
            self._write("\r\033[K")
        say(f"{self._label()} {outcome}, {self._elapsed():.1f} s")

    def _label(self) -> str:
        return f"[{self._number}/{self._count}] {self._title}"

    def _elapsed(self) -> float:
        return time.monotonic() - self._start

    @staticmethod
    def _write(text: str) -> None:
        sys.stderr.write(text)
        sys.stderr.flush()


def say(text: str) -> None:
    """Print one line of the command's own on standard error."""
    print("imotor:", text, file=sys.stderr, flush=True)

"""Virtual instruments in a process of their own, and benches whose settings fit them."""

from __future__ import annotations

import json
import select
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[3]
SCPI = ROOT / "params" / "scpi"
START_TIMEOUT = 60.0


class Laboratory:
    """A process of virtual instruments, and its control socket."""

    def __init__(self, name: str) -> None:
        self.name = name
        command = [sys.executable, "-m", "imotor_ros.nodes.virtual_instruments.server"]
        command += [str(SCPI / "laboratories" / f"{name}.yaml"), "--any-port"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT, text=True)
        assert self._process.stdout is not None
        if not select.select([self._process.stdout], [], [], START_TIMEOUT)[0]:
            self._process.kill()
            pytest.fail(f"the virtual instruments told no ports within {START_TIMEOUT} s")
        self.ports: dict[str, int] = json.loads(self._process.stdout.readline())
        self._control = socket.create_connection(("127.0.0.1", self.ports["control"]), timeout=10)
        self._lines = self._control.makefile("rw", encoding="utf-8")

    def tell(self, line: str) -> dict[str, Any]:
        """Send a line to the control socket; return the answer: the state of the laboratory."""
        self._lines.write(line + "\n")
        self._lines.flush()
        answer: dict[str, Any] = json.loads(self._lines.readline())
        assert "error" not in answer, answer
        return answer

    def settings(self) -> dict[str, Any]:
        """Return the parameters of the bench that fits, with the ports as they are."""
        path = SCPI / "benches" / f"virtual_{self.name}.yaml"
        mapping: dict[str, Any] = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]
        for instrument in ("generator", "oscilloscope_1", "oscilloscope_2"):
            if instrument in self.ports:
                address = f"TCPIP0::127.0.0.1::{self.ports[instrument]}::SOCKET"
                mapping[instrument]["address"] = address
        return {**mapping, "reply_timeout": 2.0, "trigger_timeout": 1.5}

    def close(self) -> None:
        """End the process, as an operator does."""
        self._control.close()
        self._process.terminate()
        assert self._process.wait(10.0) == 0


def _laboratory(name: str) -> Iterator[Laboratory]:
    made = Laboratory(name)
    yield made
    made.close()


@pytest.fixture(scope="session")
def eight_inputs_process() -> Iterator[Laboratory]:
    """Start one generator and one oscilloscope of 12 bits."""
    yield from _laboratory("eight_inputs")


@pytest.fixture(scope="session")
def four_inputs_twice() -> Iterator[Laboratory]:
    """Start one generator with a small memory and two oscilloscopes of 8 bits."""
    yield from _laboratory("four_inputs_twice")


@pytest.fixture
def laboratory(eight_inputs_process: Laboratory) -> Iterator[Laboratory]:
    """Return the first laboratory; the faults of a test end with it."""
    yield eight_inputs_process
    eight_inputs_process.tell("clear")

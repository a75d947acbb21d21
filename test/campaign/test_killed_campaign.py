"""A campaign that is killed at any moment and resumed leaves the results of one that was not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

CAMPAIGN = """
name: short
identification: {steps: 5, step_time: 12.0e-3, lowest_amplitude: 0.4e-6, corrections: 1}
point: {drive: {hold_time: 0.02}, report_interval: 0.0, excitation: linear}
sweep:
  signal.harmonics: [2, 3]
"""

DEADLINE = 60.0
"""Longest time (s) that a campaign of a second may take on a busy machine."""

MOMENTS: dict[str, Callable[[Path], bool]] = {
    "the first bag is written": lambda out: any(out.glob("*/bag/*.mcap")),
    "there are results": lambda out: (out / "results.json").exists(),
}
"""More of them, on either bench: `imotor bench resuming`."""


def start(folder: Path, output: str, *more: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "imotor_ros.cli", "run", "short.yaml", "--bench", "sim"]
    return subprocess.Popen(
        [*command, "--output", output, *more], cwd=folder, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the results of an uninterrupted campaign in `whole`."""
    folder = tmp_path_factory.mktemp("killed")
    (folder / "short.yaml").write_text(CAMPAIGN)
    command = start(folder, "whole")
    _, errors = command.communicate(timeout=DEADLINE)
    assert command.returncode == 0, errors
    return folder


@pytest.mark.parametrize("moment", MOMENTS)
def test_killed_and_resumed_is_as_if_nothing_had_been(whole: Path, moment: str) -> None:
    output = moment.replace(" ", "-")
    command = start(whole, output)
    deadline = time.monotonic() + DEADLINE
    try:
        while not MOMENTS[moment](whole / output):
            assert time.monotonic() < deadline, f"waited {DEADLINE} s until {moment}"
            assert command.poll() is None, "it ended before"
            time.sleep(0.002)  # a poll of another process, with the deadline above
    finally:
        os.kill(command.pid, signal.SIGKILL)
        command.communicate(timeout=DEADLINE)
    resumed = start(whole, output, "--resume")
    _, errors = resumed.communicate(timeout=DEADLINE)
    assert resumed.returncode == 0, errors
    for name in ("results.json", "indicators.csv"):
        assert (whole / output / name).read_bytes() == (whole / "whole" / name).read_bytes()

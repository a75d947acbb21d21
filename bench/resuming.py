"""
Kill a campaign at many moments, resume it, and compare the results with those of one left alone.

    ./imotor bench resuming [sim|ros] [KILLS]

The moments are spread evenly over the time that the campaign takes. Both the results file and the
table of indicators must be the same to the last byte.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]

CAMPAIGN = """
name: short
identification: {steps: 5, step_time: 12.0e-3, lowest_amplitude: 0.4e-6, corrections: 1}
point: {drive: {hold_time: 0.02}, report_interval: 0.0}
sweep:
  signal.harmonics: [2, 3]
"""

DEADLINE = 300.0


def start(folder: Path, bench: str, output: str, *more: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "imotor_ros.cli", "run", "short.yaml", "--bench", bench]
    return subprocess.Popen(
        [*command, "--output", output, *more], cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip


def finish(process: subprocess.Popen[bytes]) -> None:
    _, errors = process.communicate(timeout=DEADLINE)
    if process.returncode:
        sys.exit(errors.decode())


def kill_after(process: subprocess.Popen[bytes], seconds: float) -> str:
    try:
        process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate(timeout=DEADLINE)
        return "killed"
    return "had ended"


def main() -> None:
    bench = sys.argv[1] if len(sys.argv) > 1 else "sim"
    kills = int(sys.argv[2]) if len(sys.argv) > 2 else 8
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "short.yaml").write_text(CAMPAIGN)
        begin = time.monotonic()
        finish(start(folder, bench, "whole"))
        length = time.monotonic() - begin
        print(f"{bench}: {length:.1f} s without interruption")
        same = 0
        for number in range(kills):
            moment, output = length * (number + 0.5) / kills, f"killed-{number}"
            state = kill_after(start(folder, bench, output), moment)
            finish(start(folder, bench, output, "--resume"))
            is_same = all(
                (folder / output / one).read_bytes() == (folder / "whole" / one).read_bytes()
                for one in ("results.json", "indicators.csv")
            )
            same += is_same
            print(f"{state} after {moment:.1f} s: {'the same' if is_same else 'DIFFERENT'} results")
        print(f"{same} of {kills} the same")
        sys.exit(same < kills)


if __name__ == "__main__":
    main()

"""
The same campaign on the virtual stand and on benches of virtual instruments, side by side.

Run as `python bench/scpi.py [OUTPUT] [EXCITATION]`. Starts the virtual instruments of both
laboratories at free ports, runs params/campaigns/scpi.yaml there as `./imotor run` does, and
without its driver on the virtual stand, and prints every indicator with the difference over the
combined uncertainty. Transducers and oscilloscopes have errors of their own in every laboratory, as
drawn from its seed; the motor is the same. EXCITATION is "linear" unless it is given: all benches
put out the same voltage, so that only what measures differs. With "corrected" each bench finds the
voltage that gives the wanted motion as its own vibrometer shows it: with calibrations that differ
by 1 % the motors really move differently, which no uncertainty of an indicator covers.
The exit code is 1 if a difference is larger than three uncertainties.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[1]
CAMPAIGN = ROOT / "params" / "campaigns" / "scpi.yaml"
SCPI = ROOT / "params" / "scpi"
LARGEST_RATIO = 3.0


def start(laboratory: str) -> tuple[subprocess.Popen[str], dict[str, int]]:
    """Start the instruments of a laboratory; return their process and ports."""
    command = [sys.executable, "-m", "imotor_ros.nodes.virtual_instruments.server"]
    command += [str(SCPI / "laboratories" / f"{laboratory}.yaml")]
    command += ["--any-port", "--campaign", str(CAMPAIGN)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None
    return process, json.loads(process.stdout.readline())


def bench_settings(laboratory: str, ports: dict[str, int]) -> dict[str, Any]:
    """Return the parameters of the driver, with the ports as they are."""
    text = (SCPI / "benches" / f"virtual_{laboratory}.yaml").read_text()
    settings: dict[str, Any] = yaml.safe_load(text)["/**"]["ros__parameters"]
    for name in ("generator", "oscilloscope_1", "oscilloscope_2"):
        if name in ports:
            settings[name]["address"] = f"TCPIP0::127.0.0.1::{ports[name]}::SOCKET"
    return settings


def campaign(settings: dict[str, Any] | None, path: Path, excitation: str) -> Path:
    """Write the campaign with this driver, or with none."""
    mapping = yaml.safe_load(CAMPAIGN.read_text())
    mapping["point"]["excitation"] = excitation
    mapping["stand"] = yaml.safe_load((CAMPAIGN.parent / mapping["stand"]).read_text())
    if settings is None:
        del mapping["driver"], mapping["driver_parameters"]
    else:
        mapping["driver_parameters"] = settings
    path.write_text(yaml.safe_dump(mapping))
    return path


def run(path: Path, output: Path) -> dict[str, dict[str, Any]]:
    """Run a campaign; return the indicators of its point by name."""
    command = [sys.executable, "-m", "imotor_ros.cli", "run", str(path), "--json"]
    command += ["--output", str(output)]
    command += ["--namespace", "/scpi_comparison"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stdout}\n{done.stderr}")
    results = json.loads((output / "results.json").read_text())
    performance = results["points"][0]["performance"]
    for warning in performance["warnings"]:
        print(f"{output.name}: {warning}")
    return {one["name"]: one for one in performance["indicators"]}


def compare(name: str, virtual: dict[str, Any], measured: dict[str, Any]) -> float:
    """Print the indicators of two runs; return the largest ratio."""
    print(f"\n{name}")
    print(f"{'indicator':<16} {'virtual stand':>30} {'instruments':>30} {'differ':>9} {'ratio':>6}")
    largest = 0.0
    for key, one in virtual.items():
        other = measured[key]
        if one["value"] is None or other["value"] is None:
            print(
                f"{key:<16} {one['value']!s:>24} {other['value']!s:>24} {other.get('reason', '')}"
            )
            continue
        difference = other["value"] - one["value"]
        spread = (one["uncertainty"] ** 2 + other["uncertainty"] ** 2) ** 0.5
        ratio = abs(difference) / spread if spread else 0.0
        largest = max(largest, ratio)
        texts = [f"{x['value']:.5g} +- {x['uncertainty']:.2g} {x['unit']}" for x in (one, other)]
        print(f"{key:<16} {texts[0]:>30} {texts[1]:>30} {difference:>9.2g} {ratio:>6.2f}")
    return largest


def main() -> int:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp(prefix="scpi-"))
    folder.mkdir(parents=True, exist_ok=True)
    excitation = sys.argv[2] if len(sys.argv) > 2 else "linear"
    virtual = run(campaign(None, folder / "virtual.yaml", excitation), folder / "virtual")
    largest = 0.0
    for laboratory in ("eight_inputs", "four_inputs_twice"):
        process, ports = start(laboratory)
        try:
            settings = bench_settings(laboratory, ports)
            path = campaign(settings, folder / f"{laboratory}.yaml", excitation)
            measured = run(path, folder / laboratory)
        finally:
            process.terminate()
            process.wait(10.0)
        largest = max(largest, compare(laboratory, virtual, measured))
    print(f"\nlargest difference: {largest:.2f} combined uncertainties")
    return 0 if largest <= LARGEST_RATIO else 1


if __name__ == "__main__":
    sys.exit(main())

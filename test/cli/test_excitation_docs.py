"""What docs/excitation.md says is what the commands in it give."""

from __future__ import annotations

import importlib.util
import json
import math
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from imotor_ros.cli.main import VERBS, main

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "excitation.md").read_text(encoding="utf-8")
TABLE_1 = ["excite", "--harmonics", "4", "--max-frequency", "18500", "--bench", "sim"]


@pytest.fixture(scope="module")
def bench() -> ModuleType:
    """Return bench/excitation.py."""
    name = "bench_excitation"
    spec = importlib.util.spec_from_file_location(name, ROOT / "bench" / "excitation.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def cells(tones: dict[str, Any]) -> list[str]:
    """Return amplitudes and phases as the paper prints them: those of cosines."""
    phases = [
        math.degrees(math.remainder(phase + 0.5 * math.pi * k, 2.0 * math.pi))
        for k, phase in enumerate(tones["phases"])
    ]
    texts = [f"{size:.2f} V" for size in tones["amplitudes"]]
    others = [f"{text}, {phase:.1f}°" for text, phase in zip(texts, phases, strict=True)]
    return [texts[0], *others[1:]]


def row_of(title: str) -> list[str]:
    """Return the cells of a row of a table in the page."""
    line = next(line for line in PAGE.splitlines() if line.startswith(f"| {title} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


def test_table_1_is_what_the_command_prints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "./imotor " + " ".join([*TABLE_1[:-2], "--suppressed", "0", *TABLE_1[-2:]]) in PAGE
    folder = tmp_path / "alone"
    assert main([*TABLE_1, "--suppressed", "0", "--output", str(folder)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[-1].startswith("result: ")
    block = "\n".join(f"    {line}" for line in printed[:-1])
    assert block in PAGE
    found = json.loads((folder / "excitation.json").read_text())
    assert cells(found["linear_model"]) == row_of("here, linear model")
    assert cells(found["corrected"]) == row_of("here, corrected")


def test_row_with_harmonics_at_rest_is_that_of_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*TABLE_1, "--output", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert cells(found["corrected"]) == row_of("here, harmonics 5 to 12 at rest")
    assert len(found["suppressed"]["frequencies"]) == 8


@pytest.mark.parametrize(
    ("motor", "harmonics", "frequency"), [("paper", 4, 9250.0), ("small_stack", 2, 18500.0)]
)
def test_validation_table_bounds_what_the_script_finds(
    bench: ModuleType, motor: str, harmonics: int, frequency: float
) -> None:
    """Two of the hundred seeds: their errors are among those whose largest are printed."""
    pattern = rf"^    {motor} +{harmonics} +{frequency} .*$"
    row = re.search(pattern, PAGE, re.MULTILINE)
    assert row is not None
    first, second, third, other, most, *worst = row.group().split()[3:]
    assert int(first) + int(second) + int(third) == 100
    assert other == "-"
    for one in bench.try_seeds((motor, harmonics, frequency, range(1, 3))):
        assert int((first, second, third)[max(one.reached, 1) - 1]) > 0
        assert one.cycles <= int(most)
        found = [
            100 * one.measured[0], math.degrees(one.measured[1]), 100 * one.rest[0],
            math.degrees(one.rest[1]), 100 * one.true[0], 100 * one.unwanted,
        ]  # fmt: skip
        # half of the last digit printed
        for value, printed, digit in zip(found, worst, (*(5 * (0.01,)), 0.1), strict=True):
            assert value <= float(printed) + 0.5 * digit
        assert one.measured[0] <= 0.01
        assert one.measured[1] <= math.radians(1.0)


def test_validation_covers_the_grid(bench: ModuleType) -> None:
    rows = re.findall(r"^    (paper|small_stack) +(\d) +(\d+\.\d) ", PAGE, re.MULTILINE)
    expected = {(m, str(n), str(f)) for m in bench.MOTORS for n, f in bench.GRID}
    assert set(rows) == expected
    assert len(rows) == 24


def test_refusal_in_the_page_is_that_of_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = "excite --harmonics 2 --max-frequency 18500 --stroke 25e-6 --bench sim"
    assert f"    ./imotor {command}\n" in PAGE
    assert main([*command.split(), "--output", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err.strip()
    assert f"`{error[error.index('ramp_up') :]}`" in PAGE


def test_commands_and_pictures_exist() -> None:
    commands = re.findall(r"^    \./imotor (.*)$", PAGE, re.MULTILINE)
    assert len(commands) >= 8
    for command in commands:
        verb, what, *_ = command.split()
        assert verb in VERBS
        assert verb != "bench" or (ROOT / "bench" / f"{what}.py").exists()
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", PAGE)
    assert len(pictures) == 2
    for picture in pictures:
        size = (ROOT / "docs" / picture).stat().st_size
        assert 1000 < size < 150_000

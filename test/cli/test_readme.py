"""What README says is what the commands print."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from imotor_ros.cli.main import VERBS, main

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def indicator_table(text: str) -> list[list[str]]:
    """Return the words of the lines from "steady-state velocity" to the number of lost samples."""
    lines = [line.strip() for line in text.splitlines()]
    start = next(i for i, line in enumerate(lines) if line.startswith("steady-state velocity"))
    return [line.split() for line in lines[start : start + 7]]


def test_indicators_of_the_demonstration_are_those_in_readme(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--bench", "sim", "--output", str(tmp_path / "demo")]) == 0
    assert indicator_table(capsys.readouterr().out) == indicator_table(README)


def test_verbs_in_readme_exist() -> None:
    commands = [part for part in README.split("`") if part.startswith("./imotor ")]
    assert len(commands) > 5
    assert {command.split()[1] for command in commands} <= set(VERBS) | {"shell-env"}


@pytest.mark.parametrize(
    "command", [c for c in README.split("`") if c.startswith(("./imotor signal", "./imotor sim"))]
)
def test_quick_commands_in_readme_work(command: str) -> None:
    assert main(shlex.split(command)[1:]) == 0

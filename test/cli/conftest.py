"""The command line, called in this process."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.cli.main import main

CAMPAIGN = """
name: short
description: two runs of some hundredths of a second
point:
  drive: {hold_time: 0.03}
  stand: {motor: {load: {upper_stop: 1.0e-3}}}
  evaluator: {guard_periods: 3}
sweep:
  seed: [1, 2]
"""


@dataclass(frozen=True)
class Answer:
    """What a command gave: exit code, standard output and standard error."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        """The one JSON object on standard output; NaN and infinity are not JSON."""

        def refuse(text: str) -> None:
            pytest.fail(f"{text} is not JSON")

        content = json.loads(self.out, parse_constant=refuse)
        assert isinstance(content, dict)
        assert self.out.count("\n") == 1
        assert self.out.endswith("\n")
        return content

    @property
    def error(self) -> str:
        """The one line of an error."""
        assert self.out == ""
        assert self.err.startswith("error: ")
        assert self.err.count("\n") == 1, self.err
        return self.err.removeprefix("error: ").rstrip("\n")


@pytest.fixture
def imotor(capsys: pytest.CaptureFixture[str]) -> Callable[..., Answer]:
    """Return a function that runs a verb."""

    def call(*arguments: object) -> Answer:
        capsys.readouterr()
        code = main([str(one) for one in arguments])
        return Answer(code, *capsys.readouterr())

    return call


@pytest.fixture(scope="session")
def campaign_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign of two short points."""
    path = tmp_path_factory.mktemp("campaign") / "short.yaml"
    path.write_text(CAMPAIGN)
    return path


@pytest.fixture(scope="session")
def results_folder(campaign_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Carry out the campaign in this process; return the folder of its results."""
    output = tmp_path_factory.mktemp("results") / "out"
    assert main(["run", str(campaign_file), "--bench", "sim", "--output", str(output)]) == 0
    return output


@pytest.fixture(scope="session")
def bag(results_folder: Path) -> Path:
    """Return the bag of the first point."""
    return results_folder / "seed-1" / "bag"

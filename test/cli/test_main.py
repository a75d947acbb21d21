"""What all verbs have in common: help, exit codes, errors in one line, pipes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest

from bootstrap.__main__ import OWN_VERBS
from imotor_ros.cli import main as command
from imotor_ros.cli.main import CHECKOUT_VERBS, VERBS, main
from imotor_ros.errors import (
    BadInputError,
    DeadlineError,
    ImotorError,
    NodeDiedError,
    SolverError,
)

Imotor = Callable[..., Any]


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"], ["help"]])
def test_overview_lists_every_verb(imotor: Imotor, arguments: list[str]) -> None:
    answer = imotor(*arguments)
    assert answer.code == 0
    first_words = {line.split()[0] for line in answer.out.splitlines() if line.startswith("  ")}
    assert first_words == {*VERBS, *CHECKOUT_VERBS}


def test_verbs_of_the_checkout_are_those_of_its_command() -> None:
    assert set(CHECKOUT_VERBS) == set(OWN_VERBS)


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_every_verb(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main([verb, "--help"])
    assert caught.value.code == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"usage: imotor {verb}")
    assert "--json" in out
    assert err == ""


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["fly"], "imotor: is not a verb, got 'fly', expected one of demo, run, signal"),
        (["--version"], "imotor: is not a verb, got '--version'"),
        (["signal"], "imotor signal: the following arguments are required: --harmonics"),
        (["signal", "--harmonics", "two"], "argument --harmonics: invalid int value: 'two'"),
        (["signal", "--harm", "2"], "imotor signal: "),
        (["signal", "--harmonics", "2", "--colour"], "unrecognized arguments: --colour"),
        (
            ["simulate", "--harmonics", "2", "--max-frequency", "9e3", "--friction", "ice"],
            "--friction: is neither a law nor a file, got 'ice'",
        ),
        (["run"], "imotor run: the following arguments are required: CAMPAIGN.yaml"),
        (["run", "x.yaml", "--bench", "paper"], "argument --bench: invalid choice: 'paper'"),
        (["evaluate", "a", "b"], "imotor evaluate: unrecognized arguments: b"),
    ],
)
def test_bad_usage_is_one_line_and_code_2(imotor: Imotor, arguments: list[str], text: str) -> None:
    answer = imotor(*arguments)
    assert answer.code == 2
    assert text in answer.error


@pytest.mark.parametrize(
    ("raised", "code", "text"),
    [
        (BadInputError("is bad", where="here", value=3, bound="> 4 m"), 2,
         "here: is bad, got 3, expected > 4 m"),
        (SolverError("cannot go on"), 1, "cannot go on"),
        (DeadlineError("the plant", 3.0), 1, "waited 3 s for the plant, in vain"),
        (ImotorError("anything"), 1, "anything"),
    ],
)  # fmt: skip
def test_errors_become_exit_codes(
    imotor: Imotor, monkeypatch: pytest.MonkeyPatch, raised: ImotorError, code: int, text: str
) -> None:
    def fail(_: list[str]) -> int:
        raise raised

    monkeypatch.setattr(command, "_dispatch", fail)
    answer = imotor("signal")
    assert answer.code == code
    assert answer.error == text


def test_last_lines_of_a_dead_node_follow_its_error(
    imotor: Imotor, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: list[str]) -> int:
        raise NodeDiedError("plant", "exit code 3", ("one", "two"))

    monkeypatch.setattr(command, "_dispatch", fail)
    answer = imotor("run")
    assert answer.code == 1
    assert answer.err.splitlines() == [
        "error: node plant ended during the run (exit code 3); its last lines:",
        "    one",
        "    two",
    ]


def test_interrupt_is_code_130(imotor: Imotor, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: list[str]) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "_dispatch", fail)
    answer = imotor("run")
    assert (answer.code, answer.out, answer.err) == (130, "", "interrupted\n")


def test_reader_that_goes_away_is_no_traceback() -> None:
    """As in `imotor signal ... | head -0`: the output meets a closed pipe."""
    process = subprocess.Popen(
        [sys.executable, "-m", "imotor_ros.cli", "signal", "--harmonics", "900"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == b""
    assert process.wait(timeout=30.0) == 1

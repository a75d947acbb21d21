"""
The command line: one module per verb, imported only when it is called.

Exit codes: 0 done, 1 failed, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import threading
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, NoReturn

from imotor_ros.cli.option_names import in_words_of
from imotor_ros.errors import BadInputError, ImotorError

VERBS = {
    "demo": "run the demonstration on the ROS graph, from drive voltage to indicators",
    "run": "carry out a campaign",
    "signal": "print the harmonics of a drive signal",
    "simulate": "predict the indicators with a motor model, without instruments",
    "frequency-response": "measure the rod velocity over the voltage of a motor",
    "excite": "find the voltage that makes the rod of a motor move as wanted",
    "force": "predict the force on springs, and the velocity under constant loads",
    "identify-friction": "find the friction law of a motor from a sine of stepped amplitude",
    "sweep": "predict every point of a campaign with the motor model, on all cores",
    "report": "write the report of a campaign again",
    "figures": "make a page with the figures of the paper",
    "evaluate": "compute the indicators of a recorded run",
    "replay": "play a recorded run through the topics to the evaluator",
    "recover": "mend a bag whose recorder was killed",
    "info": "describe a recorded run",
    "export": "write the waveforms of a recorded run for PlotJuggler, Foxglove or a table",
    "check-driver": "check that a driver does what the stand asks of one",
    "bench": "run a benchmark of bench/",
}

CHECKOUT_VERBS = {
    "setup": "make the environment, which every other verb does as well when it is missing",
    "test": "run linters, type check, layer contracts and tests",
    "shell-env": "print what a shell has to evaluate to run nodes by hand",
    "clean": "remove the environment",
}
"""What the command `./imotor` of a checkout does before it comes here."""

_NEGATIVE_NUMBER = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, and that knows numbers like -1e-2."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = _NEGATIVE_NUMBER

    def error(self, message: str) -> NoReturn:
        """Report bad usage."""
        raise BadInputError(message, where=self.prog)


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run one verb.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line without the name of the program; by default that of the process.

    Returns
    -------
    int
        Exit code.

    """
    try:
        code = _dispatch(list(sys.argv[1:] if arguments is None else arguments))
        sys.stdout.flush()
        return code
    except BadInputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except ImotorError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            return _end_quietly()
        print(f"error: {error.filename or 'system'}: {error.strerror or error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def _end_quietly() -> int:
    # what is still in the buffer would be written, and fail again, at the interpreter's end
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 1


def _dispatch(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(_overview())
        return 0
    verb, *rest = arguments
    if verb not in VERBS:
        raise BadInputError(
            "is not a verb", where="imotor", value=verb, bound="one of " + ", ".join(VERBS)
        )
    if verb == "run" and "sim" in rest:
        _prepare_workers()
    module = import_module(f"imotor_ros.cli.{verb.replace('-', '_')}")
    parser = Parser(
        prog=f"imotor {verb}",
        description=module.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    module.add_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    options = parser.parse_args(rest)
    try:
        result: int = module.run(options)
    except BadInputError as error:
        raise in_words_of(parser, error) from error
    return result


def _prepare_workers() -> None:
    """Start what takes as long as all of our imports beside them."""
    if threading.current_thread() is threading.main_thread():
        import_module("imotor_ros.campaign.workers").prepare_workers()


def _overview() -> str:
    width = max(map(len, VERBS | CHECKOUT_VERBS))

    def lines(verbs: Mapping[str, str]) -> list[str]:
        return [f"  {verb:<{width}}  {text}" for verb, text in verbs.items()]

    return "\n".join(
        (
            "usage: imotor VERB [options]",
            "",
            "Test stand for piezoelectric inertia motors.",
            "",
            *lines(VERBS),
            "",
            "In a checkout, as ./imotor VERB:",
            "",
            *lines(CHECKOUT_VERBS),
            "",
            "imotor VERB --help tells more of one verb of the first list.",
        )
    )

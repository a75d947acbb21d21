"""Runs `imotor VERB ...`: sets up what is missing, then becomes the verb."""

from __future__ import annotations

import os
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.realpath(__file__))))

from bootstrap import environment
from bootstrap.layout import Layout, find_layout
from bootstrap.state import State

# Sections of the lock file that a verb needs beside the usual ones.
EXTRAS = {"test": ("test", "dask"), "bench": ("bench",)}

# The same for an option of any verb.
EXTRAS_OF_OPTIONS = {"--scheduler": ("dask",)}

# The verbs that concern the environment itself; all others are imotor_ros.cli's.
OWN_VERBS = ("clean", "setup", "shell-env", "test")


def main(arguments: list[str]) -> int:
    """Run the command line and return its exit code, if it returns at all."""
    verb = arguments[0] if arguments else ""
    layout = find_layout(os.environ)
    changed = {}
    if verb != "clean":
        version = prepare(layout, find_extras(arguments))
        if not version:
            return 1
        changed = environment.changed_variables(layout, version, os.environ)
    if verb in OWN_VERBS:
        from bootstrap import verbs

        return verbs.run(arguments, layout, changed)
    os.environ.update(changed)
    # In place of this process, so that signals reach the verb.
    return os.execv(layout.venv_python, [layout.venv_python, "-m", "imotor_ros.cli", *arguments])


def find_extras(arguments: list[str]) -> tuple[str, ...]:
    """Return the sections of the lock file that a command line needs beside the usual ones."""
    extras = EXTRAS.get(arguments[0], ()) if arguments else ()
    for argument in arguments[1:]:
        extras += EXTRAS_OF_OPTIONS.get(argument.split("=")[0], ())
    return extras


def prepare(layout: Layout, extras: tuple[str, ...]) -> str:
    """Set up what is out of date; return the environment's Python version, "" after a failure."""
    state = State.read(layout.state_file)
    chosen = os.environ.get("IMOTOR_PYTHON", "")
    is_chosen = not chosen or os.path.realpath(chosen) == state.interpreter
    if is_chosen and state.is_current(layout, extras):
        return state.version
    from bootstrap import installation

    return installation.run(layout, extras, chosen)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

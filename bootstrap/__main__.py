"""Runs `imotor VERB ...`: sets up what is missing, then becomes the verb."""

from __future__ import annotations

import os
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.realpath(__file__))))

from bootstrap import environment  # noqa: E402
from bootstrap.layout import Layout, find_layout  # noqa: E402
from bootstrap.state import State  # noqa: E402

# Sections of the lock file that a verb needs beside the usual ones.
EXTRAS = {"test": ("test",), "bench": ("bench",)}


def main(arguments: list[str]) -> int:
    """Run the command line and return its exit code, if it returns at all."""
    verb = arguments[0] if arguments else ""
    layout = find_layout(os.environ)
    if verb == "clean":
        from bootstrap import verbs

        return verbs.clean()

    version = prepare(layout, EXTRAS.get(verb, ()))
    if not version:
        return 1
    if verb == "setup":
        return 0
    changed = environment.changed_variables(layout, version, os.environ)
    if verb == "shell-env":
        from bootstrap import verbs

        return verbs.shell_env(layout, changed)
    os.environ.update(changed)
    if verb == "test":
        from bootstrap import verbs

        return verbs.test(layout, arguments[1:])
    os.execv(layout.venv_python, [layout.venv_python, "-m", "imotor_ros.cli", *arguments])


def prepare(layout: Layout, extras: tuple[str, ...]) -> str:
    """Set up what is out of date; return the environment's Python version, "" after a failure."""
    state = State.read(layout.state_file)
    chosen = os.environ.get("IMOTOR_PYTHON")
    is_chosen = not chosen or os.path.realpath(chosen) == state.interpreter
    if is_chosen and state.is_current(layout, extras):
        return state.version
    from bootstrap import installation

    return installation.run(layout, extras, chosen)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

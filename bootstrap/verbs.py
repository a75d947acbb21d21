"""The verbs that concern the environment itself."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping

from bootstrap.environment import prepend
from bootstrap.layout import ROOT, SOURCED, WHEELS, Layout
from bootstrap.lockfile import SetupLock
from bootstrap.progress import say

CHECKS = (
    ("ruff", ["-m", "ruff", "check", "."]),
    ("mypy", ["-m", "mypy"]),
    (
        "import-linter",
        ["-c", "from importlinter.cli import lint_imports_command as run; run()", "--no-logo"],
    ),
)

# More than four stands of seven nodes each at a time help nobody.
ON_ALL_CORES = ("-n", str(min(4, os.cpu_count() or 1)), "--dist", "loadfile")


def run(arguments: list[str], layout: Layout, changed: Mapping[str, str]) -> int:
    """
    Run one of the verbs and return its exit code.

    Parameters
    ----------
    arguments : list of str
        The verb and what follows it.
    layout : Layout
        The environment.
    changed : mapping
        Variables of the environment that the user's shell lacks.
    """
    verb = arguments[0]
    if verb == "clean":
        return clean()
    if verb == "shell-env":
        return shell_env(layout, changed)
    if verb == "test":
        os.environ.update(changed)
        return test(layout, arguments[1:])
    say(f"ready; this environment's Python is {layout.venv_python}")
    return 0


def clean() -> int:
    """Remove everything a set-up made, once no set-up is running."""
    for kind in (WHEELS, SOURCED):
        layout = Layout(kind)
        if os.path.isdir(layout.home):
            with SetupLock(layout.lock_file, _say_waiting):
                shutil.rmtree(layout.home)
    folder = os.path.join(ROOT, ".imotor")
    if os.path.isdir(folder):
        shutil.rmtree(folder)
        say(f"removed {folder}")
    return 0


def shell_env(layout: Layout, changed: Mapping[str, str]) -> int:
    """Print what a shell has to evaluate to run the executables by hand."""
    programs = os.path.join(layout.venv, "bin")
    prefixes = [layout.overlay] if layout.kind == SOURCED else [layout.overlay, layout.venv]
    for_a_shell = {
        "PATH": prepend([programs], os.environ.get("PATH", os.defpath)),
        "CMAKE_PREFIX_PATH": prepend(prefixes, os.environ.get("CMAKE_PREFIX_PATH", "")),
    }
    for name, value in {**changed, **for_a_shell}.items():
        print(f"export {name}={shlex.quote(value)}")
    return 0


def test(layout: Layout, arguments: list[str]) -> int:
    """
    Run linters, type check, layer contracts and tests; pytest comes last.

    Parameters
    ----------
    layout : Layout
        The environment.
    arguments : list of str
        Handed to pytest; without any, all tests run, spread over the cores.

    Returns
    -------
    int
        Zero if all of them passed.
    """
    failed = []
    for name, command in CHECKS:
        print(f"== {name}", flush=True)
        if _run([layout.venv_python, *command]):
            failed.append(name)
    if failed:
        print(f"== failed before the tests: {', '.join(failed)}", flush=True)
    print("== pytest", flush=True)
    code = _run([layout.venv_python, "-m", "pytest", *(arguments or ON_ALL_CORES)])
    return code or (1 if failed else 0)


def _say_waiting() -> None:
    say("a set-up is running, waiting for it to end")


def _run(command: list[str]) -> int:
    """Run a command in the checkout, handing signals on to it."""
    process = subprocess.Popen(command, cwd=ROOT)
    # The terminal sends Ctrl-C to the command as well: only wait for its end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, _: process.send_signal(number))
    try:
        code = process.wait()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if code < 0:
        sys.exit(128 - code)
    return code

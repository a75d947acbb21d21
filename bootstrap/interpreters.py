"""Finds a Python for the virtual environment and the programs that build the messages."""

from __future__ import annotations

import glob
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping

from bootstrap.errors import SetupError
from bootstrap.layout import SOURCED, Layout

VERSIONS = ("3.11", "3.12")
"""The versions for which every package of the lock file has a wheel."""

PROBE = """
import importlib.util, json, os, platform, sys, sysconfig
print(json.dumps({
    "executable": os.path.realpath(getattr(sys, "_base_executable", sys.executable)),
    "version": "%d.%d" % sys.version_info[:2],
    "implementation": platform.python_implementation(),
    "machine": platform.machine() if sys.maxsize > 2**32 else "32-bit",
    "venv": bool(importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip")),
    "headers": os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")),
}))
"""


class Interpreter:
    """A Python that the virtual environment can be made from."""

    def __init__(self, executable: str, version: str) -> None:
        self.executable = executable
        self.version = version


def find_interpreter(
    layout: Layout, environ: Mapping[str, str], chosen: str, recorded: str
) -> Interpreter:
    """
    Return the Python to make the virtual environment from.

    Parameters
    ----------
    layout : Layout
        The environment; over a sourced ROS its `python3` is the only candidate.
    environ : mapping
        The user's variables.
    chosen : str
        What the user asks for (IMOTOR_PYTHON): where not "", the only candidate.
    recorded : str
        The one that an earlier set-up used, kept while it is still good.

    Raises
    ------
    SetupError
        If there is none, with what was found instead.
    """
    rejected = []
    for candidate in _candidates(layout, environ, chosen, recorded):
        found = probe(candidate, environ)
        if not found:
            continue
        fault = find_fault(found)
        if not fault:
            return Interpreter(found["executable"], found["version"])
        remark = f"{found['executable']} {fault}"
        if remark not in rejected:
            rejected.append(remark)
    looked_for = chosen or "python3, python3.12 and python3.11 on PATH and under ~/.pyenv"
    raise SetupError(
        f"no suitable Python: CPython {' or '.join(VERSIONS)} for x86-64 with headers and venv "
        f"is needed; looked for {looked_for}; found {'; '.join(rejected) or 'none'}"
    )


def find_fault(found: Mapping[str, str]) -> str:
    """Return what makes a probed Python unsuitable, "" if nothing does."""
    version = found["version"]
    if found["implementation"] != "CPython" or version not in VERSIONS:
        return f"(is {found['implementation']} {version})"
    if found["machine"] != "x86_64":
        return f"(is for {found['machine']})"
    if not found["venv"]:
        return f"(lacks venv: on Debian and Ubuntu, apt install python{version}-venv)"
    if not found["headers"]:
        return f"(lacks Python.h: on Debian and Ubuntu, apt install python{version}-dev)"
    return ""


def probe(python: str, environ: Mapping[str, str]) -> dict[str, str] | None:
    """Ask a Python what it is; return None if it does not answer."""
    try:
        answer = subprocess.run(
            [python, "-I", "-c", PROBE],
            env=dict(environ),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL,
            timeout=30,
            check=True,
        )
        found: dict[str, str] = json.loads(answer.stdout)
    except (OSError, subprocess.SubprocessError, ValueError):
        return None
    return found


def _candidates(
    layout: Layout, environ: Mapping[str, str], chosen: str, recorded: str
) -> Iterator[str]:
    path = environ.get("PATH", os.defpath)
    if chosen:
        yield shutil.which(chosen, path=path) or chosen
        return
    if layout.kind == SOURCED:
        names = ["python3"]
    else:
        names = ["python3", "python3.12", "python3.11"]
        if recorded:
            yield recorded
    for name in names:
        found = shutil.which(name, path=path)
        if found:
            yield found
    if layout.kind != SOURCED:
        yield sys.executable
        home = environ.get("HOME", "")
        yield from sorted(glob.glob(os.path.join(home, ".pyenv/versions/3.1[12].*/bin/python")))


def find_program(names: list[str], variable: str, environ: Mapping[str, str]) -> str | None:
    """Return the path of the first program there is; `variable`, where set, names the only one."""
    path = environ.get("PATH", os.defpath)
    chosen = environ.get(variable, "").split()
    for name in chosen[:1] or names:
        found = shutil.which(name, path=path)
        if found:
            return found
    return None


def require_compilers(environ: Mapping[str, str]) -> None:
    """
    Check that there are a C and a C++ compiler.

    Raises
    ------
    SetupError
        If one is missing, with the names that were looked for.
    """
    for language, names, variable in (
        ("C", ["cc", "gcc", "clang"], "CC"),
        ("C++", ["c++", "g++", "clang++"], "CXX"),
    ):
        if not find_program(names, variable, environ):
            looked_for = environ.get(variable) or ", ".join(names)
            raise SetupError(
                f"no {language} compiler: looked for {looked_for} on PATH "
                "(on Debian and Ubuntu, apt install g++)"
            )

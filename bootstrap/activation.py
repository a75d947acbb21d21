"""
Makes the environment's own Python work without any preparation by the user.

A `.pth` file in the virtual environment imports this module at every start. The loader reads
LD_LIBRARY_PATH only when a process starts: where the environment's libraries are missing from
it, Python replaces itself once by a Python that has them. So `venv/bin/python`, and every
executable under `overlay/lib/imotor_ros`, starts from a bare shell as well as from `imotor`.
"""

from __future__ import annotations

import os
import sys

from bootstrap import environment
from bootstrap.layout import Layout


def activate() -> None:
    """Replace this process by one with the environment's variables, unless it has them."""
    layout = Layout(os.path.basename(os.path.dirname(sys.prefix)))
    if not os.path.samefile(layout.venv, sys.prefix) or environment.is_active(layout, os.environ):
        return
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    os.environ.update(environment.changed_variables(layout, version, os.environ))
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


if sys.executable and hasattr(sys, "orig_argv"):
    activate()

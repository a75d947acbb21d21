"""Reads `requirements.lock`: exact versions, in sections."""

from __future__ import annotations

import os
import re

from bootstrap.errors import SetupError

FILE_NAME = "requirements.lock"


def read_sections(root: str) -> dict[str, list[str]]:
    """
    Return the pinned packages of every section.

    Parameters
    ----------
    root : str
        The checkout.

    Returns
    -------
    dict of str to list of str
        Section name to lines such as "numpy==2.4.6".
    """
    path = os.path.join(root, FILE_NAME)
    sections: dict[str, list[str]] = {}
    pins = None
    with open(path, encoding="utf-8") as lines:
        for number, line in enumerate(lines, 1):
            line = line.strip()
            header = re.match(r"# \[([a-z-]+)\]", line)
            if header:
                pins = sections.setdefault(header.group(1), [])
            elif line and not line.startswith("#"):
                if pins is None or not re.match(r"[A-Za-z0-9._-]+==\S+$", line):
                    raise SetupError(f"{path}:{number}: not an exact pin in a section")
                pins.append(line)
    return sections


def select(sections: dict[str, list[str]], names: list[str]) -> list[str]:
    """Return the pins of several sections, where a later one overrides an earlier one."""
    chosen = {}
    for name in names:
        for pin in sections[name]:
            chosen[pin.split("==")[0].lower()] = pin
    return list(chosen.values())

"""Where the files under params/ are: in the checkout, or in the installed package's share."""

from __future__ import annotations

import os
from pathlib import Path

import imotor_ros
from imotor_ros.errors import UnreadableFileError


def find_params(name: str) -> Path:
    """
    Return the path of a file under params/.

    Parameters
    ----------
    name : str
        Path below params/, e.g. "campaigns/demo.yaml".

    Raises
    ------
    UnreadableFileError
        If it is found neither in a checkout nor in an installed package.

    """
    folders = [Path(imotor_ros.__file__).parent.parent / "params"]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders += [Path(prefix) / "share" / "imotor_ros" / "params" for prefix in prefixes if prefix]
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    raise UnreadableFileError("no such file under params/", where=name)

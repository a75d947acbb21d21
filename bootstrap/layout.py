"""Where things are: the checkout, and the folder of one environment inside it."""

from __future__ import annotations

import os
from collections.abc import Mapping

ROOT = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))

WHEELS = "wheels"
SOURCED = "sourced"


class Layout:
    """
    The paths of one environment.

    Parameters
    ----------
    kind : str
        `WHEELS` or `SOURCED`: where ROS comes from.
    ros_modules : str
        For `SOURCED` the folder that holds the ROS installation's rclpy, else "".
    root : str
        The checkout.
    """

    def __init__(self, kind: str, ros_modules: str = "", root: str = ROOT) -> None:
        self.kind = kind
        self.ros_modules = ros_modules
        self.root = root
        self.home = os.path.join(root, ".imotor", kind)
        self.venv = os.path.join(self.home, "venv")
        self.venv_python = os.path.join(self.venv, "bin", "python")
        self.overlay = os.path.join(self.home, "overlay")
        self.marker = os.path.join(
            self.overlay, "share", "ament_index", "resource_index", "packages", "imotor_ros"
        )
        self.state_file = os.path.join(self.home, "state.json")
        self.lock_file = os.path.join(self.home, "lock")
        self.log_file = os.path.join(self.home, "setup.log")


def find_layout(environ: Mapping[str, str], root: str = ROOT) -> Layout:
    """
    Return the paths of the environment that fits: over a sourced ROS 2 Jazzy, else of wheels.

    Looks for the folder of rclpy on PYTHONPATH, where sourcing puts it: importing it would cost
    more than a whole start.
    """
    if environ.get("ROS_DISTRO") == "jazzy":
        for folder in environ.get("PYTHONPATH", "").split(os.pathsep):
            if folder and os.path.isdir(os.path.join(folder, "rclpy")):
                return Layout(SOURCED, folder, root)
    return Layout(WHEELS, root=root)


def site_packages(prefix: str, version: str) -> str:
    """Return the folder of Python modules under `prefix` for a version such as "3.11"."""
    return os.path.join(prefix, "lib", "python" + version, "site-packages")

"""Where and with what a run was made: versions, revision, host, start."""

from __future__ import annotations

import platform
import subprocess
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import imotor_ros

PACKAGES = ("numpy", "scipy", "numba", "rosbags", "rclpy", "rmw-fastrtps-cpp")

_DISTRIBUTIONS = {"rclpy": "ros-jazzy-rclpy", "rmw-fastrtps-cpp": "ros-rmw-fastrtps-cpp"}
_GIT_TIMEOUT = 5.0


def provenance() -> dict[str, Any]:
    """
    Return what does not follow from a run's parameters and seed, as plain JSON.

    Returns
    -------
    dict
        "versions" by package (null where not installed), "python", "revision" and "is_dirty"
        of the checkout (null where there is none), "host", "platform", "start" (UTC, ISO 8601).

    """
    revision, is_dirty = _revision(Path(imotor_ros.__file__).resolve().parents[1])
    return {
        "versions": {
            "imotor_ros": imotor_ros.__version__,
            **{name: _version(name) for name in PACKAGES},
        },
        "python": platform.python_version(),
        "revision": revision,
        "is_dirty": is_dirty,
        "host": platform.node(),
        "platform": platform.platform(),
        "start": datetime.now(UTC).isoformat(timespec="milliseconds"),
    }


def _version(name: str) -> str | None:
    for distribution in (name, _DISTRIBUTIONS.get(name, name)):
        try:
            return metadata.version(distribution)
        except metadata.PackageNotFoundError:
            continue
    return None


def _revision(checkout: Path) -> tuple[str | None, bool | None]:
    """Return the revision of a checkout, and whether its files differ from it."""
    if not (checkout / ".git").exists():
        return None, None
    revision = _git(checkout, "rev-parse", "HEAD")
    changes = _git(checkout, "status", "--porcelain", "--untracked-files=no")
    return revision, None if revision is None or changes is None else bool(changes)


def _git(checkout: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(checkout), *arguments],
            capture_output=True,
            text=True,
            timeout=_GIT_TIMEOUT,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()

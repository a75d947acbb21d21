"""The environment variables under which imotor_ros runs."""

from __future__ import annotations

import os
from collections.abc import Mapping

from bootstrap.layout import WHEELS, Layout, site_packages

# What the wheels' own start-up hook looks for: set, it does not start Python a second time.
HOOK_DONE = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"

# The only middleware among the wheels.
MIDDLEWARE = "rmw_fastrtps_cpp"


def changed_variables(layout: Layout, version: str, environ: Mapping[str, str]) -> dict[str, str]:
    """
    Return the variables to set on top of `environ`, whose own entries are kept.

    Search paths get the entries of this environment in front; the rest is set only where the
    user has not.

    Parameters
    ----------
    layout : Layout
        The environment.
    version : str
        Python version of the environment, such as "3.11".
    environ : mapping
        The variables so far.
    """
    changed = _search_paths(layout, version, environ)
    for name, value in _defaults(layout, environ).items():
        if not environ.get(name):
            changed[name] = value
    if layout.kind == WHEELS:
        changed[HOOK_DONE] = "1"
        if environ.get("RMW_IMPLEMENTATION", MIDDLEWARE) != MIDDLEWARE:
            changed["RMW_IMPLEMENTATION"] = MIDDLEWARE
    return changed


def is_active(layout: Layout, environ: Mapping[str, str]) -> bool:
    """Return whether the libraries of the environment are on the loader's path already."""
    folders = environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    return os.path.join(layout.overlay, "lib") in folders


def _search_paths(layout: Layout, version: str, environ: Mapping[str, str]) -> dict[str, str]:
    libraries = [os.path.join(layout.overlay, "lib")]
    prefixes = [layout.overlay]
    modules: list[str] = []
    if layout.kind == WHEELS:
        venv_modules = site_packages(layout.venv, version)
        libraries += [os.path.join(layout.venv, "lib"), *_vendored_libraries(venv_modules)]
        prefixes.append(layout.venv)
        if environ.get("PYTHONPATH"):
            # Another ROS may be on it, for another Python: ours must be found first.
            modules = [site_packages(layout.overlay, version), venv_modules]
    paths = {
        "LD_LIBRARY_PATH": libraries,
        "AMENT_PREFIX_PATH": prefixes,
        "PYTHONPATH": modules,
    }
    return {
        name: prepend(entries, environ.get(name, "")) for name, entries in paths.items() if entries
    }


def prepend(entries: list[str], path: str) -> str:
    """Return the search path `path` with `entries` in front, none of them twice."""
    rest = [entry for entry in path.split(os.pathsep) if entry and entry not in entries]
    return os.pathsep.join([*entries, *rest])


def _vendored_libraries(modules: str) -> list[str]:
    """Return the folders of shared libraries that the ROS wheels bring along."""
    try:
        names = sorted(os.listdir(modules))
    except FileNotFoundError:
        return []
    return [
        os.path.join(modules, name)
        for name in names
        if name.startswith("ros_") and name.endswith(".libs")
    ]


def _defaults(layout: Layout, environ: Mapping[str, str]) -> dict[str, str]:
    defaults = {
        # Other hosts see nothing of a stand unless the user asks for it.
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        # Unchecked, `Float64().data = 3` would be sent as 5e-324.
        "ROS_PYTHON_CHECK_FIELDS": "1",
        # Nothing is written outside the checkout: the home folder may be read-only.
        "NUMBA_CACHE_DIR": os.path.join(layout.home, "numba"),
        "MPLCONFIGDIR": os.path.join(layout.home, "matplotlib"),
    }
    if not environ.get("ROS_HOME"):
        defaults["ROS_LOG_DIR"] = os.path.join(layout.home, "log")
    return defaults

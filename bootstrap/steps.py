"""The steps of a set-up, each with what it depends on."""

from __future__ import annotations

import configparser
import glob
import os
import re
import shutil
from collections.abc import Callable, Mapping

from bootstrap import environment, requirements
from bootstrap.errors import SetupError
from bootstrap.interpreters import Interpreter, find_program
from bootstrap.layout import SOURCED, Layout, site_packages

Run = Callable[[list[str], Mapping[str, str], str], str]
"""Runs a command with variables in a folder and returns its output."""

BUILD_FOLDER = "build-"


class Steps:
    """
    What makes an environment, step by step.

    Parameters
    ----------
    layout : Layout
        The environment.
    interpreter : Interpreter
        What the virtual environment is made from.
    run : callable
        Runs a program.
    environ : mapping
        The user's variables.
    """

    def __init__(
        self, layout: Layout, interpreter: Interpreter, run: Run, environ: Mapping[str, str]
    ) -> None:
        self._layout = layout
        self._interpreter = interpreter
        self._run = run
        self._environ = environ
        self._sections = requirements.read_sections(layout.root)

    def pins(self) -> list[str]:
        """Return the packages that every verb needs."""
        if self._layout.kind == SOURCED:
            names = ["installer", "run", "numpy-of-ros"]
        else:
            names = ["installer", "run", "ros", "build"]
        return requirements.select(self._sections, names)

    def pins_of(self, section: str) -> list[str]:
        """Return the packages of a section of the lock file that only some verbs need."""
        return self._sections.get(section, [])

    def install_packages(self) -> None:
        """Make the virtual environment, in place of one that may be there, and fill it."""
        _remove(self._layout.venv)
        command = [self._interpreter.executable, "-m", "venv", self._layout.venv]
        if self._layout.kind == SOURCED:
            command.append("--system-site-packages")
        self._run(command, self._environ, self._layout.home)
        self._pip_install("installer", self._sections["installer"])
        self._pip_install("packages", self.pins())
        if self._layout.kind != SOURCED:
            self._correct_exports()

    def install_extra(self, section: str) -> None:
        """Install a section of the lock file that only some verbs need."""
        self._pip_install(section, self.pins_of(section))

    def build_interfaces(self) -> None:
        """Generate and compile msg_defs/ into the overlay."""
        layout = self._layout
        for folder in glob.glob(os.path.join(glob.escape(layout.home), BUILD_FOLDER + "*")):
            _remove(folder)
        _remove(layout.overlay)
        # A name of its own: what a killed set-up left running can write into its own only.
        build = os.path.join(layout.home, BUILD_FOLDER + str(os.getpid()))
        environ = self._build_environment()
        cmake = self._require_tool("cmake", ["cmake"], environ)
        ninja = self._require_tool("ninja", ["ninja", "ninja-build"], environ)
        configure = [
            cmake,
            "-G",
            "Ninja",
            "-DCMAKE_MAKE_PROGRAM=" + ninja,
            "-S",
            os.path.join(layout.root, "msg_defs"),
            "-B",
            build,
            "-DCMAKE_INSTALL_PREFIX=" + layout.overlay,
            "-DPython3_EXECUTABLE=" + layout.venv_python,
            "-DBUILD_TESTING=OFF",
        ]
        self._run(configure, environ, layout.home)
        compile_all = [cmake, "--build", build, "--target", "install"]
        self._run([*compile_all, "--parallel", str(os.cpu_count() or 1)], environ, layout.home)
        _remove(build)

    def link_package(self) -> None:
        """Put imotor_ros into the overlay: index entry, executables, and links to the sources."""
        layout = self._layout
        share = os.path.join(layout.overlay, "share", "imotor_ros")
        # `ros2 launch` looks into no linked folder
        for name in ("package.xml", "params", "launch/stand.launch.py"):
            os.makedirs(os.path.dirname(os.path.join(share, name)), exist_ok=True)
            _link(os.path.join(layout.root, name), os.path.join(share, name))
        self._write_executables()
        self._write_path_file()
        os.makedirs(os.path.dirname(layout.marker), exist_ok=True)
        shutil.copyfile(os.path.join(layout.root, "resource", "imotor_ros"), layout.marker)

    def compile_kernels(self) -> None:
        """Compile ahead what the first run would compile: byte code, font list, Numba kernels."""
        python = [self._layout.venv_python]
        imports = "import rclpy.action, rclpy.lifecycle, rosbags.rosbag2, scipy.signal, numba"
        self._run([*python, "-c", imports], self._run_environment(), self._layout.root)
        fonts = "import matplotlib.pyplot"
        self._run([*python, "-c", fonts], self._run_environment(), self._layout.root)
        module = os.path.join(self._layout.root, "imotor_ros", "core", "compilation.py")
        if os.path.exists(module):
            command = [*python, "-m", "imotor_ros.core.compilation"]
            self._run(command, self._run_environment(), self._layout.root)

    def _require_tool(self, section: str, names: list[str], environ: Mapping[str, str]) -> str:
        """Return the machine's program, or one from a wheel where the machine has none."""
        found = find_program(names, "", environ)
        if not found:
            self._pip_install(section, self._sections[section], "--ignore-installed")
            found = find_program(names, "", environ)
        if not found:
            raise SetupError(f"no {section}: looked for {' and '.join(names)} on PATH")
        return found

    def _pip_install(self, name: str, pins: list[str], *options: str) -> None:
        wanted = os.path.join(self._layout.home, name + ".txt")
        with open(wanted, "w", encoding="utf-8") as file:
            file.write("\n".join(pins) + "\n")
        # --no-compile: byte code of what is imported is written when it is imported.
        # --no-build-isolation: the one source archive builds with the pinned setuptools.
        command = [self._layout.venv_python, "-m", "pip", "install", "--no-input"]
        command += ["--disable-pip-version-check", "--no-deps", "--no-compile"]
        command += ["--no-build-isolation", "--progress-bar=off", *options, "-r", wanted]
        environ = dict(self._environ)
        environ[environment.HOOK_DONE] = "1"
        self._run(command, environ, self._layout.home)

    def _correct_exports(self) -> None:
        """
        Point the wheels' CMake files to this environment's headers.

        They name include folders of the machine that built the wheels, and CMake refuses a
        folder that does not exist.
        """
        python = self._layout.venv_python
        query = (
            "import numpy, sysconfig;"
            "print(sysconfig.get_path('include'), numpy.get_include(), sep='\\n')"
        )
        headers, numpy_headers = self._run(
            [python, "-c", query], self._run_environment(), self._layout.home
        ).split("\n")[:2]
        share = os.path.join(self._layout.venv, "share")
        for path in glob.glob(os.path.join(glob.escape(share), "*", "cmake", "*.cmake")):
            with open(path, encoding="utf-8") as file:
                text = file.read()
            corrected = re.sub(
                r"/opt/python/[^/]+/lib/[^;\"]*/numpy/_core/include", lambda _: numpy_headers, text
            )
            corrected = re.sub(
                r"/opt/python/[^/]+/include/python3\.\d+", lambda _: headers, corrected
            )
            if corrected != text:
                with open(path, "w", encoding="utf-8") as file:
                    file.write(corrected)

    def _write_executables(self) -> None:
        """Write a start script per entry point of setup.py where `ros2 run` looks for it."""
        layout = self._layout
        metadata = site_packages(layout.overlay, self._interpreter.version)
        os.makedirs(metadata, exist_ok=True)
        command = [layout.venv_python, "setup.py", "-q", "egg_info", "--egg-base", metadata]
        self._run(command, self._run_environment(), layout.root)
        parser = configparser.ConfigParser(delimiters=("=",))
        parser.read(os.path.join(metadata, "imotor_ros.egg-info", "entry_points.txt"))
        folder = os.path.join(layout.overlay, "lib", "imotor_ros")
        _remove(folder)
        os.makedirs(folder)
        for name, target in parser["console_scripts"].items():
            path = os.path.join(folder, name)
            with open(path, "w", encoding="utf-8") as file:
                file.write(start_script(layout.venv_python, target))
            os.chmod(path, 0o755)

    def _write_path_file(self) -> None:
        """Make the environment's Python find the sources, the messages and their libraries."""
        layout = self._layout
        version = self._interpreter.version
        lines = [
            layout.root,
            site_packages(layout.overlay, version),
            "import bootstrap.activation",
        ]
        path = os.path.join(site_packages(layout.venv, version), "imotor.pth")
        with open(path, "w", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")

    def _run_environment(self) -> dict[str, str]:
        environ = dict(self._environ)
        version = self._interpreter.version
        environ.update(environment.changed_variables(self._layout, version, environ))
        return environ

    def _build_environment(self) -> dict[str, str]:
        environ = self._run_environment()
        programs = os.path.join(self._layout.venv, "bin")
        environ["PATH"] = environment.prepend([programs], environ.get("PATH", os.defpath))
        if self._layout.kind != SOURCED:
            prefixes = environ.get("CMAKE_PREFIX_PATH", "")
            environ["CMAKE_PREFIX_PATH"] = environment.prepend([self._layout.venv], prefixes)
        return environ


def start_script(python: str, target: str) -> str:
    """
    Return an executable that starts an entry point.

    Parameters
    ----------
    python : str
        The interpreter; may hold spaces and be of any length, unlike in a `#!` line.
    target : str
        Such as "imotor_ros.nodes.plant:main".
    """
    module, function = (part.strip() for part in target.split(":"))
    # The shell runs the second line; for Python, lines two and three are a string.
    return (
        "#!/bin/sh\n"
        f'\'\'\'exec\' "{python}" "$0" "$@"\n'
        "' '''\n"
        "import sys\n"
        f"from {module} import {function}\n"
        f"sys.exit({function}())\n"
    )


def _link(target: str, path: str) -> None:
    if os.path.islink(path):
        os.remove(path)
    os.symlink(target, path)


def _remove(folder: str) -> None:
    """Remove a folder, also while what a killed set-up left running still writes into it."""
    for _ in range(5):
        shutil.rmtree(folder, ignore_errors=True)
        if not os.path.exists(folder):
            return
    shutil.rmtree(folder)

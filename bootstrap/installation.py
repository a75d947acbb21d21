"""Brings an environment up to date: the steps whose input changed, and those after them."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import time
from collections.abc import Callable
from functools import partial
from types import FrameType

from bootstrap.errors import SetupError
from bootstrap.interpreters import find_interpreter, probe, require_compilers
from bootstrap.layout import Layout
from bootstrap.lockfile import SetupLock
from bootstrap.processes import Programs
from bootstrap.progress import Progress, say
from bootstrap.state import STEPS, State, files_under, take_stamps
from bootstrap.steps import Steps

RECIPE = 1
"""To be raised when a step does something else with the same input."""

NEEDED_SPACE = 1.5e9
"""Free disk space (bytes) that a new environment needs."""


STOPPING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(BaseException):
    """A signal asked the set-up to stop."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def run(layout: Layout, extras: tuple[str, ...], chosen: str) -> str:
    """
    Set up what is out of date.

    Parameters
    ----------
    layout : Layout
        The environment.
    extras : tuple of str
        Sections of the lock file wanted beside the usual ones.
    chosen : str
        The Python the user asks for, "" for any.

    Returns
    -------
    str
        Python version of the environment, "" if the set-up failed (and said why).
    """
    previous = {number: signal.signal(number, _interrupt) for number in STOPPING_SIGNALS}
    try:
        with SetupLock(layout.lock_file, _say_waiting) as lock:
            return Installation(layout, lock, extras, chosen).bring_up_to_date()
    except (SetupError, OSError) as error:
        say(f"set-up stopped: {error}")
        if os.path.exists(layout.log_file):
            say(f"the full log is {layout.log_file}")
        return ""
    except Interrupted as interrupted:
        say("set-up interrupted; the next start goes on from here")
        signal.signal(interrupted.number, signal.SIG_DFL)
        os.kill(os.getpid(), interrupted.number)
        return ""
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


class Installation:
    """One set-up of one environment, under its lock."""

    def __init__(
        self, layout: Layout, lock: SetupLock, extras: tuple[str, ...], chosen: str
    ) -> None:
        self._layout = layout
        self._state = State.read(layout.state_file)
        self._interpreter = find_interpreter(layout, os.environ, chosen, self._state.interpreter)
        self._progress = Progress()
        programs = Programs(layout.log_file, lock, self._progress.update)
        steps = Steps(layout, self._interpreter, programs.run, os.environ)
        self._keys = self._find_keys(steps, extras)
        # In this order, and what comes after a step is done again when the step is.
        self._actions: dict[str, tuple[str, Callable[[], None]]] = {
            "packages": ("install packages", steps.install_packages),
            "interfaces": ("compile messages", steps.build_interfaces),
            "links": ("install imotor_ros", steps.link_package),
            "kernels": ("compile kernels", steps.compile_kernels),
        }
        for extra in extras:
            title = f"install packages for {extra}"
            self._actions[extra] = (title, partial(steps.install_extra, extra))

    def bring_up_to_date(self) -> str:
        """Run the steps that are out of date; return the environment's Python version."""
        stamps = take_stamps(self._layout.root)
        self._forget_outdated()
        missing = [step for step in self._actions if step not in self._state.steps]
        if missing:
            self._check_machine(missing)
            self._run_steps(missing)
        self._state.interpreter = self._interpreter.executable
        self._state.version = self._interpreter.version
        self._state.ros_modules = self._layout.ros_modules
        self._state.running = ""
        self._state.stamps = stamps
        self._state.write()
        return self._interpreter.version

    def _find_keys(self, steps: Steps, extras: tuple[str, ...]) -> dict[str, str]:
        """Return for every step a hash of what it and the steps before it depend on."""
        root = self._layout.root
        python = self._interpreter
        origin = [str(RECIPE), python.executable, python.version, self._layout.ros_modules]
        keys = {"packages": _hash(origin + steps.pins())}
        interfaces = files_under(root, "msg_defs")
        keys["interfaces"] = _hash([keys["packages"], *_contents(root, interfaces)])
        linked = ["setup.py", "setup.cfg", "package.xml", "resource/imotor_ros"]
        linked += files_under(root, "bootstrap")
        keys["links"] = _hash([keys["interfaces"], *_contents(root, linked)])
        kernels = ["imotor_ros/core/compilation.py"]
        keys["kernels"] = _hash([keys["packages"], *_contents(root, kernels)])
        for extra in set(extras).union(self._state.steps) - set(keys):
            keys[extra] = _hash([keys["packages"], *steps.pins_of(extra)])
        return keys

    def _forget_outdated(self) -> None:
        """Drop from the record what has changed, what is damaged and what was interrupted."""
        done = self._state.steps
        for step in list(done):
            if done[step] != self._keys[step]:
                del done[step]
        is_damaged = not probe(self._layout.venv_python, os.environ)
        # What pip was writing when it was killed cannot be told from what it had written.
        was_interrupted = self._state.running not in ("", *STEPS)
        if is_damaged or was_interrupted:
            done.clear()
        if "interfaces" not in done or not os.path.exists(self._layout.marker):
            # The overlay is made anew, and with it all that is in it.
            done.pop("interfaces", None)
            done.pop("links", None)

    def _check_machine(self, missing: list[str]) -> None:
        if "interfaces" in missing:
            require_compilers(os.environ)
        if "packages" in missing:
            free = shutil.disk_usage(self._layout.home).free
            if free < NEEDED_SPACE:
                raise SetupError(
                    f"the disk is full: {self._layout.home} needs {NEEDED_SPACE / 1e9:.1f} GB, "
                    f"{free / 1e9:.1f} GB are free"
                )

    def _run_steps(self, missing: list[str]) -> None:
        if "packages" in missing:
            say(f"setting up in {self._layout.home}, one to two minutes")
        self._progress.expect(len(missing))
        start = time.monotonic()
        for step in missing:
            self._run_step(step)
        say("ready after %.0f s" % (time.monotonic() - start))

    def _run_step(self, step: str) -> None:
        title, action = self._actions[step]
        self._state.running = step
        self._state.write()
        self._progress.begin(title)
        try:
            action()
        except BaseException:
            self._progress.end("stopped")
            raise
        # The record must not reach the disk before what it speaks of.
        os.sync()
        self._state.steps[step] = self._keys[step]
        self._state.running = ""
        self._state.write()
        self._progress.end()


def _hash(parts: list[str]) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def _contents(root: str, names: list[str]) -> list[str]:
    """Return name and content hash of each file that exists."""
    parts = []
    for name in names:
        path = os.path.join(root, name)
        if os.path.exists(path):
            with open(path, "rb") as file:
                parts += [name, hashlib.sha256(file.read()).hexdigest()]
    return parts


def _interrupt(number: int, _frame: FrameType | None) -> None:
    raise Interrupted(number)


def _say_waiting() -> None:
    say("another set-up is running, waiting for it to end")

"""
Tasks in several processes: each says what happens as it goes on, and has a result.

The same tasks give the same results in any number of processes; only the order in which they end
depends on it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from imotor_ros.errors import BadInputError, RunError

_END_DEADLINE = 30.0
"""Longest wait (s) for a process to close what it has open."""


class Task(Protocol):
    """A piece of work that can be sent to another process, with all that it needs."""

    @property
    def number(self) -> int:
        """What tells it from the others."""

    def carry_out(self) -> Generator[Any, None, Any]:
        """Yield what happens, and return the result."""


@dataclass(frozen=True)
class Advanced:
    """A task says what happens."""

    task: Any
    event: Any


@dataclass(frozen=True)
class Finished:
    """A task has ended: its result, or how its process died before."""

    task: Any
    result: Any
    death: str = ""


Progress = Advanced | Finished
NextTask = Callable[[], Task | None]


def work_here(next_task: NextTask) -> Generator[Progress, None, None]:
    """
    Carry out tasks one after the other, in this process.

    Parameters
    ----------
    next_task : callable
        Returns the next task, None when there is none; it is asked after every task.

    """
    while (task := next_task()) is not None:
        steps = task.carry_out()
        try:
            while True:
                try:
                    event = next(steps)
                except StopIteration as end:
                    result = end.value
                    break
                yield Advanced(task, event)
        finally:
            steps.close()
        yield Finished(task, result)


def work_in_processes(next_task: NextTask, jobs: int) -> Generator[Progress, None, None]:
    """
    Carry out tasks in processes of their own.

    A task whose process dies has a `Finished` that says how. When the generator is closed, the
    processes are interrupted as by Ctrl-C, and waited for.

    Parameters
    ----------
    next_task : callable
        Returns the next task, None when there is none at present; it is asked again when
        another task has ended.
    jobs : int
        Number of processes.

    Raises
    ------
    BadInputError, RunError
        What a task raised.

    """
    workers = [_Worker() for _ in range(jobs)]
    try:
        for worker in workers:
            worker.take(next_task())
        while busy := {w.connection: w for w in workers if w.task is not None}:
            for connection in wait(list(busy)):
                worker = busy[connection]
                progress = worker.receive()
                yield progress
                if isinstance(progress, Finished):
                    for idle in (one for one in workers if one.task is None):
                        idle.take(next_task())
    finally:
        for worker in workers:
            worker.interrupt()
        for worker in workers:
            worker.end()


class _Worker:
    """One process, and the task it is busy with."""

    def __init__(self) -> None:
        self.task: Task | None = None
        self._start()

    def _start(self) -> None:
        context = context_of_workers()
        self.connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other,), daemon=True)
        self._process.start()
        other.close()

    def take(self, task: Task | None) -> None:
        """Begin a task, if there is one."""
        if task is None:
            return
        self.task = task
        with suppress(BrokenPipeError):  # its death is noticed when its answer is waited for
            self.connection.send(task)

    def receive(self) -> Progress:
        """Return what the process says next."""
        task = self.task
        try:
            kind, content = self.connection.recv()
        except (EOFError, OSError):
            self._process.join(_END_DEADLINE)
            code = self._process.exitcode
            self.task = None
            self._start()
            return Finished(task, None, f"its process ended with exit code {code}")
        if kind == "event":
            return Advanced(task, content)
        self.task = None
        if kind == "bad input":
            raise BadInputError(content[0], where=content[1], value=content[2], bound=content[3])
        if kind == "error":
            raise RunError(content)
        return Finished(task, content)

    def interrupt(self) -> None:
        """Let the process close what it has open."""
        if self.task is None or self._process.pid is None:
            self.connection.close()  # it waits for a task, and ends when none can come
            return
        # the connection stays open: a second cause to end must not break the closing of a bag
        with suppress(ProcessLookupError):
            os.kill(self._process.pid, signal.SIGINT)

    def end(self) -> None:
        """Wait until the process has ended."""
        self._process.join(_END_DEADLINE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self.connection.close()


def prepare_workers() -> None:
    """
    Let the server that workers are forked from import what they need, while we import it.

    To be called in the main thread.
    """
    context_of_workers()
    # a Ctrl-C is for us and for the workers, not for the server
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        forkserver.ensure_running()
    finally:
        signal.signal(signal.SIGINT, before)


def context_of_workers() -> Any:
    """Return how workers are started: forked from a server, so that no thread of ours is copied."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["imotor_ros.campaign.tasks", "imotor_ros.campaign.sim_bench"])
    return context


def _serve(connection: Connection) -> None:
    """Carry out what comes in until the other side is gone."""
    signal.signal(signal.SIGINT, _interrupt_once)
    with suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            _carry_out(connection.recv(), connection)


def _interrupt_once(*_: object) -> None:
    # a second Ctrl-C, or the one that comes from our starter, must not break the closing of a bag
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise KeyboardInterrupt


def _carry_out(task: Task, connection: Connection) -> None:
    steps = task.carry_out()
    try:
        while True:
            answer = _answer(steps)
            connection.send(answer)
            if answer[0] != "event":
                return
    finally:
        steps.close()


def _answer(steps: Generator[Any, None, Any]) -> tuple[str, Any]:
    """Go one step; return what came of it. Errors travel as text: not all can be copied."""
    try:
        return "event", next(steps)
    except StopIteration as end:
        return "result", end.value
    except BadInputError as error:
        value = None if error.value is None else str(error.value)
        return "bad input", (error.what, error.where, value, error.bound)
    except Exception as error:
        return "error", f"{type(error).__name__}: {error}"

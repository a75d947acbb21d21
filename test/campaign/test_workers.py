"""Tasks in this process and in others: equal results, errors come through, deaths are seen."""

from __future__ import annotations

import importlib
from collections import deque
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest

from imotor_ros.campaign.workers import (
    Advanced,
    Finished,
    Progress,
    Task,
    work_here,
    work_in_processes,
)
from imotor_ros.errors import BadInputError, RunError


@pytest.fixture
def square(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the class of the tasks, from where the processes find it as well."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    return importlib.import_module("squares").Square


def queue(tasks: list[Task]) -> Callable[[], Task | None]:
    left = deque(tasks)
    return lambda: left.popleft() if left else None


def results(steps: Generator[Progress, None, None]) -> dict[int, object]:
    return {one.task.number: one.result for one in steps if isinstance(one, Finished)}


def test_number_of_processes_makes_no_difference(square: Any) -> None:
    tasks = [square(n) for n in range(7)]
    here = results(work_here(queue(tasks)))
    assert here == {n: n**2 for n in range(7)}
    assert results(work_in_processes(queue(tasks), 2)) == here
    assert results(work_in_processes(queue(tasks[:1]), 3)) == {0: 0}


def test_events_come_before_the_result(square: Any) -> None:
    seen = [
        (type(one).__name__, one.task.number) for one in work_in_processes(queue([square(3)]), 1)
    ]
    assert seen == [("Advanced", 3), ("Finished", 3)]


def test_death_of_a_process_is_reported_and_the_others_go_on(square: Any) -> None:
    tasks = [square(0), square(1, "death"), square(2), square(3)]
    ends = [o for o in work_in_processes(queue(tasks), 2) if isinstance(o, Finished)]
    assert {one.task.number: one.result for one in ends} == {0: 0, 1: None, 2: 4, 3: 9}
    (dead,) = (one for one in ends if one.death)
    assert "-9" in dead.death


def test_errors_come_through(square: Any) -> None:
    with pytest.raises(BadInputError, match=r"number: is odd, got '1', expected even"):
        list(work_in_processes(queue([square(0), square(1, "bad input")]), 2))
    with pytest.raises(RunError, match="ZeroDivisionError: by nothing"):
        list(work_in_processes(queue([square(0), square(1, "failure")]), 2))


def test_closing_lets_the_tasks_close_what_they_have_open(square: Any, tmp_path: Path) -> None:
    tasks = [square(0, "long", tmp_path), square(1, "long", tmp_path)]
    steps = work_in_processes(queue(tasks), 2)
    begun = set()
    for one in steps:
        assert isinstance(one, Advanced)
        if one.event == "still":  # what has to be closed is open
            begun.add(one.task.number)
        if len(begun) == 2:
            break
    steps.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["closed 0", "closed 1"]

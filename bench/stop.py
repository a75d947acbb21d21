"""
Stream time from a stop, or from the death of the signal generator, to zero volts.

Run as `python bench/stop.py [REPETITIONS]` after `eval "$(./imotor shell-env)"`. Generator, plant
and rod vibrometer run as processes of their own. The service `drive/stop` is called while a
program is held, in each part of a program, in trials of an excitation, three times at once, and
while a goal is taken; then the generator is killed with SIGKILL. Counted are the samples from
what the driver had acknowledged when the generator got the request, or from the last that came
of a generator that was killed, to the first after which the voltage monitor stays at zero.
Repetitions differ in when the request comes.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from imotor_msgs.msg import StandState
from rclpy.task import Future
from std_srvs.srv import Trigger

from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.excite import request_of
from imotor_ros.campaign.plan import RunPlan, plan_run
from imotor_ros.campaign.point import PointParameters
from imotor_ros.campaign.roles.generator import STOP_TIME
from imotor_ros.contracts import graph
from imotor_ros.contracts.graph import expected_readers
from imotor_ros.contracts.messages import block_from_message
from imotor_ros.contracts.topics import (
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    STATE,
    VOLTAGE_MONITOR,
    Topic,
)
from imotor_ros.core.channel import SampleFlag
from imotor_ros.nodes.message_types import message_class
from imotor_ros.nodes.qos import qos_profile
from imotor_ros.nodes.stand_processes import StandProcesses

ROLES = (graph.SIGNAL_GENERATOR, graph.PLANT, graph.ROD_VIBROMETER)
DEADLINE = 15.0
QUIET = 0.1
"""Voltage (V) below which the monitor shows zero, with its noise."""


@dataclass
class Case:
    """What was measured in one state: stream times to zero (s), and the voltage left then (V)."""

    name: str
    times: list[float] = field(default_factory=list)
    left: list[float] = field(default_factory=list)
    remarks: set[str] = field(default_factory=set)


class StopBench:
    """A stand whose voltage is stopped again and again."""

    def __init__(self, folder: Path, namespace: str) -> None:
        leaves = {"drive.hold_time": 0.3, "stand.motor.load.upper_stop": 1e-3}
        point = NamedPoint("stop", PointParameters.from_leaves(leaves))
        self.plan: RunPlan = plan_run(point, folder)
        self.stand = StandProcesses(ROLES, folder / "logs", namespace)
        self.client = self.stand.client
        self.monitor: list[Any] = []
        self.progress: list[Any] = []
        self.states: list[Any] = []
        self.programs: list[Any] = []
        self._number = 0
        for topic, heard in (
            (VOLTAGE_MONITOR, self.monitor),
            (DRIVE_PROGRESS, self.progress),
            (STATE, self.states),
            (DRIVE_PROGRAM, self.programs),
        ):
            self._hear(topic, heard)
        self._stop = self.client.node.create_client(Trigger, "drive/stop")
        self._is_held = False

    def _hear(self, topic: Topic, heard: list[Any]) -> None:
        self.client.node.create_subscription(
            message_class(topic.type_name), topic.name, heard.append, qos_profile(topic)
        )

    def start(self) -> None:
        """Activate the nodes."""
        self.stand.wait()
        self.stand.activate(self._parameters())
        self.client.spin_until(self._stop.service_is_ready, "drive/stop", DEADLINE)

    def _parameters(self) -> dict[str, dict[str, Any]]:
        readers = {one.name: expected_readers(one, ROLES) for one in ROLES}
        readers["plant"] = (
            readers["plant"]
            .replace("drive/voltage_monitor=0", "drive/voltage_monitor=1")
            .replace("drive/progress=1", "drive/progress=2")
        )
        named = {name: {"expected_readers": text} for name, text in readers.items()}
        named["signal_generator"]["awaits_recording"] = self._is_held
        return named  # type: ignore[return-value]

    def hold(self, is_held: bool) -> None:
        """Have the generator wait for a recorder that does not come, or not."""
        self._is_held = is_held
        self.stand.deactivate()
        self.stand.activate(self._parameters())

    def forget(self) -> None:
        """Forget what was heard of the last run."""
        for heard in (self.monitor, self.progress, self.states, self.programs):
            heard.clear()

    def play(self) -> Any:
        """Begin a run of its own id."""
        self.forget()
        return self.client.play(replace(self.plan.program, run_id=self.next_id()), DEADLINE)

    def next_id(self) -> str:
        """Return a run id that was not used before."""
        self._number += 1
        return f"stop{self._number}"

    def call_stop(self) -> Future:
        """Call drive/stop; return what the answer will be in."""
        return self._stop.call_async(Trigger.Request())

    def await_consumed(self, samples: int) -> None:
        """Wait until so many samples are consumed."""
        self.client.spin_until(
            lambda: bool(self.progress) and self.progress[-1].consumed >= samples,
            f"{samples} samples to be consumed", DEADLINE,
        )  # fmt: skip

    def await_idle(self) -> None:
        """Wait until the generator owns no run, and all of the monitor has come."""

        def is_idle() -> bool:
            last = self.states[-1] if self.states else None
            return last is not None and not last.run_id and last.state == StandState.STATE_IDLE

        self.client.spin_until(is_idle, "the stand to be idle", DEADLINE)
        self._await_monitor()

    def _await_monitor(self) -> None:
        def has_come() -> bool:
            if not (self.monitor and self.programs):
                return False
            last, program = self.monitor[-1], self.programs[-1]
            return last.run_id == program.run_id and (
                last.first_index + len(last.samples) >= program.length
            )

        self.client.spin_until(has_come, "the voltage monitor to come to the end", DEADLINE)

    def consumed_at_stop(self) -> int:
        """Return what was consumed when the generator got the first request of the run."""
        stopping = [one for one in self.states if one.state == StandState.STATE_STOPPING]
        if stopping:
            return int(stopping[0].consumed)
        return int(self.programs[-1].length)  # it came after the end: between two trials

    def zero_index(self) -> tuple[int, float]:
        """Return the first sample after which the monitor stays at zero, and what it shows last."""
        if not self.monitor:
            return 0, 0.0
        blocks = [block_from_message(one) for one in self.monitor]
        run = blocks[-1].run_id
        samples = np.concatenate([one.samples for one in blocks if one.run_id == run])
        loud = np.flatnonzero(np.abs(samples) > QUIET)
        return (int(loud[-1]) + 1 if loud.size else 0), float(samples[-1])

    def note(self, case: Case, start: int) -> None:
        """Add what the monitor has shown to a case."""
        index, left = self.zero_index()
        case.times.append(max(0, index - start) / self.plan.program.sample_rate)
        case.left.append(abs(left))

    def close(self) -> None:
        """End the nodes."""
        self.stand.stop()


def stop_within(bench: StopBench, case: Case, consumed: int, *, requests: int = 1) -> None:
    """Stop a program once so many samples are consumed."""
    played = bench.play()
    bench.await_consumed(consumed)
    answers = [bench.call_stop() for _ in range(requests)]
    bench.client.spin_until(lambda: all(a.done() for a in answers), "drive/stop", DEADLINE)
    case.remarks |= {answer.result().message for answer in answers}
    bench.client.spin_until(lambda: played.is_done, "the program to end", DEADLINE)
    bench.await_idle()
    if played.outcome == "cancelled":
        bench.note(case, bench.consumed_at_stop())


def stop_held(bench: StopBench, case: Case) -> None:
    """Stop a program that waits for its bag: it is given up without a voltage."""
    played = bench.play()
    answer = bench.call_stop()
    bench.client.spin_until(answer.done, "drive/stop", DEADLINE)
    case.remarks.add(answer.result().message)
    played.cancel()
    bench.note(case, 0)


def stop_while_taken(bench: StopBench, case: Case) -> None:
    """Send goal and stop together, in an order that nobody knows."""
    answers: list[Future] = []
    send = bench.client._player.send_goal_async
    original = send

    def send_both(*arguments: Any, **options: Any) -> Future:
        future = original(*arguments, **options)
        answers.append(bench.call_stop())
        return future

    bench.client._player.send_goal_async = send_both
    try:
        played = bench.play()
    finally:
        bench.client._player.send_goal_async = original
    bench.client.spin_until(lambda: answers[0].done(), "drive/stop", DEADLINE)
    if answers[0].result().message == "the voltage is at zero" and bench.progress:
        bench.call_stop()  # it came before the goal
    bench.client.spin_until(lambda: played.is_done, "the program to end", DEADLINE)
    if played.consumed == 0:
        case.times.append(0.0)
        case.left.append(0.0)
        return
    bench.await_idle()
    bench.note(case, bench.consumed_at_stop())


def stop_correction(bench: StopBench, case: Case, samples: int) -> None:
    """Stop the search for an excitation in one of its trials."""
    bench.forget()
    request = replace(request_of(bench.plan), run_id=bench.next_id())
    search = bench.client.search(request, DEADLINE)
    bench.await_consumed(samples)
    answer = bench.call_stop()
    bench.client.spin_until(lambda: search.is_done, "the search to end", DEADLINE)
    case.remarks.add(answer.result().message)
    bench.await_idle()
    bench.note(case, bench.consumed_at_stop())


def kill_generator(bench: StopBench, case: Case, consumed: int) -> None:
    """Kill the generator once so many samples are consumed; the stand is of no use then."""
    bench.play()
    bench.await_consumed(consumed)
    begin = time.monotonic()
    process = bench.stand.processes.pop("signal_generator")
    os.kill(process.pid, signal.SIGKILL)
    length = bench.plan.program.length
    bench.client.spin_until(
        lambda: bool(bench.progress[-1].fault) or bench.progress[-1].consumed == length,
        "the watchdog of the plant",
        DEADLINE,
    )
    if not bench.progress[-1].fault:
        case.remarks.add("one came too late: the run was over")
        return
    case.remarks |= {bench.progress[-1].fault, f"{time.monotonic() - begin:.1f} s of the clock"}
    bench.client.spin_until(
        lambda: bool(bench.monitor) and bool(bench.monitor[-1].flags & SampleFlag.RAMPED_DOWN),
        "the ramp",
        DEADLINE,
    )
    bench.note(case, int(bench.progress[-1].consumed))


def measure(folder: Path, namespace: str, repetitions: int, kills: int) -> list[Case]:
    """Return what was measured in all states."""
    draw = np.random.default_rng(1)
    bench = StopBench(folder / "stand", namespace)
    program = bench.plan.program
    cases: list[Case] = []

    def repeat(name: str, act: Callable[[Case], None], count: int = repetitions) -> None:
        cases.append(Case(name))
        for _ in range(count):
            act(cases[-1])

    def somewhere(first: float, last: float) -> int:
        return int(draw.uniform(first, last) * program.length)

    try:
        bench.start()
        hold_start, hold_end = (index / program.length for index in program.span("hold"))
        repeat("bias and ramp up", lambda case: stop_within(bench, case, 1))
        repeat("hold", lambda case: stop_within(bench, case, somewhere(hold_start, 0.8)))
        repeat("near the end", lambda case: stop_within(bench, case, somewhere(0.85, hold_end)))
        repeat("three at once", lambda c: stop_within(bench, c, somewhere(0.1, 0.8), requests=3))
        repeat("with the goal", lambda case: stop_while_taken(bench, case))
        repeat("correction", lambda case: stop_correction(bench, case, int(draw.integers(1, 4000))))
        bench.hold(True)
        repeat("held", lambda case: stop_held(bench, case), 1)
        bench.hold(False)
        cases.append(Case("killed generator"))
        kill_generator(bench, cases[-1], somewhere(0.02, 0.1))
    finally:
        bench.close()
    for number in range(1, kills):
        another = StopBench(folder / f"kill{number}", namespace)
        try:
            another.start()
            kill_generator(another, cases[-1], somewhere(0.02, 0.5))
        finally:
            another.close()
    return cases


def main() -> int:
    """Print a table; return 1 if a stop took too long."""
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    with tempfile.TemporaryDirectory() as folder:
        cases = measure(Path(folder), f"/bench_stop_{os.getpid()}", repetitions, repetitions)
    print(f"{'stopped in':20}{'stops':>7}{'longest':>12}{'mean':>12}{'left':>10}")
    for case in cases:
        if case.times:
            numbers = (max(case.times) * 1e3, float(np.mean(case.times)) * 1e3)
            print(
                f"{case.name:20}{len(case.times):7}{numbers[0]:9.2f} ms{numbers[1]:9.2f} ms"
                f"{max(case.left):8.3f} V"
            )
    print("\n".join(f"  {case.name}: {text}" for case in cases for text in sorted(case.remarks)))
    longest = max(time for case in cases for time in case.times)
    print(f"longest {longest * 1e3:.2f} ms of stream time, {STOP_TIME * 1e3:g} ms are allowed")
    return int(longest > STOP_TIME)


if __name__ == "__main__":
    sys.exit(main())

"""
Points of a campaign by the model: what all cores do beside one, and beside the bare solver.

Run as `python bench/model_sweep.py [POINTS] [ROUNDS]`. The bare solver is the closed form alone,
4000 periods for every point, from the same parameters: no chunks, no regression, no table. Its
speed times the cores is what a sweep can at most do; the closed form that ends when it is steady,
which the sweep uses, is faster. The best of the rounds counts. Other work on the machine takes its
share of the time on the clock, so that the processor time of all processes stands beside it.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from multiprocessing import forkserver
from pathlib import Path

from imotor_ros.campaign.campaign import NamedPoint, campaign_from_mapping
from imotor_ros.campaign.model_sweep import case_of, predict_points
from imotor_ros.core import closed_form
from imotor_ros.core.model import PERIODS

LAW = "stand.motor.friction"


def make_points(count: int) -> tuple[NamedPoint, ...]:
    """A product of signal, friction and load, as a campaign file has it."""
    frequencies = -(-count // 30)
    sweep = {
        "signal.harmonics": [2, 3, 4],
        f"{LAW}.slope": [0.0, 1.0, 2.213, 5.0, 10.0],
        "stand.motor.load.constant_force": [0.0, 0.1],
        "signal.maximum_frequency": [5e3 + 13e3 * i / frequencies for i in range(frequencies)],
    }
    return campaign_from_mapping({"sweep": sweep}).points[:count]


def solve(points: tuple[NamedPoint, ...], until_steady: bool) -> None:
    for point in points:
        case = case_of(point.parameters)
        closed_form.simulate(
            case.signal.motion, case.slider, case.friction, load=case.load, periods=PERIODS,
            until_steady=until_steady,
        )  # fmt: skip


def processor_time() -> float:
    """Return the time (s) of this process, and of the workers that have ended."""
    server = forkserver._forkserver._forkserver_pid
    ticks = 0
    if server is not None:
        fields = Path(f"/proc/{server}/stat").read_text().rpartition(")")[2].split()
        ticks = sum(map(int, fields[11:15]))
    return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    cores = len(os.sched_getaffinity(0))
    start = time.perf_counter()
    points = make_points(count)
    print(f"{count} points made in {time.perf_counter() - start:.2f} s")
    found: dict[str, list[dict[str, object]]] = {}

    def sweep(name: str, jobs: int) -> Callable[[], None]:
        def run() -> None:
            found[name] = list(predict_points(points, jobs))

        return run

    bare, steady = "bare solver, 4000 periods", "bare solver, until steady"
    one, every = "sweep, 1 process", f"sweep, {cores} processes"
    calls: dict[str, Callable[[], None]] = {
        bare: lambda: solve(points, until_steady=False),
        steady: lambda: solve(points, until_steady=True),
        one: sweep(one, 1),
        every: sweep(every, cores),
    }
    list(predict_points(points[:3], 1))  # compiled code is loaded once
    wall, used = ({name: float("inf") for name in calls} for _ in range(2))
    for _ in range(rounds):
        for name, call in calls.items():
            start, before = time.perf_counter(), processor_time()
            call()
            wall[name] = min(wall[name], time.perf_counter() - start)
            used[name] = min(used[name], processor_time() - before)
    for name in calls:
        rate = count / wall[name]
        print(
            f"{name:<26}{wall[name]:8.2f} s {rate:6.0f} points/s, {used[name]:6.2f} s of processors"
        )
    for title, name in (("1 process", one), (bare, bare), (steady, steady)):
        print(
            f"{cores} processes over {title}, per core: by the clock "
            f"{wall[name] / wall[every] / cores:.0%}, by the processors "
            f"{used[name] / used[every]:.0%}"
        )
    print(f"results equal: {found[one] == found[every]}; load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()

"""
Points of a campaign by the model, on one core and on all: points per second and efficiency.

Run as `python bench/model_sweep.py [POINTS]`. Efficiency is the time on one core over the time on
all of them times their number, start of the workers included; a machine that has other work to do
shows less.
"""

from __future__ import annotations

import os
import sys
import time

from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.model_sweep import predict_points
from imotor_ros.campaign.point import PointParameters


def make_points(count: int) -> list[NamedPoint]:
    points = []
    for number in range(count):
        leaves = {
            "signal.harmonics": 2 + number % 3,
            "signal.maximum_frequency": 5e3 + 13e3 * number / count,
        }
        points.append(NamedPoint(f"p{number}", PointParameters.from_leaves(leaves, "bench")))
    return points


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    cores = len(os.sched_getaffinity(0))
    start = time.perf_counter()
    points = make_points(count)
    print(f"{count} points made in {time.perf_counter() - start:.2f} s")
    list(predict_points(points[:10], 1))  # compiled code is loaded once
    times, found = {}, {}
    for jobs in (1, cores):
        start = time.perf_counter()
        found[jobs] = list(predict_points(points, jobs))
        times[jobs] = time.perf_counter() - start
        print(f"{jobs} job(s): {times[jobs]:.2f} s, {count / times[jobs]:.0f} points/s")
    print(f"efficiency {times[1] / (cores * times[cores]):.0%} of {cores} cores")
    print(f"results equal: {found[1] == found[cores]}; load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()

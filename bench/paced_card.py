"""
How fast the stand follows a card that is paced: time a run takes, and how often the card runs dry.

    python bench/paced_card.py
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from imotor_ros.bag.reader import RunBag
from imotor_ros.bag.types import installed_types
from imotor_ros.campaign.bench import DriveAdvanced
from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.driver import Driver
from imotor_ros.campaign.plan import RunPlan, plan_run
from imotor_ros.campaign.point import PointParameters
from imotor_ros.contracts.topics import DIAGNOSTICS
from imotor_ros.nodes.ros_bench import RosBench

CASES = ((1e6, 0.0), (1e6, 1.0), (250e3, 1.0), (100e3, 1.0))
"""Sample rates (Hz), and speed of the card over real time; 0 for as fast as it computes."""


def carry_out(plan: RunPlan, logs: Path) -> float:
    """Carry out a run on nodes of its own; return how long (s) the drive took."""
    with RosBench(logs, namespace="/paced_card") as bench:
        advances = (one for one in bench.run(plan) if isinstance(one, DriveAdvanced))
        moments = [time.monotonic() for _ in advances]
    return moments[-1] - moments[0]


def underruns(bag_path: Path) -> str:
    """Return how often the card had nothing to put out, as the driver's diagnostics say."""
    found = "unknown"
    with RunBag(bag_path) as bag:
        for message in bag.messages(DIAGNOSTICS.name):
            content = installed_types().deserialize(message.data, DIAGNOSTICS.type_name)
            for status in content.status:
                found = {pair.key: pair.value for pair in status.values}.get("underruns", found)
    return found


def main() -> None:
    """Print one line for each case."""
    print("rate (MS/s)  pace  stream (s)  took (s)  memory empty")
    for rate, pace in CASES:
        leaves = {
            "drive.hold_time": 1.0,
            "report_interval": 0.0,
            "stand.sample_rate": rate,
            "stand.block_length": round(rate / 100.0),
            # instruments and stator that so few samples can hold
            "stand.rod_vibrometer.cut_off_frequency": min(100e3, 0.4 * rate),
            "stand.slider_vibrometer.cut_off_frequency": min(100e3, 0.4 * rate),
            "stand.motor.voltage_monitor.cut_off_frequency": min(100e3, 0.4 * rate),
            "stand.motor.current_monitor.cut_off_frequency": min(100e3, 0.4 * rate),
        }
        point = NamedPoint(
            "p", PointParameters.from_leaves(leaves), Driver("template_driver", {"pace": pace})
        )
        with tempfile.TemporaryDirectory() as folder:
            plan = plan_run(point, Path(folder) / "p")
            took = carry_out(plan, Path(folder) / "logs")
            length = plan.program.length / rate
            empty = underruns(plan.bag_path)
        print(f"{rate / 1e6:11g}  {pace:4g}  {length:10.2f}  {took:8.2f}  {empty:>12}")


if __name__ == "__main__":
    main()

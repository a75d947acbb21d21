"""Friction identified over topics and in one process: the same numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from imotor_ros.campaign.friction import identify_motor
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.core.identification.stepped_sine import SteppedSineParameters
from imotor_ros.core.stand import StandParameters
from imotor_ros.nodes.ros_bench import RosBench

FEW = SteppedSineParameters(
    steps=4, lowest_amplitude=2.5e-6, step_time=0.012, corrections=1, corrected_frequency=4000.0
)


def test_both_benches_identify_the_same_friction(tmp_path: Path, namespace: str) -> None:
    with SimBench() as bench:
        in_process = identify_motor(StandParameters(), bench, tmp_path / "sim", FEW)
    with RosBench(tmp_path / "logs", namespace=namespace) as bench:
        over_topics = identify_motor(StandParameters(), bench, tmp_path / "ros", FEW)
    assert over_topics.to_mapping() == in_process.to_mapping()
    # both heads are off by a per cent or so
    line = in_process.fits["velocity"].friction
    assert line.numbers.force == pytest.approx(0.940, rel=0.05)

"""Exports for viewers: peaks stay, times are those of samples, layouts find their curves."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from imotor_ros.bag.export import (
    SCALAR_TYPE,
    Excerpt,
    export_csv,
    export_mcap,
    scope_topic,
    thin_out,
)
from imotor_ros.bag.reader import RunBag
from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.plan import plan_run
from imotor_ros.campaign.point import PointParameters
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.contracts.blocks import sample_time
from imotor_ros.contracts.topics import MEASURED_TOPICS
from imotor_ros.errors import BadInputError

LAYOUTS = Path(__file__).parents[2] / "params" / "layouts"
MEASURED = [topic.name for topic in MEASURED_TOPICS]


@pytest.fixture(scope="module")
def bag_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run."""
    leaves = {"drive.hold_time": 0.01, "report_interval": 0.0}
    point = NamedPoint("p", PointParameters.from_leaves(leaves))
    plan = plan_run(point, tmp_path_factory.mktemp("export"))
    list(SimBench().run(plan))
    return plan.bag_path


# ---- thinning out --------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 99, 100, 101, 1_000, 12_345])
def test_few_points_show_every_peak(count: int) -> None:
    """However thin, the largest and the smallest sample are kept, and the order is that of time."""
    samples = np.random.default_rng(count).standard_normal(count)
    index = thin_out(samples, 100)
    assert index.size <= 102, "the rest that fills no stretch has two points too"
    assert np.all(np.diff(index) > 0)
    assert {int(np.argmax(samples)), int(np.argmin(samples))} <= set(index.tolist())
    if count <= 100:
        assert index.tolist() == list(range(count))


# ---- files ---------------------------------------------------------------------------------------


def test_bag_has_scalars_at_the_times_of_their_samples(bag_path: Path, tmp_path: Path) -> None:
    traces = export_mcap(bag_path, tmp_path / "scope", Excerpt(points=500))
    with RunBag(bag_path) as bag:
        program = bag.program
        truth = {name: bag.samples(name)[0] for name in MEASURED}
    found: dict[str, list[tuple[int, float]]] = {}
    with AnyReader([tmp_path / "scope"]) as reader:
        assert {one.msgtype for one in reader.connections} == {SCALAR_TYPE}
        for connection, time, data in reader.messages():
            value = reader.deserialize(data, connection.msgtype).data
            found.setdefault(connection.topic, []).append((time, value))
    assert set(found) == {scope_topic(one.name) for one in traces}
    for one in traces:
        if one.name in truth:
            times = [sample_time(program.epoch, int(i), program.sample_rate) for i in one.index]
            expected = list(zip(times, truth[one.name][one.index].tolist(), strict=True))
            assert found[scope_topic(one.name)] == expected
            assert max(v for _, v in expected) == truth[one.name].max()


def test_table_has_every_sample_of_a_short_stretch(bag_path: Path, tmp_path: Path) -> None:
    export_csv(bag_path, tmp_path / "t.csv", Excerpt(begin=0.008, end=0.0081))
    with (tmp_path / "t.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    with RunBag(bag_path) as bag:
        rod = bag.samples("rod/velocity")[0]
    assert [float(row["time (s)"]) for row in rows] == [i / 1e6 for i in range(8000, 8100)]
    assert [float(row["rod/velocity (m/s)"]) for row in rows] == rod[8000:8100].tolist()


def test_nothing_is_overwritten_and_nothing_empty_is_written(
    bag_path: Path, tmp_path: Path
) -> None:
    for export in (export_csv, export_mcap):
        with pytest.raises(BadInputError, match="exists already"):
            export(bag_path, tmp_path, Excerpt())
        target = tmp_path / export.__name__
        with pytest.raises(BadInputError, match="holds no samples in this time"):
            export(bag_path, target, Excerpt(begin=100.0))
        assert not target.exists()
    for wrong in ({"begin": 2.0, "end": 1.0}, {"begin": -1.0}, {"points": 1}):
        with pytest.raises(BadInputError, match=r"begin and end|points"):
            Excerpt(**wrong)  # type: ignore[arg-type]


# ---- layouts -------------------------------------------------------------------------------------


def test_layouts_show_curves_that_an_exported_bag_has(bag_path: Path, tmp_path: Path) -> None:
    traces = export_mcap(bag_path, tmp_path / "scope", Excerpt(points=10))
    topics = {scope_topic(one.name) for one in traces}
    root = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
    curves = {curve.attrib["name"] for curve in root.iter("curve")}
    assert curves == {f"{scope_topic(name)}/data" for name in MEASURED}
    layout = json.loads((LAYOUTS / "foxglove.json").read_text())
    paths = {path["value"] for panel in layout["configById"].values() for path in panel["paths"]}
    assert paths == {f"{scope_topic(name)}.data" for name in MEASURED}
    assert {path.removesuffix(".data") for path in paths} <= topics
    places = json.dumps(layout["layout"])
    assert all(f'"{panel}"' in places for panel in layout["configById"])
    splitters = list(root.iter("DockSplitter"))
    assert all(int(one.attrib["count"]) == len(list(one)) for one in splitters)

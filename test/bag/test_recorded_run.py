"""A real run on the virtual stand: recorded, recorded again, recorded in disorder, evaluated."""

from __future__ import annotations

import json
import random
from itertools import pairwise

import pytest

from imotor_ros.bag.evaluate import evaluate_bag, recorded_parameters
from imotor_ros.bag.reader import RunBag
from imotor_ros.bag.writer import RunWriter
from imotor_ros.campaign.bench import PerformanceReported
from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.plan import plan_run
from imotor_ros.campaign.point import PointParameters
from imotor_ros.campaign.roles.recorder import RecorderRole
from imotor_ros.campaign.sim_bench import SimBench
from imotor_ros.contracts import topics
from imotor_ros.core.evaluator import EvaluatorParameters
from imotor_ros.errors import BadInputError, UnreadableFileError

LEAVES = {
    "drive.hold_time": 0.03,
    "stand.motor.load.upper_stop": 1.5e-3,
    "report_interval": 0.01,
    "evaluator.guard_periods": 3,
}


def content_of(path):
    with RunBag(path) as bag:
        return [(m.topic, m.time, m.data) for m in bag.messages()]


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    point = NamedPoint("point", PointParameters.from_leaves(LEAVES))
    return plan_run(point, tmp_path_factory.mktemp("run"), {"host": "first"})


@pytest.fixture(scope="module")
def performances(plan):
    """Carry out the run; return what was reported live."""
    with SimBench() as bench:
        events = list(bench.run(plan))
    return [event.performance for event in events if isinstance(event, PerformanceReported)]


@pytest.fixture(scope="module")
def bag_path(plan, performances):
    return plan.bag_path


def test_evaluation_of_the_bag_is_the_live_one_to_the_last_bit(bag_path, performances):
    found = evaluate_bag(bag_path)
    assert found.is_final
    assert json.dumps(found.to_mapping()) == json.dumps(performances[-1].to_mapping())
    with RunBag(bag_path) as bag:
        assert json.dumps(bag.performance.to_mapping()) == json.dumps(found.to_mapping())
        assert bag.message_counts["performance"] == len(performances) > 2


def test_evaluation_uses_the_recorded_parameters_unless_given_others(bag_path, plan):
    with RunBag(bag_path) as bag:
        assert recorded_parameters(bag) == plan.parameters.evaluator
    usual = evaluate_bag(bag_path).indicator("mean_velocity")
    strict = evaluate_bag(bag_path, EvaluatorParameters(minimum_periods=10_000))
    assert usual.is_available
    assert not strict.indicator("mean_velocity").is_available


def test_same_run_gives_the_same_messages_whatever_the_provenance(bag_path, plan, tmp_path):
    point = NamedPoint("point", plan.parameters)
    again = plan_run(point, tmp_path, {"host": "second"})
    with SimBench() as bench:
        list(bench.run(again))
    assert content_of(again.bag_path) == content_of(bag_path)


@pytest.mark.parametrize("seed", range(5))
def test_bag_does_not_depend_on_the_order_of_arrival(bag_path, plan, tmp_path, seed):
    rng = random.Random(seed)
    expected = content_of(bag_path)
    queues = {}
    for topic, _, data in expected:
        queues.setdefault(topic, []).append(data)
    arrivals = [topic for topic, queue in queues.items() for _ in queue]
    rng.shuffle(arrivals)
    recorder = RecorderRole(
        tmp_path / "bag",
        plan.program,
        run_info=plan.run_info,
        provenance={},
        report_interval=plan.parameters.report_interval,
    )
    heads = {topic: iter(queue) for topic, queue in queues.items()}
    for topic in arrivals:
        recorder.add(topic, next(heads[topic]), received=rng.randrange(2**62))
    recorder.close()
    assert content_of(tmp_path / "bag") == expected


def test_log_times_increase_and_follow_the_sample_index(bag_path, plan):
    times = [time for _, time, _ in content_of(bag_path)]
    assert all(a < b for a, b in pairwise(times))
    assert times[0] == plan.program.epoch
    end = plan.program.epoch + plan.program.length * 1000  # 1 MS/s
    assert end <= times[-1] < end + 2 * len(topics.ALL_TOPICS)


def test_run_without_program_cannot_be_evaluated(stand_run, tmp_path):
    RunWriter(tmp_path / "bag", run_id="run-1", run_info={}).close("aborted")
    with pytest.raises(UnreadableFileError, match="holds no message on drive/program"):
        evaluate_bag(tmp_path / "bag")


def test_parameters_of_another_version_are_refused_with_their_name(stand_run, tmp_path):
    info = {"parameters": {"evaluator": {"magic": 1}}}
    RunWriter(tmp_path / "bag", run_id="run-1", run_info=info).close("aborted")
    with pytest.raises(BadInputError, match="bag: evaluator: magic: is not a parameter"):
        evaluate_bag(tmp_path / "bag")

"""The parameters of every node of a stand, from the one point that is to be run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable

from imotor_ros.campaign.plan import RunPlan
from imotor_ros.contracts import graph
from imotor_ros.contracts.graph import Role, expected_readers
from imotor_ros.core.parameters import Parameters
from imotor_ros.nodes.evaluator import EvaluatorNodeParameters
from imotor_ros.nodes.force_sensor import ForceSensorNodeParameters
from imotor_ros.nodes.plant import PlantParameters
from imotor_ros.nodes.recorder import RecorderParameters
from imotor_ros.nodes.signal_generator import SignalGeneratorParameters
from imotor_ros.nodes.stand_node import NodeParameters
from imotor_ros.nodes.vibrometer import VibrometerNodeParameters


def _signal_generator(plan: RunPlan) -> NodeParameters:
    return SignalGeneratorParameters(
        block_length=plan.parameters.stand.block_length,
        awaits_recording=True,
        limits=plan.limits,
    )


def _plant(plan: RunPlan) -> NodeParameters:
    return PlantParameters(seed=plan.parameters.seed, motor=plan.parameters.stand.motor)


def _rod_vibrometer(plan: RunPlan) -> NodeParameters:
    head = plan.parameters.stand.rod_vibrometer
    return VibrometerNodeParameters(seed=plan.parameters.seed, vibrometer=head)


def _slider_vibrometer(plan: RunPlan) -> NodeParameters:
    head = plan.parameters.stand.slider_vibrometer
    return VibrometerNodeParameters(seed=plan.parameters.seed, vibrometer=head)


def _force_sensor(plan: RunPlan) -> NodeParameters:
    sensor = plan.parameters.stand.force_sensor
    return ForceSensorNodeParameters(seed=plan.parameters.seed, force_sensor=sensor)


def _evaluator(plan: RunPlan) -> NodeParameters:
    return EvaluatorNodeParameters(
        report_interval=plan.parameters.report_interval, evaluator=plan.parameters.evaluator
    )


def _recorder(plan: RunPlan) -> NodeParameters:
    return RecorderParameters(
        path=str(plan.bag_path.absolute()),
        run_info=plan.run_info_json,
        provenance=json.dumps(dict(plan.provenance)),
        report_interval=plan.parameters.report_interval,
    )


_BY_NODE: dict[str, Callable[[RunPlan], NodeParameters]] = {
    "signal_generator": _signal_generator,
    "plant": _plant,
    "rod_vibrometer": _rod_vibrometer,
    "slider_vibrometer": _slider_vibrometer,
    "force_sensor": _force_sensor,
    "evaluator": _evaluator,
    "recorder": _recorder,
}


def parameters_of_nodes(plan: RunPlan, roles: Iterable[Role]) -> dict[str, Parameters]:
    """
    Return the parameters of the nodes of a stand, by node name.

    Parameters
    ----------
    plan : RunPlan
        The run.
    roles : iterable of Role
        The nodes that are started.

    """
    roles = tuple(roles)
    parameters: dict[str, Parameters] = {
        role.name: _BY_NODE[role.name](plan).replace(expected_readers=expected_readers(role, roles))
        for role in roles
    }
    recorder = parameters.get(graph.RECORDER.name)
    if recorder is not None:
        others = {n: p.to_mapping() for n, p in parameters.items() if p is not recorder}
        with_nodes = json.dumps({**plan.provenance, "nodes": others})
        parameters[graph.RECORDER.name] = recorder.replace(provenance=with_nodes)
    return parameters

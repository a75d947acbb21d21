"""The parameters of every node of a stand, from the one point that is to be run."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable
from typing import Any

from imotor_ros.campaign.plan import RunPlan
from imotor_ros.contracts import graph
from imotor_ros.contracts.graph import Role, expected_readers
from imotor_ros.core.parameters import Parameters
from imotor_ros.errors import UnknownKeyError
from imotor_ros.nodes.evaluator import EvaluatorNodeParameters
from imotor_ros.nodes.force_sensor import ForceSensorNodeParameters
from imotor_ros.nodes.parameters import parameter_values
from imotor_ros.nodes.plant import PlantParameters
from imotor_ros.nodes.recorder import RecorderParameters
from imotor_ros.nodes.signal_generator import SignalGeneratorParameters
from imotor_ros.nodes.stand_node import NodeParameters
from imotor_ros.nodes.vibrometer import VibrometerNodeParameters

Leaves = dict[str, Any]
"""Parameters of one node by dotted name."""


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
        is_simulated=plan.driver.is_virtual,
        has_truth=plan.driver.is_virtual,
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


def parameters_of_driver(plan: RunPlan, roles: Iterable[Role], declared: Collection[str]) -> Leaves:
    """
    Return the parameters of the driver of a run by dotted name.

    It gets what its campaign gives it; and what is known of the stand, the seed and the number
    of its readers, as far as it has parameters of these names: a driver that simulates does.

    Parameters
    ----------
    plan : RunPlan
        The run.
    roles : iterable of Role
        The nodes that are started.
    declared : collection of str
        The parameters that the driver has.

    Raises
    ------
    UnknownKeyError
        If it does not have what the campaign gives it.

    """
    for name in plan.driver.parameters:
        if name not in declared:
            raise UnknownKeyError(
                f"is not a parameter of {plan.driver.executable}",
                where=f"driver_parameters: {name}",
                bound="one of " + ", ".join(sorted(declared)),
            )
    roles = tuple(roles)
    readers = next(expected_readers(one, roles) for one in roles if one.name == graph.DRIVER_NAME)
    known = {
        **parameter_values(plan.parameters.stand, "stand."),
        "seed": plan.parameters.seed,
        "expected_readers": readers,
    }
    given = {name: value for name, value in known.items() if name in declared}
    return {**given, **plan.driver.parameters}


def parameters_of_nodes(
    plan: RunPlan, roles: Iterable[Role], declared: Collection[str] = ()
) -> dict[str, Leaves]:
    """
    Return the parameters of the nodes of a stand by dotted name, by node name.

    Parameters
    ----------
    plan : RunPlan
        The run.
    roles : iterable of Role
        The nodes that are started.
    declared : collection of str
        The parameters that the driver has, if there is one; see `parameters_of_driver`.

    """
    roles = tuple(roles)
    parameters: dict[str, Parameters] = {
        role.name: _BY_NODE[role.name](plan).replace(expected_readers=expected_readers(role, roles))
        for role in roles
        if role.name != graph.DRIVER_NAME
    }
    nodes: dict[str, Any] = {name: one.to_mapping() for name, one in parameters.items()}
    leaves = {name: parameter_values(one) for name, one in parameters.items()}
    if not plan.driver.is_virtual:
        driver = parameters_of_driver(plan, roles, declared)
        nodes[graph.DRIVER_NAME] = leaves[graph.DRIVER_NAME] = driver
    if graph.RECORDER.name in leaves:
        del nodes[graph.RECORDER.name]
        with_nodes = json.dumps({**plan.provenance, "nodes": nodes})
        leaves[graph.RECORDER.name]["provenance"] = with_nodes
    return leaves

"""
Start a whole stand and take it to where it waits for a program to play.

::

    ros2 launch imotor_ros stand.launch.py
    ros2 launch imotor_ros stand.launch.py driver:=template_driver namespace:=/rig bag:=/data/run_1

"""

from __future__ import annotations

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
)
from launch.event_handlers import OnProcessStart, OnShutdown
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

from imotor_ros.contracts import graph
from imotor_ros.contracts.topics import DEFAULT_NAMESPACE

VIRTUAL = "virtual"

ARGUMENTS = (
    ("namespace", DEFAULT_NAMESPACE, "namespace of the stand"),
    ("driver", VIRTUAL, "executable, or package/executable, in the virtual motor's place"),
    ("params_file", "", "ROS parameter file for the nodes"),
    ("bag", "", "folder of the bag, new; if empty, the run id below the present folder"),
    ("activate", "true", "whether the nodes are configured and activated: true or false"),
)


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` carries out."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in ARGUMENTS
    ]
    ending = RegisterEventHandler(OnShutdown(on_shutdown=[OpaqueFunction(function=note_ending)]))
    return LaunchDescription([*declared, ending, OpaqueFunction(function=start_stand)])


def start_stand(context: LaunchContext) -> list[object]:
    """Return the nodes with their transitions."""
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    driver = given["driver"]
    roles = graph.VIRTUAL_STAND if driver == VIRTUAL else graph.stand_with(driver)
    nodes = [make_node(role, roles, given) for role in roles]
    wants_active = given["activate"].lower()
    if wants_active not in ("true", "false"):
        raise ValueError(f"activate: expected true or false, got {given['activate']!r}")
    if wants_active == "false":
        return list(nodes)
    return [action for node in nodes for action in (*transitions(node), node)]


def make_node(
    role: graph.Role, roles: tuple[graph.Role, ...], given: dict[str, str]
) -> LifecycleNode:
    """Return one node; the launch ends with it."""
    package, _, executable = role.executable.rpartition("/")
    parameters: list[object] = [given["params_file"]] if given["params_file"] else []
    parameters.append(node_parameters(role, roles, given))
    return LifecycleNode(
        package=package or "imotor_ros",
        executable=executable,
        name=role.name,
        namespace=given["namespace"],
        parameters=parameters,
        remappings=list(role.remappings.items()),
        output="screen",
        on_exit=OpaqueFunction(function=end_stand, args=[role.name]),
    )


_endings: list[str] = []


def note_ending(_context: LaunchContext) -> None:
    """Note that the launch is about to end."""
    _endings.append("launch")


def end_stand(_context: LaunchContext, name: str) -> list[object]:
    """Return what ends the launch when the first node does: a stand without it is of no use."""
    _endings.append(name)
    return [Shutdown(reason=f"{name} has ended")] if len(_endings) == 1 else []


def node_parameters(
    role: graph.Role, roles: tuple[graph.Role, ...], given: dict[str, str]
) -> dict[str, object]:
    """Return what follows from who takes part."""
    found: dict[str, object] = {}
    if readers := graph.expected_readers(role, roles):
        found["expected_readers"] = readers
    if role.name == graph.SIGNAL_GENERATOR.name:
        found["awaits_recording"] = True
    if role.name == graph.RECORDER.name:
        is_virtual = given["driver"] == VIRTUAL
        found |= {"path": given["bag"], "is_simulated": is_virtual, "has_truth": is_virtual}
    return found


def transitions(node: LifecycleNode) -> list[RegisterEventHandler]:
    """Return the handlers that configure a node when it runs, and then activate it."""
    return [
        RegisterEventHandler(
            OnProcessStart(
                target_action=node, on_start=[change(node, Transition.TRANSITION_CONFIGURE)]
            )
        ),
        RegisterEventHandler(
            OnStateTransition(
                target_lifecycle_node=node,
                start_state="configuring",
                goal_state="inactive",
                entities=[change(node, Transition.TRANSITION_ACTIVATE)],
            )
        ),
    ]


def change(node: LifecycleNode, transition: int) -> EmitEvent:
    """Return the action that asks a node for a transition."""
    return EmitEvent(
        event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition)
    )

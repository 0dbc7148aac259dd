"""`ros2 launch own_systems system.launch.py task:=segway.py policy:=nominal episodes:=3 record:=true`

The true system of a task, its controller in lock-step and, if wanted, the recorder.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import IfElseSubstitution
from launch.substitutions import LaunchConfiguration as Argument
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "task": (None, "a Python file with a ControlTask, or the name of an installed one"),
    "policy": ("nominal", "nominal, oracle, one of the task's own controllers, or a policy's file"),
    "episodes": ("1", "how many"),
    "seed": ("1", "of the first episode"),
    "record": ("false", "record it"),
    "path": ("recording", "folder of the recording"),
    "namespace": ("", "namespace of the graph"),
}


def node(package: str, name: str, parameters: dict[str, object], **more: object) -> Node:
    """Start one of the nodes."""
    space = Argument("namespace")
    return Node(package=package, executable=name, name=name, namespace=space, parameters=[parameters], **more)


def number(argument: object) -> ParameterValue:
    """An argument as a whole number."""
    return ParameterValue(argument, value_type=int)


def generate_launch_description() -> LaunchDescription:
    """The nodes; the simulator waits until all of them hear it."""
    task, readers = {"task": Argument("task")}, number(IfElseSubstitution(Argument("record"), "2", "1"))
    played = {name: number(Argument(name)) for name in ("seed", "episodes")}
    recorded = {"path": Argument("path"), "topics": ["parameters"]}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(n, default_value=value, description=text)
                for n, (value, text) in ARGUMENTS.items()
            ),
            node("rabbit_sim", "simulator", {**task, **played, "readers": readers}),
            node("rl_cbf_clf_controller", "controller", {**task, "policy": Argument("policy")}),
            node("rabbit_recording", "recorder", recorded, condition=IfCondition(Argument("record"))),
        ]
    )

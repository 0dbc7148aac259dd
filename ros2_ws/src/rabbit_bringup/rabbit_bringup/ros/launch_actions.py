"""What the launch files share: arguments from the options of `rabbit walk`, and the action that starts a node."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch.action import Action
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.launch_description import LaunchDescription
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from pydantic import BaseModel
from rabbit_common.options import Defaults, Given, described
from rabbit_common.threads import THREADS

from rabbit_bringup.launching.processes import PACKAGES, PATIENCE

PARAMETERS = f"{get_package_share_directory('rabbit_bringup')}/config/graph.yaml"
OF_EVERY_NODE = {
    "namespace": ("", "of the graph, within the one that an including launch file pushed"),
    "params_file": (PARAMETERS, "parameters of the nodes; what it names holds, whatever the arguments say"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
}
SWITCH = {"true": True, "1": True, "false": False, "0": False}


def description(
    declared: Sequence[DeclareLaunchArgument], launched: Callable[[dict[str, str]], Sequence[Action]]
) -> LaunchDescription:
    """The arguments, and what is `launched` under those of them that are given, without the defaults."""
    words: dict[str, str] = {}
    given = OpaqueFunction(function=lambda context: words.update(context.launch_configurations))
    return LaunchDescription([given, *declared, OpaqueFunction(function=lambda _: launched(words))])


def arguments(**more: tuple[str, str]) -> list[DeclareLaunchArgument]:
    """The arguments that `node` reads, and `more`: defaults and descriptions by name."""
    every = {**OF_EVERY_NODE, **more}
    return [DeclareLaunchArgument(n, default_value=default, description=text) for n, (default, text) in every.items()]


def arguments_of(
    *models: type[BaseModel], defaults: Defaults, but: Collection[str] = ()
) -> list[DeclareLaunchArgument]:
    """An argument for every field of `models`, `but` some, with the default that holds where none of them is given."""
    usual, texts = defaults.beneath({}), described(models, defaults)
    fields = {name: info for model in models for name, info in model.model_fields.items() if name not in but}
    return [
        DeclareLaunchArgument(
            name,
            default_value=word(usual.get(name, info.default)),
            description=texts[name] if name in defaults.bare else info.description,
        )
        for name, info in fields.items()
    ]


def word(value: Any) -> str:
    """A value as an argument; empty where there is none."""
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)


def given_of(words: Mapping[str, str], defaults: Defaults, *models: type[BaseModel]) -> Given:
    """The arguments that were given, as options of `models`; raises RuntimeError where a switch is none."""
    fields = {name: info for model in models for name, info in model.model_fields.items() if words.get(name)}
    typed = {
        name: switch(name, words[name]) if info.annotation is bool else words[name] for name, info in fields.items()
    }
    return Given(typed, defaults)


def switch(name: str, said: str) -> bool:
    """Whether a switch is on; raises RuntimeError."""
    if said.lower() not in SWITCH:
        raise RuntimeError(f"{name}:={said}: expected true or false")
    return SWITCH[said.lower()]


def rviz(namespace: Any) -> Node:
    """RViz with the layout of a walk; it needs rviz2."""
    layout = f"{get_package_share_directory('rabbit_bringup')}/config/walk.rviz"
    return Node(
        package="rviz2",
        executable="rviz2",
        namespace=namespace,
        arguments=["-d", layout],
        remappings=[("/tf", "tf"), ("/clock", "clock")],
    )


def node(name: str, parameters: Sequence[Any]) -> Node:
    """Start one of the graph's nodes; `parameters`: those beneath `params_file`."""
    return Node(
        package=PACKAGES[name],
        executable=name,
        name=name,
        namespace=LaunchConfiguration("namespace"),
        parameters=[*parameters, LaunchConfiguration("params_file")],
        remappings=[("/clock", "clock")],
        ros_arguments=["--enclave", f"/rabbit/{name}", "--log-level", LaunchConfiguration("log_level")],
        additional_env=dict.fromkeys(THREADS, "1"),
        output="screen",
        sigterm_timeout=str(PATIENCE),
        sigkill_timeout=str(PATIENCE),
    )

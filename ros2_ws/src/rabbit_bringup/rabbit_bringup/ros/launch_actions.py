"""What the launch files share: arguments made from the nodes' parameter models, and the action that starts a node."""

from collections.abc import Collection
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from pydantic import BaseModel
from rabbit_common.options import Defaults, described
from rabbit_common.threads import THREADS

from rabbit_bringup.launching.processes import PACKAGES, PATIENCE

PARAMETERS = f"{get_package_share_directory('rabbit_bringup')}/config/graph.yaml"
OF_EVERY_NODE = {
    "namespace": ("", "of the graph, within the one that an including launch file pushed"),
    "params_file": (PARAMETERS, "parameters of the nodes; what it names holds, whatever the arguments say"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
}


def arguments(**more: tuple[str, str]) -> list[DeclareLaunchArgument]:
    """Those that `node` reads, and `more`: the default and the description of each, by name."""
    every = {**OF_EVERY_NODE, **more}
    return [DeclareLaunchArgument(n, default_value=default, description=text) for n, (default, text) in every.items()]


def arguments_of(
    *models: type[BaseModel], defaults: Defaults, but: Collection[str] = ()
) -> list[DeclareLaunchArgument]:
    """An argument for each field of `models`, `but` some, with the default that holds where none of them is given."""
    own, texts = defaults.beneath({}), described(models, defaults)
    fields = {name: info for model in models for name, info in model.model_fields.items() if name not in but}
    return [
        DeclareLaunchArgument(
            name,
            default_value=word(own.get(name, info.default)),
            description=texts[name] if name in defaults.bare else info.description,
        )
        for name, info in fields.items()
    ]


def parameters_of(*models: type[BaseModel], but: Collection[str] = ()) -> dict[str, ParameterValue]:
    """The parameters of a node, each from the argument of its name and of its field's type."""
    defaults = {name: info.default for model in models for name, info in model.model_fields.items() if name not in but}
    kinds = {name: type(each) if isinstance(each, bool | int | float) else str for name, each in defaults.items()}
    return {name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, kind in kinds.items()}


def word(value: Any) -> str:
    """A value as an argument; empty where there is none."""
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)


def node(name: str, parameters: dict[str, Any], **more: Any) -> Node:
    """Start one of the graph's nodes."""
    return Node(
        package=PACKAGES[name],
        executable=name,
        name=name,
        namespace=LaunchConfiguration("namespace"),
        parameters=[parameters, LaunchConfiguration("params_file")],
        remappings=[("/clock", "clock")],
        ros_arguments=["--enclave", f"/rabbit/{name}", "--log-level", LaunchConfiguration("log_level")],
        additional_env=dict.fromkeys(THREADS, "1"),
        output="screen",
        sigterm_timeout=str(PATIENCE),
        sigkill_timeout=str(PATIENCE),
        **more,
    )

"""`ros2 launch rabbit_bringup display.launch.py`: a graph that runs, in the browser and as topics for RViz."""

from launch import LaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from rabbit_bringup.ros.launch_actions import arguments, arguments_of, node, rviz
from rabbit_common.options import Defaults
from rabbit_viewer.live.parameters import ViewerParameters


def generate_launch_description() -> LaunchDescription:
    """The viewer, and RViz if wanted."""
    waits = Defaults(always={"wait": 0.0})
    return LaunchDescription(
        [
            *arguments(rviz=("false", "start rviz2 too")),
            *arguments_of(ViewerParameters, defaults=waits),
            node("viewer", [{name: LaunchConfiguration(name) for name in ViewerParameters.model_fields}]),
            rviz(LaunchConfiguration("namespace"), IfCondition(LaunchConfiguration("rviz"))),
        ]
    )

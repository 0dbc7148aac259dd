"""`ros2 launch rabbit_bringup record.launch.py path:=DIR`: record a graph that runs or is about to."""

from launch import LaunchDescription
from launch.substitutions import LaunchConfiguration
from rabbit_bringup.ros.launch_actions import arguments, node


def generate_launch_description() -> LaunchDescription:
    """The recorder."""
    path = {"path": LaunchConfiguration("path")}
    return LaunchDescription([*arguments(path=("recording", "folder to be made")), node("recorder", [path])])

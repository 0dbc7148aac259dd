"""The launcher's part of walk.launch.py: begin, watch and end a walk whose nodes `ros2 launch` has started.

launcher WALK.json simulator=PID controller=PID ...
"""

import sys
from functools import partial
from pathlib import Path

from rabbit_common.child_process import end_with_parent
from rabbit_common.exit_codes import ExitCode
from rclpy.utilities import remove_ros_args

from rabbit_bringup.launching.walk import WalkSettings
from rabbit_bringup.launching.walk_report import carry_out, complain
from rabbit_bringup.ros.walking import walk_through


def main() -> None:
    """The executable `launcher`."""
    try:
        _, file, *nodes = remove_ros_args(sys.argv)
        walk = WalkSettings.model_validate_json(Path(file).read_bytes())
        launched = {name: int(pid) for name, _, pid in (node.partition("=") for node in nodes)}
    except (ValueError, OSError):
        complain("expected a walk and the nodes' process ids; it is walk.launch.py that calls this")
        sys.exit(ExitCode.REFUSED)
    end_with_parent()
    sys.exit(carry_out(walk, partial(walk_through, walk, launched=launched)))

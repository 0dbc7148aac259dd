"""Finds what `ros2 run PACKAGE EXECUTABLE` would find, by the same index."""

import os
from pathlib import Path

from rabbit_common.exit_codes import ExitCode

NAMESPACE = r"^(/?[a-zA-Z_]\w*)*$"  # of a graph
INDEX = Path("share/ament_index/resource_index/packages")


class LaunchError(RuntimeError):
    """A node that cannot be started or that ended by itself; one line that says what to do."""

    code = ExitCode.NODE_DIED


class Refused(LaunchError):
    """Nothing may be started: another graph is there, or the environment cannot be used."""

    code = ExitCode.REFUSED


def find_executable(package: str, name: str) -> Path:
    """`lib/PACKAGE/NAME` in the first sourced prefix that has the package.

    Raises:
        LaunchError: nothing is sourced, no such package, or no such executable in it.
    """
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    if not prefixes:
        raise LaunchError("no ROS 2 workspace is sourced: source ros2_ws/install/setup.bash")
    homes = [prefix for prefix in prefixes if (prefix / INDEX / package).is_file()]
    if not homes:
        raise LaunchError(
            f"package {package}: not in the sourced workspaces; call make build, then source its setup.bash"
        )
    folder = homes[0] / "lib" / package
    path = folder / name
    if not (path.is_file() and os.access(path, os.X_OK)):
        there = ", ".join(sorted(p.name for p in folder.glob("*") if os.access(p, os.X_OK))) or "none"
        raise LaunchError(f"package {package} has no executable {name}; it has: {there}")
    return path

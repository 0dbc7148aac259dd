"""Finds what `ros2 run PACKAGE EXECUTABLE` would find, by the same index."""

import os
from pathlib import Path

from rabbit_common.exit_codes import ExitCode

NAMESPACE = r"^(/?[a-zA-Z_]\w*)*$"  # of a graph


class LaunchError(RuntimeError):
    """A node that cannot be started or that ended by itself; one line that says what to do."""

    code = ExitCode.NODE_DIED


class Refused(LaunchError):
    """Nothing may be started: another graph is there, or the environment cannot be used."""

    code = ExitCode.REFUSED


def sourced_prefix(package: str) -> Path:
    """Where the first sourced workspace that has the package has it; raises `LaunchError` if none has."""
    try:
        from ament_index_python import get_package_prefix

        return Path(get_package_prefix(package))
    except (ImportError, OSError) as error:
        raise LaunchError("no ROS 2 workspace is sourced: source ros2_ws/install/setup.bash") from error
    except (LookupError, ValueError) as error:
        text = "not in the sourced workspaces; call make build, then source its setup.bash"
        raise LaunchError(f"package {package}: {text}") from error


def sourced_share(package: str) -> Path:
    """The folder with its messages and other data; raises as `sourced_prefix`."""
    return sourced_prefix(package) / "share" / package


def find_executable(package: str, name: str) -> Path:
    """`lib/PACKAGE/NAME` there; raises as `sourced_prefix`, also where there is no such executable."""
    folder = sourced_prefix(package) / "lib" / package
    path = folder / name
    if not (path.is_file() and os.access(path, os.X_OK)):
        there = ", ".join(sorted(p.name for p in folder.glob("*") if os.access(p, os.X_OK))) or "none"
        raise LaunchError(f"package {package} has no executable {name}; it has: {there}")
    return path

"""What a machine needs before the set-up begins; each check names what is missing and what to do."""

import os
import shutil
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path

from common import ROOT, SetUpError, system_ros

INSTALL = "with apt: `apt-get install build-essential cmake git python3-dev python3-venv`"
ROOM = 3  # GB, with the CPU build of torch


def check_tools() -> None:
    """Refuse a machine without a C and a C++ compiler, CMake or git."""
    compilers = [os.environ.get("CC", "cc"), os.environ.get("CXX", "c++")]
    for tool in (*compilers, "cmake", "git", "make"):
        if shutil.which(tool) is None:
            raise SetUpError(f"{tool} is not installed; install it ({INSTALL}), then call make again")


def check_python() -> None:
    """Refuse an interpreter without headers or without venv and ensurepip."""
    headers = Path(sysconfig.get_path("include")) / "Python.h"
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    if not headers.is_file():
        raise SetUpError(
            f"no headers for Python {version} ({headers}); install python{version}-dev, then call make again"
        )
    if find_spec("ensurepip") is None or find_spec("venv") is None:
        raise SetUpError(f"Python {version} has no venv; install python{version}-venv, then call make again")


def check_ros(prefix: Path | None) -> None:
    """Refuse a full ROS 2 that was built for another Python."""
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    if prefix and not any(prefix.glob(f"l*/**/python{version}/*-packages/rclpy")):
        raise SetUpError(f"the ROS 2 in {prefix} is not for Python {version}; call make with PYTHON=/usr/bin/python3")


def check_room(root: Path, gigabytes: float = ROOM) -> None:
    """Refuse a disk without room."""
    free = shutil.disk_usage(root).free / 1e9
    if free < gigabytes:
        raise SetUpError(f"{free:.1f} GB free at {root}, {gigabytes:g} GB needed; make room, then call make again")


def check_all() -> None:
    """All of the above."""
    check_tools()
    check_python()
    check_ros(system_ros())
    check_room(ROOT)

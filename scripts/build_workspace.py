"""`make build`: colcon builds ros2_ws over the environment's own or the system's ROS 2. A second call does nothing.

Modules are linked, not copied: a new or changed one needs no build. A new data file, message or executable does. Each
build is a whole one: colcon takes away nothing that has left a package, and cannot go on in another place.
"""

import os
import re
import shutil
from pathlib import Path

from common import (
    STATE,
    VENV,
    WORKSPACE,
    SetUpError,
    digest,
    is_done,
    logged,
    main,
    mark_done,
    plain_environment,
    say,
    system_ros,
)

SOURCES = WORKSPACE / "src"
LEFT_OVER = {"__pycache__", "build", *(path.name for path in SOURCES.glob("*/*.egg-info"))}  # by pip
LINKED = {".py", ".yaml", ".urdf", ".safetensors"}
COLCON = (
    'source "{venv}/setup.bash" && exec python "$(command -v colcon)" --log-base log build --base-paths src '
    "--symlink-install --event-handlers console_direct+ console_stderr- "
    "--cmake-args -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF "
    '-DPython3_EXECUTABLE="{venv}/bin/python"'
)
CAUSES = (
    (r"No space left on device|Errno 28", "no room on the disk: make room"),
    (r"No CMAKE_\w+_COMPILER|compiler.*not (found|able)", "no C++ compiler: install build-essential"),
    (r"find '__main__' module", "no colcon beside the full ROS 2: install python3-colcon-common-extensions"),
)


def source_files() -> list[Path]:
    """The files of the workspace that a build copies, links one by one or reads: all but modules and caches."""
    paths = [path for path in SOURCES.rglob("*") if path.is_file()]
    paths = [path for path in paths if not LEFT_OVER & set(path.relative_to(SOURCES).parent.parts)]
    return [path for path in paths if path.suffix != ".py" or path.name.endswith(("setup.py", ".launch.py"))]


def build_key() -> str:
    """A hash of what decides a build: all names, the contents of what is not linked, the environment."""
    files = source_files()
    read = [path for path in files if path.name.endswith("setup.py") or path.suffix not in LINKED]
    names = sorted(str(path.relative_to(SOURCES)) for path in files)
    place = f"{VENV} {(VENV / 'bin' / 'python').resolve()} {system_ros()}"
    return digest([*read, Path(__file__)], *names, place, (STATE / "mend.stamp").read_text())


def colcon_build() -> None:
    """Call colcon."""
    environment = {**plain_environment(), "MAKEFLAGS": f"-j{os.cpu_count()}"}  # colcon's own waits for idle cores
    log = STATE / "colcon.log"
    os.chdir(WORKSPACE)
    if logged(["bash", "-c", COLCON.format(venv=VENV)], log, environment):
        output = log.read_text(encoding="utf-8")
        advice = next((advice for pattern, advice in CAUSES if re.search(pattern, output)), "colcon could not build")
        raise SetUpError(f"{advice}, then call make again (log: .setup/colcon.log)")


def build() -> None:
    """Build unless nothing has changed."""
    key = build_key()
    if is_done("workspace", key) and (WORKSPACE / "install" / "setup.bash").is_file():
        return
    say("build: the ROS 2 workspace (a minute)")
    for name in ("build", "install", "log"):
        shutil.rmtree(WORKSPACE / name, ignore_errors=True)
    colcon_build()
    mark_done("workspace", key)


if __name__ == "__main__":
    main(build, "build")

"""Mend the ROS 2 wheels in an environment, so that CMake, colcon and a sourced shell find everything.

The wheels carry paths of the machine that built them: Python and numpy headers in the CMake files of the message
packages, and parent prefixes in the ament index. They also lack the set-up files that a ROS prefix has. Running this
twice is harmless.
"""

import re
import sysconfig
from collections.abc import Iterator
from pathlib import Path

BAKED = re.compile(r"/opt/python/cp\d+-cp\d+")

LOCAL_SETUP = """\
# Puts this environment in front of the shell's paths. Written by the set-up; POSIX sh.
_rabbit_prepend() {{
  eval "_rabbit_value=\\${{$1:-}}"
  case ":$_rabbit_value:" in
    *":$2:"*) ;;
    *) eval "export $1=\\"$2\\${{_rabbit_value:+:\\$_rabbit_value}}\\"" ;;
  esac
}}
{lines}
if [ -z "${{HOME:-}}${{ROS_HOME:-}}${{ROS_LOG_DIR:-}}" ]; then export ROS_HOME="{prefix}/.ros"; fi
unset -f _rabbit_prepend
unset _rabbit_value
"""


def mend_cmake(prefix: Path, python_headers: str, numpy_headers: str) -> int:
    """Point the message packages' CMake files at this environment's headers; returns how many files changed."""
    changed = 0
    for path in prefix.glob("share/*/cmake/*generator_pyExport.cmake"):
        text = path.read_text()
        mended = re.sub(rf"{BAKED.pattern}/lib/[^;\"]*/numpy/_core/include", numpy_headers, text)
        mended = re.sub(rf"{BAKED.pattern}/include/python[\d.]+", python_headers, mended)
        mended = BAKED.sub("${_IMPORT_PREFIX}", mended)
        if mended != text:
            path.write_text(mended)
            changed += 1
    return changed


def mend_parents(prefix: Path) -> int:
    """Blank the parent prefixes, which do not exist here; returns how many files changed."""
    entries = [
        path for path in prefix.glob("share/ament_index/resource_index/parent_prefix_path/*") if path.stat().st_size
    ]
    for path in entries:
        path.write_text("")
    return len(entries)


def wheel_paths(prefix: Path, site_packages: Path) -> Iterator[tuple[str, Path]]:
    """What a shell needs to use the wheels, in the order of prepending."""
    yield "PATH", prefix / "bin"
    for libraries in sorted(site_packages.glob("ros_*.libs")):
        yield "LD_LIBRARY_PATH", libraries
    yield "LD_LIBRARY_PATH", prefix / "lib"
    yield "CMAKE_PREFIX_PATH", prefix
    yield "AMENT_PREFIX_PATH", prefix


def write_setup_files(prefix: Path, lines: list[str], underlay: Path | None = None) -> None:
    """Write `setup.*` and `local_setup.*` at the prefix, for sh, bash and zsh; `setup.*` sources the underlay first."""
    local = LOCAL_SETUP.format(lines="\n".join(lines), prefix=prefix)
    for shell in ("sh", "bash", "zsh"):
        first = f'. "{underlay}/setup.{shell}"\n' if underlay else ""
        (prefix / f"local_setup.{shell}").write_text(local)
        (prefix / f"setup.{shell}").write_text(f'{first}. "{prefix}/local_setup.{shell}"\n')


def mend(prefix: Path) -> None:
    """Mend the wheels of the environment at `prefix`, whose interpreter runs this."""
    import numpy as np

    site_packages = Path(sysconfig.get_path("purelib"))
    files = mend_cmake(prefix, sysconfig.get_path("include"), np.get_include())
    parents = mend_parents(prefix)
    exports = [f'_rabbit_prepend {name} "{path}"' for name, path in wheel_paths(prefix, site_packages)]
    fixed = ["export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3"]
    write_setup_files(prefix, [*exports, *fixed])
    print(f"ROS wheels: {files} CMake files and {parents} index entries mended")


if __name__ == "__main__":
    import sys

    mend(Path(sys.prefix))

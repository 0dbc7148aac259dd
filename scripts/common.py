"""What the set-up scripts share: paths, one-line errors, stamps, logged commands. Standard library only."""

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / ".venv"
WORKSPACE = ROOT / "ros2_ws"
STATE = ROOT / ".setup"  # stamps and logs
UNDERLAY = STATE / "underlay"  # names the full ROS 2 in use
ENOSPC = 28
KEPT = {"PATH", "HOME", "LANG", "TERM", "CC", "CXX", "TMPDIR"}


class SetUpError(Exception):
    """What went wrong and what to do about it, in one line."""


def system_ros() -> Path | None:
    """Prefix of a full ROS 2 Jazzy: sourced in this shell, used before, or in /opt/ros/jazzy; None where none is."""
    sourced = os.environ.get("AMENT_PREFIX_PATH", "") if os.environ.get("ROS_DISTRO") == "jazzy" else ""
    before = UNDERLAY.read_text() if UNDERLAY.is_file() else ""
    for prefix in map(Path, filter(None, (*sourced.split(os.pathsep), before, "/opt/ros/jazzy"))):
        wheels = (prefix / "pyvenv.cfg").exists()  # some checkout's own environment
        if (prefix / "setup.bash").is_file() and (prefix / "share" / "rclpy").is_dir() and not wheels:
            return prefix
    return None


def plain_environment() -> dict[str, str]:
    """What a build sees: no other ROS 2 or Python."""
    return {name: value for name, value in os.environ.items() if name in KEPT}


def digest(paths: Iterable[Path], *words: str) -> str:
    """One hash over the content and names of files, and over words."""
    total = hashlib.sha256("\0".join(words).encode())
    for path in sorted(paths):
        total.update(f"\0{path}\0".encode() + path.read_bytes())
    return total.hexdigest()


def is_done(step: str, key: str) -> bool:
    """Whether the step's stamp says that it was done with just these inputs."""
    stamp = STATE / f"{step}.stamp"
    return stamp.is_file() and stamp.read_text() == key


def mark_done(step: str, key: str) -> None:
    """Write the step's stamp."""
    (STATE / f"{step}.stamp").write_text(key)


def forget(*steps: str) -> None:
    """Take back stamps: these steps are to be done again."""
    for step in steps:
        (STATE / f"{step}.stamp").unlink(missing_ok=True)


@contextmanager
def one_at_a_time(name: str) -> Iterator[None]:
    """Hold the lock of set-up or build, so that two calls of make do not fight over one environment."""
    STATE.mkdir(exist_ok=True)
    with (STATE / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def logged(command: list[str], log: Path, environment: Mapping[str, str] | None = None) -> int:
    """Run a command with its output in `log` and, on a terminal, its last line on the screen; returns its exit code."""
    screen = sys.stderr.isatty()
    width = shutil.get_terminal_size().columns - 1
    with (
        log.open("w", encoding="utf-8") as out,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", env=environment
        ) as process,
    ):
        for line in process.stdout or ():
            out.write(line)
            if screen:
                print(f"\r\033[K{line.strip()[:width]}", end="", file=sys.stderr, flush=True)
    if screen:
        print("\r\033[K", end="", file=sys.stderr, flush=True)
    return process.returncode


def say(text: str) -> None:
    """Tell the user what is going on."""
    print(text, flush=True)


def main(work: Callable[[], None], name: str = "set-up") -> None:
    """Run a script's work under the lock; an error becomes one line, which `name` begins, and exit code 1."""
    try:
        with one_at_a_time(name):
            work()
    except SetUpError as error:
        sys.exit(f"{name}: {error}")
    except OSError as error:
        advice = "make room on the disk" if error.errno == ENOSPC else "mend that"
        sys.exit(f"{name}: {error}; {advice}, then call make again")
    except KeyboardInterrupt:
        sys.exit(f"{name}: interrupted; the next call goes on from here")

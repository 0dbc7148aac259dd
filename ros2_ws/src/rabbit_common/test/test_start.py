"""The executables: the right node, a Ctrl-C at any moment without a traceback; SCHED_FIFO where permitted."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from rabbit_common.priority import BENEATH, NICE, leave_priority, scheduling, take_listeners_priority, take_priority

SOURCES = Path(__file__).resolve().parents[2]
SCRIPTS = sorted(SOURCES.glob("*/bin/*"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
@pytest.mark.parametrize("seconds", [0.0, 0.1])
def test_an_early_interrupt_is_quiet(script: Path, seconds: float) -> None:
    """Also before the first line of ours: the interpreter itself would answer with a traceback."""
    process = subprocess.Popen(
        [str(script), "--help"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    assert "Traceback" not in process.communicate(timeout=180)[1]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_without_the_workspace_an_executable_says_what_to_source(script: Path) -> None:
    bare = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([str(script)], capture_output=True, text=True, timeout=180, check=False, env=bare)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2
    assert "No module named 'rabbit_" in line
    assert "setup.bash" in line


@pytest.mark.parametrize(
    ("take", "priority", "own"),
    [
        (take_priority, 7, "SCHED_FIFO 7"),
        (take_listeners_priority, 50, f"SCHED_FIFO {50 - BENEATH}"),
        (take_listeners_priority, 3, "SCHED_FIFO 1"),
        (take_listeners_priority, 0, "ordinary"),
    ],
)
def test_priority_is_taken_where_permitted_and_listeners_are_beneath(take: Any, priority: int, own: str) -> None:
    take(priority, pytest.skip)
    found = scheduling()
    leave_priority()
    assert (found, scheduling()) == (own, "ordinary")


def test_who_gives_way_does_so_with_the_threads_to_come() -> None:
    """What runs before stays."""
    code = """
import os, threading
from rabbit_common.priority import give_way
begun = os.nice(0)
def nice(found): found.append(os.nice(0) - begun)
go, before, after, own = threading.Event(), [], [], []
early = threading.Thread(target=lambda: go.wait() and nice(before))
early.start()
give_way()
go.set()
late = threading.Thread(target=nice, args=[after])
late.start()
early.join(), late.join(), nice(own)
print(*before, *own, *after)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["0", str(NICE), str(NICE)]

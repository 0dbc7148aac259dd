"""SCHED_FIFO: taken where it is permitted, refused with a line that says what would permit it."""

import subprocess
import sys

import pytest
from rabbit_common.priority import BENEATH, NICE, leave_priority, scheduling, take_listeners_priority, take_priority


def test_priority_is_taken_where_permitted() -> None:
    take_priority(7, pytest.skip)
    try:
        assert scheduling() == "SCHED_FIFO 7"
    finally:
        leave_priority()
    assert scheduling() == "ordinary"


@pytest.mark.parametrize(
    ("priority", "own"), [(50, f"SCHED_FIFO {50 - BENEATH}"), (3, "SCHED_FIFO 1"), (0, "ordinary")]
)
def test_listeners_are_beneath(priority: int, own: str) -> None:
    take_listeners_priority(priority, pytest.skip)
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

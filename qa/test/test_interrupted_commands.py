"""A long command that is interrupted, at any moment and in any way, goes on when it is called again."""

import os
import random
import signal
import time
from pathlib import Path

import pytest

from .interrupted import COMMANDS, ENDING, SIGNALS, chain, disk, finished, marked, may_mount, start

SLOW = [pytest.param(name, seed, marks=pytest.mark.slow) for name in COMMANDS for seed in (2, 3)]
EACH = [pytest.param(name, marks=() if name == "evaluate" else pytest.mark.slow) for name in COMMANDS]


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("name", "seed"), [("evaluate", 1), *SLOW])
def test_an_interrupted_command_goes_on(name: str, seed: int, tmp_path: Path) -> None:
    """To the result of one that nobody disturbs; no process is left, and nothing foreign is lost."""
    interruptions, wrong = chain(name, tmp_path / "disk", random.Random(seed))
    assert [each for each in interruptions if each.wrong] == []
    assert wrong == ""


@pytest.mark.parametrize("how", ["TERM", "KILL"])
def test_no_worker_outlives_its_command(how: str, tmp_path: Path) -> None:
    mark, end = str(tmp_path), time.monotonic() + 120
    process = start("evaluate", tmp_path / "out", mark, "--stones", "1000")  # a run takes minutes
    while len(marked(mark)) < 5 and time.monotonic() < end:  # two workers, two that count resources
        time.sleep(0.05)
    time.sleep(3)
    process.send_signal(SIGNALS[how])
    said, _ = process.communicate()
    if how == "TERM":  # as a Ctrl-C
        assert process.returncode == 128 + SIGNALS[how], said
        assert "goes on" in said
        assert "Traceback" not in said
    else:
        assert process.returncode == -SIGNALS[how]
    end = time.monotonic() + ENDING
    while marked(mark) and time.monotonic() < end:
        time.sleep(0.05)
    left = marked(mark)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert left == []


def refusal(name: str, out: Path) -> tuple[str, int]:
    """The one line of a command that says what is wrong, and its exit code."""
    said, code = finished(name, out)
    assert "Traceback" not in said
    (line,) = (line for line in said.splitlines() if line.startswith("rabbit: "))
    return line, code


@pytest.mark.parametrize("name", EACH)
def test_a_full_disk_is_one_line(name: str, tmp_path: Path) -> None:
    if not may_mount():
        pytest.skip("this user may not mount a tmpfs")
    with disk(tmp_path / "disk", "size=4k"):
        line, code = refusal(name, tmp_path / "disk" / "out")
    assert code != 0, line
    assert f"{tmp_path / 'disk' / 'out'}" in line
    assert "No space left on device" in line


@pytest.mark.parametrize("name", EACH)
def test_a_read_only_disk_is_one_line(name: str, tmp_path: Path) -> None:
    if not may_mount():
        pytest.skip("this user may not mount a tmpfs")
    with disk(tmp_path / "disk", "ro"):
        line, code = refusal(name, tmp_path / "disk" / "out")
    assert code == 2, line
    assert f"{tmp_path / 'disk' / 'out'}: Read-only file system" in line

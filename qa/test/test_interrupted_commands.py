"""A long command that is interrupted, at any moment and in any way, goes on when it is called again."""

import csv
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rabbit_description.atomic_file import PARTIAL

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import main; main()")
SIGNALS = {"INT": signal.SIGINT, "TERM": signal.SIGTERM, "KILL": signal.SIGKILL}
MARK = "RABBIT_INTERRUPTED"  # in the environment of a command and of all that it starts
LIMIT, ENDING = 300.0, 30.0  # s for a command; for what it has started, after it has ended
TIMES = ("tick_ms", "plant_ms", "walk_seconds")
FOREIGN = "notes.txt"


def table(name: str, out: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, without times."""
    with (out / name).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [{key: value for key, value in row.items() if not any(word in key for word in TIMES)} for row in rows]


CELL = ("--cells", "stones/scale-2", "--courses", "2")
COMMANDS: dict[str, tuple[tuple[str, ...], Callable[[Path], Any]]] = {
    "evaluate": (
        ("--controller", "cbf-clf-qp", "--runs", "5", "--stones", "1", "--jobs", "2"),
        partial(table, "runs.csv"),
    ),
    "benchmark": (("nominal", *CELL, "--jobs", "2"), partial(table, "benchmark.csv")),
    "gait": (("--name", "g", "--intervals", "10"), lambda out: (out / "g.yaml").read_bytes()),
}
EACH = [pytest.param(name, marks=() if name == "evaluate" else pytest.mark.slow) for name in COMMANDS]


def start(name: str, out: Path, mark: str = "", *more: str) -> "subprocess.Popen[str]":
    """The command in a session of its own."""
    return subprocess.Popen(
        [*RABBIT, name, *COMMANDS[name][0], *more, "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # a shell ignores it in the background
        env={**os.environ, MARK: mark, "COLUMNS": "200"},
        cwd=out.parent,
    )


def finished(name: str, out: Path) -> tuple[int, str]:
    """Exit code and output of an undisturbed command."""
    process = start(name, out)
    said, _ = process.communicate(timeout=LIMIT)
    return process.returncode, said


def left(mark: str) -> list[int]:
    """The processes that a command has left, after a while."""
    end, found = time.monotonic() + ENDING, [0]
    while found and time.monotonic() < end:
        found = []
        for path in Path("/proc").glob("[0-9]*/environ"):
            with suppress(OSError):
                if f"{MARK}={mark}\0".encode() in path.read_bytes():
                    found.append(int(path.parent.name))
        time.sleep(0.05)
    for pid in found:
        os.kill(pid, signal.SIGKILL)
    return found


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", EACH)
def test_an_interrupted_command_goes_on(name: str, tmp_path: Path) -> None:
    """To the result of one that nobody disturbs; no process is left, and nothing foreign is lost."""
    result, begin = COMMANDS[name][1], time.monotonic()
    code, said = finished(name, tmp_path / "undisturbed")
    assert code in (0, 1), said
    seconds, out, draw = time.monotonic() - begin, tmp_path / "out", random.Random(27)
    for how, number in SIGNALS.items():
        process = start(name, out, mark := f"{tmp_path}-{how}")
        with suppress(subprocess.TimeoutExpired):
            process.wait(draw.uniform(0.1, 0.5) * seconds)
        (os.killpg if how == "INT" else os.kill)(process.pid, number)
        said, _ = process.communicate(timeout=LIMIT)
        assert process.returncode in (-number, 128 + number), said
        assert "Traceback" not in said or how == "KILL"  # a worker that has only just begun may miss its dead parent
        assert left(mark) == []
        if out.exists() and any(out.iterdir()):  # the command's own by now
            (out / FOREIGN).write_text(FOREIGN)
    code, said = finished(name, out)
    assert code in (0, 1), said
    assert result(out) == result(tmp_path / "undisturbed")
    assert not [path for path in out.rglob(".*") if PARTIAL.fullmatch(path.name)]
    assert not (out / FOREIGN).exists() or (out / FOREIGN).read_text() == FOREIGN


@pytest.mark.parametrize("kind", ["size=4k", "ro"])
def test_a_disk_that_takes_nothing_is_one_line(kind: str, tmp_path: Path) -> None:
    (folder := tmp_path / "disk").mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", kind, "none", folder], capture_output=True, check=False)
    if mounted.returncode:
        pytest.skip("this user may not mount a tmpfs")
    try:
        code, said = finished("evaluate", folder / "out")
    finally:
        subprocess.run(["umount", "-l", folder], check=True)
    (line,) = (line for line in said.splitlines() if line.startswith("rabbit: "))
    assert code != 0
    assert str(folder / "out") in line
    assert ("Read-only file system" if kind == "ro" else "No space left on device") in line
    assert "Traceback" not in said

"""Long commands that are interrupted at random moments, and then called again: nothing may be lost, nothing left.

    python qa/test/interrupted.py 300 27     until 300 commands were interrupted, drawn from seed 27

A signal reaches a command as from a terminal (SIGINT: the whole group) or from a supervisor (SIGTERM, SIGKILL: the
process alone). The disk is a small tmpfs, which becomes full or read-only; where this user may not mount one, only
signals are drawn.
"""

import csv
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from rabbit_description.atomic_file import PARTIAL

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import main; main()")
SIGNALS = {"INT": signal.SIGINT, "TERM": signal.SIGTERM, "KILL": signal.SIGKILL}
DISK = ("full", "read-only")
MARK = "RABBIT_INTERRUPTED"  # in the environment of a command and of all that it starts
LIMIT = 300.0  # s for a command, and
ENDING = 30.0  # s for what it has started, after it has ended
TIMES = ("tick_ms", "plant_ms", "walk_seconds", "wall", "real_time", "seconds", "hours", "ms_", "_ms")
EARLIEST = 0.1  # of a command's time: a Ctrl-C while Python imports the first modules is Python's traceback
FOREIGN = "notes.txt"


@dataclass(frozen=True)
class Command:
    """A command that takes `--out`, and what of its folder must be as in an undisturbed one."""

    words: tuple[str, ...]
    result: Callable[[Path], Any]
    goes_on: bool = True  # in the same folder; a walk needs a new one


def table(name: str) -> Callable[[Path], Any]:
    """The rows of a CSV file, without times."""

    def read(out: Path) -> Any:
        with (out / name).open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return [{key: value for key, value in row.items() if not any(word in key for word in TIMES)} for row in rows]

    return read


def tables_of(name: str) -> Callable[[Path], Any]:
    """Claims, runs and the files of an experiment."""

    def read(out: Path) -> Any:
        found = [table(each)(out) for each in ("claims.csv", "runs.csv")]
        return found, sorted(path.name for path in (out / name).iterdir()), (out / "results.md").exists()

    return read


def trained(out: Path) -> Any:
    """The last policy's weights and the reports of all episodes."""
    from rl_cbf_clf_controller.weights import read
    from rl_trainer.checkpoint import read_checkpoint

    arrays = {name: array.tobytes() for name, array in read(out / "policy.safetensors").arrays.items()}
    reports = (read_checkpoint(out) or {})["reports"]
    return arrays, [{**report, "seconds": 0.0} for report in reports]


def walked(out: Path) -> Any:
    """How the episodes of a walk went; the controller's id is drawn."""
    return [{**each, "controller": ""} for each in json.loads((out / "summary.json").read_text())["episodes"]]


TRAIN = ("--problem", "rl-clf-qp", "--episodes", "4", "--nominal-episodes", "1", "--walking-steps", "1", "--batch", "8")
COMMANDS = {
    "evaluate": Command(
        ("evaluate", "--controller", "cbf-clf-qp", "--runs", "5", "--stones", "1", "--jobs", "2"), table("runs.csv")
    ),
    "benchmark": Command(
        ("benchmark", "nominal", "--cells", "stones/scale-2", "--courses", "2", "--jobs", "2"),
        table("benchmark.csv"),
    ),
    "reproduce": Command(("reproduce", "stepping-stone", "--quick", "--jobs", "2"), tables_of("stepping-stone")),
    "train": Command(("train", *TRAIN, "--updates-least", "40", "--updates-per-tick", "0"), trained),
    "gait": Command(("gait", "--name", "g", "--intervals", "10"), lambda out: (out / "g.yaml").read_bytes()),
    "walk": Command(
        (
            "walk",
            "--controller",
            "cbf-clf-qp",
            "--stones",
            "1",
            "--no-pictures",
            "--no-video",
            "--ready-timeout",
            "250",
        ),
        walked,
        goes_on=False,
    ),
}


@cache
def may_mount() -> bool:
    """Whether this user may mount a tmpfs."""
    with tempfile.TemporaryDirectory() as folder:
        if _mount("-t", "tmpfs", "none", folder):
            subprocess.run(["umount", folder], check=True)
            return True
    return False


@contextmanager
def disk(folder: Path, kind: str = "size=400m") -> Iterator[None]:
    """A tmpfs there with this mount option, where permitted."""
    folder.mkdir(parents=True, exist_ok=True)
    is_mounted = may_mount()
    if is_mounted:
        assert _mount("-t", "tmpfs", "-o", kind, "none", str(folder))
    try:
        yield
    finally:
        if is_mounted:
            subprocess.run(["umount", "-l", str(folder)], check=True)


def _mount(*words: str) -> bool:
    return subprocess.run(["mount", *words], capture_output=True, check=False).returncode == 0


def start(name: str, out: Path, mark: str = "", *more: str) -> subprocess.Popen[str]:
    """The command, with `more` words, in a session of its own."""
    return subprocess.Popen(
        [*RABBIT, *COMMANDS[name].words, *more, "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # a shell ignores it in the background
        env={"ROS_DOMAIN_ID": str(1 + os.getpid() % 100), **os.environ, MARK: mark, "COLUMNS": "200"},
        cwd=out.parent,
    )


def marked(mark: str) -> list[int]:
    """The processes that a command has left."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if f"{MARK}={mark}\0".encode() in path.read_bytes():
                found.append(int(path.parent.name))
    return found


@dataclass(frozen=True)
class Interruption:
    """What `how` did after so many seconds, and what is `wrong`; nothing where all is well.

    Without `is_early` the command had ended before. It ended `later` seconds afterwards.
    """

    how: str
    is_early: bool
    after: float
    later: float
    code: int
    wrong: str


def interrupt(name: str, out: Path, how: str, after: float) -> Interruption:
    """Call a command and disturb it; the disk is as before afterwards."""
    mark = f"{os.getpid()}-{time.monotonic_ns()}"
    process, disk_folder = start(name, out, mark), str(out.parent)
    with suppress(subprocess.TimeoutExpired):
        process.wait(after)
    is_early, begin = process.poll() is None, time.monotonic()
    if is_early:
        if how == "INT":
            os.killpg(process.pid, signal.SIGINT)
        elif how in SIGNALS:
            process.send_signal(SIGNALS[how])
        elif how == "full":
            used = os.statvfs(disk_folder)
            _mount("-o", f"remount,size={(used.f_blocks - used.f_bfree) * used.f_frsize}", disk_folder)
        else:
            while not _mount("-o", "remount,ro", disk_folder) and process.poll() is None:
                time.sleep(0.02)  # a file is open for writing
    try:
        said, _ = process.communicate(timeout=LIMIT)
    except subprocess.TimeoutExpired:
        process.kill()
        said, _ = process.communicate()
        said += "\nstill running"
    later = time.monotonic() - begin
    if how in DISK:
        _mount("-o", "remount,rw,size=400m", disk_folder)
    return Interruption(how, is_early, after, later, process.returncode, _wrong(how, process.returncode, said, mark))


def _wrong(how: str, code: int, said: str, mark: str) -> str:
    words = ("still running",) if how == "KILL" else ("still running", "Traceback")
    wrong = [word for word in words if word in said]  # a worker that has only just begun may miss its dead parent aloud
    lines = [line for line in said.splitlines() if line.startswith("rabbit: ")]
    allowed = (-SIGNALS[how], 128 + SIGNALS[how]) if how in SIGNALS else (2, 3, 4)
    if code not in (0, 1, *allowed):
        wrong.append(f"exit code {code}")
    if code and how in DISK and len(lines) != 1:
        wrong.append(f"{len(lines)} lines say why")
    end = time.monotonic() + ENDING
    while (left := marked(mark)) and time.monotonic() < end:
        time.sleep(0.1)
    for pid in left:
        wrong.append(f"orphan {Path(f'/proc/{pid}/cmdline').read_bytes().replace(bytes(1), b' ')[:200]!r}")
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return f"{'; '.join(wrong)}: {said[-3000:]}" if wrong else ""


@cache
def reference(name: str) -> tuple[Any, float]:
    """What the command's folder holds when nobody disturbs it, and how many seconds it takes."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.monotonic()
        said, code = finished(name, Path(folder) / "out")
        assert code in (0, 1), said
        return COMMANDS[name].result(Path(folder) / "out"), time.monotonic() - begin


def finished(name: str, out: Path) -> tuple[str, int]:
    """What the command said, undisturbed, and its exit code."""
    process = start(name, out)
    said, _ = process.communicate(timeout=LIMIT)
    return said, process.returncode


def chain(name: str, folder: Path, draw: random.Random) -> tuple[list[Interruption], str]:
    """A command that is interrupted a few times, then ends; what is wrong with what it leaves, or nothing."""
    expected, seconds = reference(name)
    command, kinds = COMMANDS[name], [*SIGNALS, *(DISK if may_mount() else ())]
    done: list[Interruption] = []
    with disk(folder):
        foreign = [folder / FOREIGN]
        foreign[0].write_text(FOREIGN)
        for number in range(draw.randint(3, 5)):
            out = folder / ("out" if command.goes_on else str(number))
            how, share = draw.choice(kinds), draw.uniform(EARLIEST, 1 / (1 + command.goes_on))
            done.append(interrupt(name, out, how, share * seconds))
            if (
                len(foreign) == 1 and command.goes_on and out.exists() and any(out.iterdir())
            ):  # the command's own by now
                foreign.append(out / FOREIGN)
                foreign[1].write_text(FOREIGN)
        out = folder / ("out" if command.goes_on else "last")
        said, code = finished(name, out)
        if code not in (0, 1):
            return done, f"exit code {code}: {said[-2000:]}"
        if command.result(out) != expected:
            return done, f"not the reference: {command.result(out)}, expected {expected}"
        if left := [path for path in out.rglob(".*") if PARTIAL.fullmatch(path.name)]:
            return done, f"half written: {left}"
        if any(path.read_text() != FOREIGN for path in foreign):
            return done, "a foreign file is lost"
    return done, ""


def main() -> None:
    """See the head of this file."""
    cases, seed = int(sys.argv[1]), int(sys.argv[2])
    draw, seen, lost, orphans = random.Random(seed), Counter[str](), 0, 0
    while seen.total() < cases:
        for name in reversed(COMMANDS):
            with tempfile.TemporaryDirectory() as folder:
                done, wrong = chain(name, Path(folder) / "disk", draw)
            early = [each for each in done if each.is_early]
            seen.update(f"{name} {each.how}" for each in early)
            lost += bool(wrong) or any(each.wrong and "orphan" not in each.wrong for each in done)
            orphans += sum("orphan" in each.wrong for each in done)
            at = ", ".join(f"{each.how} {each.after:.1f} + {each.later:.1f} s: {each.code}" for each in early)
            print(
                f"{seen.total():4d} {name}: {at}", *(f"\n{text}" for each in done if (text := each.wrong)), flush=True
            )
            print(*([f"WRONG {wrong}"] if wrong else []), end="\n" * bool(wrong), flush=True)
    print(f"{seen.total()} interrupted commands, seed {seed}: {lost} wrong, {orphans} with orphans; {dict(seen)}")


if __name__ == "__main__":
    main()

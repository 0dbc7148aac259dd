"""A long command that is interrupted goes on when it is called again; after a change no old result is served."""

import csv
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from rabbit_description.atomic_file import PARTIAL
from rl_cbf_clf_controller.weights import read

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


TRAINING = ("--problem", "rl-clf-qp", "--episodes", "4", "--nominal-episodes", "1", "--walking-steps", "1")
TRAINING += ("--batch", "8", "--updates-least", "40", "--updates-per-tick", "0")
CELL = ("--cells", "stones/scale-2", "--courses", "2")
COMMANDS: dict[str, tuple[tuple[str, ...], Callable[[Path], Any]]] = {
    "evaluate": (
        ("--controller", "cbf-clf-qp", "--runs", "5", "--stones", "1", "--jobs", "2"),
        partial(table, "runs.csv"),
    ),
    "benchmark": (("nominal", *CELL, "--jobs", "2"), partial(table, "benchmark.csv")),
    "gait": (
        ("--name", "g", "--intervals", "10", "--library", "0.34,0.35,0.36", "--jobs", "2"),
        lambda out: (out / "g.yaml").read_bytes(),
    ),
    "train": (TRAINING, lambda out: {name: a.tobytes() for name, a in read(out / "policy.safetensors").arrays.items()}),
}
EACH = [pytest.param(name, marks=() if name in ("evaluate", "train") else pytest.mark.slow) for name in COMMANDS]


def start(name: str, out: Path, mark: str = "") -> "subprocess.Popen[str]":
    """The command in a session of its own."""
    return subprocess.Popen(
        [*RABBIT, name, *COMMANDS[name][0], "--out", str(out)],
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
        expected = (code,)  # the machine was slower in the first run: this one is done
        if process.returncode is None:
            (os.killpg if how == "INT" else os.kill)(process.pid, number)
            expected = -number, 128 + number
        said, _ = process.communicate(timeout=LIMIT)
        assert process.returncode in expected, said
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


PACKAGES = (
    *("cbf_clf_qp", "rabbit_common", "rabbit_description", "rabbit_estimator", "rabbit_experiments", "rabbit_sim"),
    *("rabbit_viewer", "rl_cbf_clf_controller", "rl_trainer"),
)
CHANGES = 40  # of bytes of files that the run opened or loaded
OWN = """
from rabbit_experiments.assembly import Assembly
from own_package.late import share

class Weaker(Assembly):
    def make_controller(self):
        controller = super().make_controller()
        step = controller.step

        def weaker_step(state):
            output = step(state)
            output.torque[:] *= share
            return output

        controller.step = weaker_step
        return controller

class Weakest(Weaker):
    pass
"""
PROGRAM = """
import importlib, json, os, shutil, sys
from dataclasses import replace
from pathlib import Path
import numpy as np

folder, opened = Path(sys.argv[1]), set()
sys.addaudithook(lambda event, given: opened.add(str(given[0])) if event == "open" else None)
from own_package.assembly import Weaker, Weakest
from rabbit_experiments import provenance, source_code
from rabbit_experiments.cache import Cache
from rabbit_experiments.evaluation import RecordedWalk, Walk
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters

def job(kind=Weaker, seed=7, **changes):
    own = {"controller": "rl-cbf-clf-qp", "gait": str(folder / "gait.yaml")}
    tuning = load_parameters("ours", **own, **{name: changes.pop(name) for name in ("eps",) if name in changes})
    plant = SimulationParameters(stones=1, course=str(folder / "course.yaml"), **changes)
    return Walk(kind(plant, tuning, str(folder / "rl-cbf-clf-qp.safetensors")), seed)

def served(job):
    for each in (source_code.code_of, provenance._parts, provenance.versions):
        each.cache_clear()
    importlib.invalidate_caches()
    return Cache(folder / "cache").get(job) is not None

Cache(folder / "cache").put(job(), job().do())
assert served(job())
others = [job(seed=8), job(eps=0.0500001), job(mass_scale=1.0000001), job(Weakest), RecordedWalk(job().assembly, 7)]
wrong = [repr(each)[:300] for each in others if served(each)]
loaded = {str(getattr(module, "__file__", "")) for module in [*sys.modules.values()]}
files = sorted(path for path in opened | loaded if path.startswith(str(folder)) and "__pycache__" not in path)
files = [Path(each) for each in files if Path(each).is_file() and Path(each).stat().st_size]
own = [each for each in files if "packages" not in each.parts or "own_package" in each.parts]
rng = np.random.default_rng(1)
for path in [*own, *rng.choice([each for each in files if each not in own], int(sys.argv[2]), replace=False)]:
    data, times = path.read_bytes(), path.stat()
    changed = bytearray(data)
    changed[rng.integers(len(data))] ^= int(rng.integers(1, 256))
    path.write_bytes(changed)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    try:
        if served(job()):
            wrong.append(str(path))
    except ValueError:
        pass  # the file is refused
    path.write_bytes(data)
for name in ("numpy", "pybullet", "osqp", "casadi", "pin"):
    other = folder / "packages" / f"{name}-99.dist-info"
    other.mkdir()
    (other / "METADATA").write_text(f"Metadata-Version: 2.1\\nName: {name}\\nVersion: 99\\n")
    if served(job()):
        wrong.append(name)
    shutil.rmtree(other)
assert served(job()), "all is as it was"
print(json.dumps({"files": len(files), "own": [each.name for each in own], "served": wrong}))
"""


@pytest.mark.timeout(1800)
def test_after_a_single_change_no_old_result_is_served(tmp_path: Path) -> None:
    """Of seed, parameters, class, a library's version, or one byte of what the run read or imported."""
    packages = tmp_path / "packages"
    for name in PACKAGES:
        (source,) = find_spec(name).submodule_search_locations
        shutil.copytree(source, packages / name, ignore=shutil.ignore_patterns("__pycache__"))
    (packages / "own_package").mkdir()
    for name, text in {"__init__": "", "assembly": OWN, "late": "share = 0.95\n"}.items():
        (packages / "own_package" / f"{name}.py").write_text(text)
    shutil.copy(packages / "rabbit_description/gaits/stones_0350_084.yaml", tmp_path / "gait.yaml")
    shutil.copy(packages / "rl_cbf_clf_controller/policies/rl-cbf-clf-qp.safetensors", tmp_path)
    (tmp_path / "course.yaml").write_text("stones:\n" + "- {l_min: 0.3, l_max: 0.4}\n" * 5)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(packages), os.environ.get("PYTHONPATH", "")))}
    command = [sys.executable, "-c", PROGRAM, str(tmp_path), str(CHANGES)]
    done = subprocess.run(command, cwd=packages, env=environment, capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    assert found["files"] > 50
    assert {*found["own"]} >= {"gait.yaml", "course.yaml", "rl-cbf-clf-qp.safetensors", "assembly.py", "late.py"}
    assert found["served"] == []

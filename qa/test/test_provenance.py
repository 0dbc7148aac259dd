"""Whatever decides a run is in the key of its result: no old one is served after a change."""

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from . import provenance_changes

QUICK, MANY = 8, 120  # changes of each of three jobs
OWN = """
from dataclasses import dataclass, replace

from rabbit_experiments.assembly import Assembly
from rabbit_benchmark.methods import Method, method
from rabbit_reproduce.controllers import Contender


class Powerless(Assembly):
    def build(self):
        simulation, controller = super().build()
        step = controller.step

        def no_torque(state):
            output = step(state)
            output.torque[:] = 0
            return output

        controller.step = no_torque
        return simulation, controller


@dataclass(frozen=True)
class Own(Contender):
    def assembly(self, tuning=None, /, **plant):
        whole = super().assembly(tuning, **plant)
        return Powerless(whole.simulation, whole.controller, whole.policy)


flat = method("nominal").flat
MINE = Method("mine", "mine", flat=Own(flat.title, flat.controller, flat.colour, flat.policy, tuning=flat.tuning))
"""
COURSE = [("l_min", "l_max"), *[("0.3", "0.4")] * 3]


def run(folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
    """Python in a process of its own in `folder`, which is on its path."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", "")))}
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=3600)


def rabbit(folder: Path, *words: object) -> str:
    """The command's output."""
    done = run(folder, "-c", "from rabbit_bringup.cli import app; app()", *words)
    assert done.returncode == 0, done.stderr
    return done.stdout


def rows(path: Path) -> list[dict[str, str]]:
    """Of a table."""
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("what", ["walk", "own", "training"])
@pytest.mark.parametrize("changes", [QUICK, pytest.param(MANY, marks=[pytest.mark.slow, pytest.mark.timeout(1800)])])
def test_after_a_single_change_no_old_result_is_served(tmp_path: Path, what: str, changes: int) -> None:
    pytest.importorskip("mujoco")
    provenance_changes.make_workspace(tmp_path)
    done = run(tmp_path / "packages", provenance_changes.__file__, tmp_path, what, changes, 1)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    print(found)
    assert sum(found["made"].values()) == changes
    assert found["files"]["project code"] > 50
    assert found["served"] == []


def test_a_method_with_an_assembly_of_its_own_is_walked_itself(tmp_path: Path) -> None:
    (tmp_path / "own_method.py").write_text(OWN)
    information = tmp_path / "own_method-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: own_method\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[rabbit.methods]\nmine = own_method:MINE\n")
    words = ("--cells", "flat/scale-1", "--courses", 2, "--jobs", 1, "--out", "out")
    assert "2 runs made" in rabbit(tmp_path, "benchmark", "nominal", *words)
    assert "2 runs made" in rabbit(tmp_path, "benchmark", "nominal", "mine", *words)
    walked = {row["method"]: row["walked"] for row in rows(tmp_path / "out" / "benchmark.csv")}
    assert walked == {"nominal": "2", "mine": "0"}


def test_an_edited_course_is_walked_again_in_every_run(tmp_path: Path) -> None:
    course = tmp_path / "course.csv"
    times = None
    for far in ("0.4", "0.41"):
        with course.open("w") as file:
            csv.writer(file).writerows([*COURSE[:-1], ("0.3", far)])
        if times:
            os.utime(course, ns=(times.st_atime_ns, times.st_mtime_ns))  # as `cp -p` leaves it
        times = course.stat()
        out = rabbit(
            tmp_path, "evaluate", "--course", course, "--stones", 3, "--runs", 1 + (far == "0.41"), "--out", "o"
        )
    assert "1 results here were made with another" in out
    assert "course.csv: made again" in out
    assert "2 runs made" in out
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    assert [row["run"] for row in rows(tmp_path / "o" / "runs.csv")] == ["0", "1"]
    shutil.rmtree(tmp_path / "o" / "cache")
    assert "2 runs made" in rabbit(tmp_path, "evaluate", "--course", course, "--stones", 3, "--runs", 2, "--out", "o")
    again = json.loads((tmp_path / "o" / "summary.json").read_text())
    assert again["made_with"] == summary["made_with"]
    assert again["mean_stones"] == summary["mean_stones"]

"""Parts of someone else: plant, learner, method by entry points; what is wrong with a task is one line."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import rabbit_command
from own_cart import CART
from rabbit_benchmark.table import Table
from rabbit_description.task import TaskError
from rabbit_description.task_source import load_task
from rl_cbf_clf_controller.task_controller import TaskController
from rl_cbf_clf_controller.weights import read
from rl_trainer.task_episode import ride_of
from rl_trainer.task_training import train

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
MODULE = """
from pathlib import Path

import torch
from rabbit_sim.rigid_plant import RigidPlant
from rl_trainer.actor import Actor
from rl_trainer.learner import Learner


class SlowMotor(RigidPlant):
    def advance(self, command):
        Path("advanced").touch()
        super().advance(command)


class Noted(Learner):
    def __init__(self, parameters):
        self.acting = Actor(parameters)
        self._optimizer = torch.optim.SGD(self.acting.parameters(), lr=1e-3)
        self.updates = 0

    def update(self, batch, rate):
        alpha, beta = self.acting(batch.observation, batch.LgV)
        loss = ((torch.einsum("bij,bj->bi", alpha, batch.mu) + beta) / batch.unit - batch.target).square().mean()
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        self.updates += 1
        Path("updates").write_text(str(self.updates))
        return {"error": loss.item()}

"""
ENTRY_POINTS = """
[rabbit.plants]
slow_motor = other_package:SlowMotor
[rabbit.learners]
noted = other_package:Noted
"""
TRAINING = ("--walking-steps", "1", "--batch", "8", "--updates-least", "5", "--learner", "noted", "--out", "out")


def install(folder: Path, name: str = "other_package", entries: str = ENTRY_POINTS) -> None:
    """A package as pip leaves it, in a folder of the path."""
    (folder / f"{name}.py").write_text(MODULE)
    information = folder / f"{name}-1.0.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(entries)


def rabbit(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The command, in a process of its own in `folder`, with `folder` on the path."""
    path = os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", "")))
    return rabbit_command.rabbit(*words, cwd=folder, PYTHONPATH=path)


def test_another_packages_plant_is_walked_on(tmp_path: Path) -> None:
    install(tmp_path)
    done = rabbit(tmp_path, "evaluate", "--plant", "slow_motor", "--stones", "1", "--runs", "1", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "advanced").exists()
    about = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert about["parameters"]["simulation"]["plant"] == "slow_motor"


def test_the_template_of_a_method_enters_the_benchmark_and_gets_its_row(tmp_path: Path) -> None:
    shutil.copytree(EXAMPLES / "method", tmp_path / "copy")  # pip builds in it
    options = ["--quiet", "--no-index", "--no-deps", "--no-build-isolation", "--target", str(tmp_path)]
    subprocess.run([sys.executable, "-m", "pip", "install", *options, str(tmp_path / "copy")], check=True, timeout=300)
    walked = []
    for seeds in ("77", "77", "78"):
        out = f"out{len(walked)}"
        words = ("mine", "--cells", "flat/storm", "--courses", "1", "--seeds", seeds, "--out", out)
        done = rabbit(tmp_path, "benchmark", *words)
        assert done.returncode == 0, done.stderr
        (row,) = Table.read(tmp_path / out / "benchmark.csv").rows.values()
        assert (row.method, row.cell, row.courses) == ("mine", "flat/storm", 10)
        line = (tmp_path / out / "benchmark.md").read_text().splitlines()[-1]
        assert line.startswith(f"| nominal, eps 0.03 | {row.walked} | {row.walked} | {seeds} | PyBullet |")
        walked.append((row.by_course, row.mean_stones))
    assert walked[0] == walked[1] != walked[2]
    refused = rabbit(tmp_path, "benchmark", "mine", "--cells", "flat/scale-1", "--seeds", "secret")
    assert refused.returncode == 2
    assert "--seeds secret: expected development, reported or a number" in " ".join(refused.stderr.split())


def test_another_packages_learner_trains_and_goes_on_where_it_was(tmp_path: Path) -> None:
    install(tmp_path)
    updates = []
    for episodes in ("1", "2"):
        done = rabbit(tmp_path, "train", *TRAINING, "--updates-per-tick", "0", "--episodes", episodes)
        assert done.returncode == 0, done.stderr
        updates.append((tmp_path / "updates").read_text())
    assert updates == ["5", "10"]
    assert read(tmp_path / "out" / "policy.safetensors").metadata.learner == "noted"


def test_a_learner_that_is_not_there_is_named_and_its_folder_still_takes_another(tmp_path: Path) -> None:
    install(tmp_path, entries=f"{ENTRY_POINTS}gone = other_package:Gone\n")
    refused = rabbit(tmp_path, "train", *TRAINING, "--learner", "gone")
    said = "rabbit: rabbit.learners gone: module 'other_package' has no attribute 'Gone'\n"
    assert (refused.returncode, refused.stderr) == (2, said)
    done = rabbit(tmp_path, "train", *TRAINING, "--episodes", "1")
    assert done.returncode == 0, done.stderr


BALL = EXAMPLES / "ball_on_beam.py"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"mass": 1.0', '"mass": 1 / 0', 'line 9: ZeroDivisionError: division by zero: `nominal={"mass": 1 / 0}'),
        ("import casadi as ca", "import nosuch as ca", "line 2: ModuleNotFoundError: No module named 'nosuch'"),
        ("limit=20.0", "limt=20.0", "line 6: TypeError: "),
        ("commands=lambda rng: lambda t: {", "commands=lambda rng: lambda t: 1 / 0 or {", "line 10: ZeroDivisionError"),
        ("poles=(4.0, 4.0)", "poles=(4.0, 4.0, 4.0)", ": wall: relative degree 2, but 3 was given"),
        ("Clf(x - target)", "Clf(x - target, gains=(-1.0, 1.0))", ": gains = [-1.0, 1.0] do not stabilise"),
    ],
)
def test_an_error_in_a_task_names_file_and_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "rabbit_cart.py"  # no package of ours
    assert old in CART
    path.write_text(CART.replace(old, new))
    with pytest.raises(TaskError) as error:
        load_task(str(path))
    assert str(path) in str(error.value)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    result = rabbit_command.invoke("evaluate", "--task", path, "--rides", 1)
    assert (result.exit_code, result.output.count("\n")) == (2, 1)
    assert said.rstrip("`") in result.output


def test_a_task_may_define_a_dataclass_whose_annotations_are_text(tmp_path: Path) -> None:
    path = tmp_path / "cart.py"
    path.write_text(f"from dataclasses import dataclass\n@dataclass\nclass Cart:\n    mass: 'float' = 1.0\n{CART}")
    assert load_task(str(path)).name == "cart"


def test_a_barrier_of_degree_4_is_kept_by_the_oracle_and_nothing_is_learned_of_it() -> None:
    """A ball on a beam: the oracle meets the row of the true ball, the nominal controller that of its model."""
    task = load_task(str(BALL))
    controller = TaskController(task)
    nominal, oracle = (ride_of(controller, name, 1) for name in ("nominal", "oracle"))
    assert (nominal.outcome, oracle.outcome) == ("done", "done")
    assert nominal.margins[0] < -0.05
    assert 0 <= oracle.margins[0] < 0.005  # it comes near
    with pytest.raises(ValueError, match="one difference measures relative degrees 1 and 2 only"):
        train(task, 1)


def test_task_is_an_option_of_what_evaluates_rabbit_too(tmp_path: Path) -> None:
    tables = set()
    for way in (["--task", BALL], [f"--task={BALL}"]):
        out = tmp_path / str(len(way))
        result = rabbit_command.invoke("evaluate", *way, "--runs", 1, "--seed", 3, "--out", out)
        assert result.exit_code == 0, result.output
        tables.add((out / "runs.csv").read_text())
    assert len(tables) == 1
    missing = rabbit_command.invoke("evaluate", "--task")
    assert (missing.exit_code, "--task" in missing.output) == (2, True)

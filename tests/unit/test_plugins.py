"""Parts that someone else's package brings by entry points: plant, learner and method, used without an edit."""

import json
import os
import subprocess
import sys
from pathlib import Path

from rl_cbf_clf_controller.weights import read

MODULE = '''
"""Count the letters of a word."""

from pathlib import Path

import torch
import typer
from rabbit_benchmark.methods import Method
from rabbit_reproduce.controllers import variant
from rabbit_sim.rigid_plant import RigidPlant
from rl_trainer.actor import Actor
from rl_trainer.learner import Learner

app = typer.Typer()


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


@app.command()
def count(word: str):
    print(len(word))


STIFF = Method("stiff", "mine, stiffer", flat=variant("stiff", "clf-qp", "zero", {"eps": 0.08}))
'''
ENTRY_POINTS = """
[rabbit.plants]
slow_motor = other_package:SlowMotor
[rabbit.learners]
noted = other_package:Noted
[rabbit.methods]
stiff = other_package:STIFF
[rabbit.commands]
count = other_package:app
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
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", "")))}
    command = [sys.executable, "-c", "from rabbit_bringup.cli import app; app()", *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def test_another_packages_plant_is_walked_on(tmp_path: Path) -> None:
    install(tmp_path)
    done = rabbit(tmp_path, "evaluate", "--plant", "slow_motor", "--stones", "1", "--runs", "1", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "advanced").exists()
    about = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert about["parameters"]["simulation"]["plant"] == "slow_motor"


def test_another_packages_method_enters_the_benchmark(tmp_path: Path) -> None:
    install(tmp_path)
    done = rabbit(tmp_path, "benchmark", "stiff", "--cells", "*/scale-1", "--courses", "1", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "no controller for stones" in (tmp_path / "out" / "benchmark.csv").read_text()
    listed = rabbit(tmp_path, "benchmark", "--list")
    assert "mine, stiffer" in listed.stdout


def test_another_packages_learner_trains_and_goes_on_where_it_was(tmp_path: Path) -> None:
    install(tmp_path)
    updates = []
    for episodes in ("1", "2"):
        done = rabbit(tmp_path, "train", *TRAINING, "--updates-per-tick", "0", "--episodes", episodes)
        assert done.returncode == 0, done.stderr
        updates.append((tmp_path / "updates").read_text())
    assert updates == ["5", "10"]
    assert read(tmp_path / "out" / "policy.safetensors").metadata.learner == "noted"

"""`--retrain`: the policies that experiments walk with, trained anew in `DIR/training`; and the log of their episodes.

Each training is a job of the engine, in a folder of its own, where one that was stopped goes on:

    ROOT/NAME-KEY/   a session of `rabbit train`, KEY the hash of all that decides it

The log in the package, training_log.csv, is `DIR/training/episodes.csv` of the trainings in
studies/docs/results_paper.md.
"""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict
from rabbit_experiments import provenance
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.cache import Cache, Job, JobError
from rabbit_experiments.conditions import POLICY, TRAINING_PLANT, TRAINING_SCALE, TRAINING_SLACK_WEIGHT
from rabbit_experiments.engine import run
from rabbit_experiments.tables import read_rows, write_rows
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.scene import ControllerError
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import policy_path
from rl_trainer.parameters import TrainingParameters

from rabbit_reproduce.command_lines import changed_options

COMMITTED = Path(__file__).with_name("training_log.csv")
DIGITS = 5  # of a reward
SEEDS = (1, 2, 3)


class TrainingReport(BaseModel):
    """`episodes` has the `EpisodeReport` of each, and the `seconds` that it took."""

    commit: str
    episodes: list[dict[str, Any]]


@dataclass(frozen=True)
class TrainingJob(Job):
    """A training as `rabbit train` does it, by a controller that walks meanwhile on a plant."""

    parameters: TrainingParameters
    controller: ControllerParameters
    plant: SimulationParameters
    root: Path = field(default=Path("runs/training"), compare=False)
    model = TrainingReport

    @property
    def name(self) -> str:
        """The name of its folder, without the key."""
        return f"{self.parameters.problem}-scale-{self.plant.mass_scale:g}-seed-{self.parameters.seed}"

    @property
    def command(self) -> str:
        """That makes the same policy."""
        changes = changed_options(self.parameters, TrainingParameters())
        changes += changed_options(self.controller, training_job(self.parameters).controller)
        changes += ["--plant", self.plant.plant] if self.plant.plant != "pybullet" else []
        return shlex.join(["rabbit", "train", *changes, "--mass-scale", f"{self.plant.mass_scale:g}", "--out", "DIR"])

    @property
    def folder(self) -> Path:
        """The session's."""
        asked = provenance.plain(self)
        return self.root / f"{self.name}-{provenance.key_of([asked, provenance.provenance(asked)])}"

    def do(self) -> TrainingReport:
        from rl_trainer.checkpoint import CheckpointError  # torch
        from rl_trainer.training import DivergenceError

        try:
            episodes = self._train()
        except (CheckpointError, DivergenceError, ControllerError, np.linalg.LinAlgError) as error:
            raise JobError(f"{self.title or self.name}: {error}") from error
        return TrainingReport(commit=provenance.commit(), episodes=episodes)

    def _train(self) -> list[dict[str, Any]]:
        """Train, or go on training; the reports of all episodes."""
        from rabbit_experiments.training_setup import training  # torch

        about = self.folder, self.parameters, self.controller, self.plant, self.command
        with training(*about) as (trainer, reports):
            for _ in reports:
                pass
            trainer.policy_file().write(self.folder / POLICY)
            return [asdict(report) for report in trainer.reports]


def training_job(parameters: TrainingParameters, mass_scale: float = TRAINING_SCALE) -> TrainingJob:
    """A training with the controller's parameters `ours`, in PyBullet."""
    controller = load_parameters("ours", controller=parameters.problem.name, slack_weight=TRAINING_SLACK_WEIGHT)
    course = {"terrain": controller.terrain, "stones": parameters.walking_steps, "plant": "pybullet"}
    plant = SimulationParameters.model_validate({**TRAINING_PLANT, **course, "mass_scale": mass_scale})
    return TrainingJob(parameters, controller, plant)


class Episode(BaseModel):
    """An episode, by its number from 1. `reward`: mean over the ticks kept of all terms but the penalty, zero or less.

    `transitions` are all those kept so far; `sigma` in rad/s^2.
    """

    model_config = ConfigDict(frozen=True)

    problem: str
    mass_scale: float
    seed: int
    commit: str
    episode: int
    sigma: float
    steps: int
    ticks: int
    kept: int
    transitions: int
    reward: float


def recipe_of(problem: Problem, seed: int = SEEDS[0], mass_scale: float = TRAINING_SCALE) -> TrainingJob:
    """The training by which the shipped policies were made."""
    return training_job(TrainingParameters(problem=problem, seed=seed), mass_scale)


SHIPPED = {  # by the name of the policy that they made
    **{problem.name: recipe_of(problem) for problem in PAPER},
    f"{RL_CBF_CLF_QP}-scale-0.7": recipe_of(RL_CBF_CLF_QP, mass_scale=0.7),
}
HALF = recipe_of(RL_CBF_CLF_QP, mass_scale=0.5)  # where the paper's method fails


def recipes(quick: bool) -> list[TrainingJob]:
    """All that `--retrain` trains: the policies that are shipped, one at scale 0.5, and more seeds at scale 2."""
    more = [recipe_of(problem, seed) for seed in SEEDS[1:] for problem in PAPER]
    return [*SHIPPED.values(), HALF, *(() if quick else more)]


def that_made(policies: Iterable[str]) -> list[TrainingJob]:
    """The trainings of those among these files that are shipped."""
    wanted = set(policies)
    return [recipe for name, recipe in SHIPPED.items() if str(policy_path(name)) in wanted]


@dataclass(frozen=True)
class Trained:
    """Trainings under `root` that are done: each recipe with the training that was `made` by it."""

    root: Path
    made: dict[TrainingJob, TrainingJob]

    def own(self, assembly: Assembly) -> Assembly:
        """The same with the policy that was trained here in place of the shipped one."""
        policy = self._policies.get(assembly.policy)
        return replace(assembly, policy=str(policy)) if policy else assembly

    @cached_property
    def _policies(self) -> dict[str, Path]:
        """File by the path of the shipped policy that it stands in for."""
        return {str(policy_path(name)): self.policy(recipe) for name, recipe in SHIPPED.items() if recipe in self.made}

    def policy(self, recipe: TrainingJob, episode: int | None = None) -> Path:
        """The last policy's file, or the one after an episode."""
        folder = self.made[recipe].folder
        return folder / POLICY if episode is None else folder / "policies" / f"{episode:03d}.safetensors"

    def episodes(self) -> list[Episode]:
        """The episodes of all trainings."""
        return [row for job in self.made.values() for row in episodes_of(job, Cache(self.root / "cache"))]


def under(root: Path, wanted: Sequence[TrainingJob], engine: str = "pybullet") -> Trained:
    """The trainings of these recipes under `root`, on the plant of this engine."""
    made = {}
    for recipe in wanted:
        plant = recipe.plant.model_copy(update={"plant": engine})
        made[recipe] = replace(recipe, plant=plant, root=root, title=recipe.name)
    return Trained(root, made)


def episodes_of(recipe: TrainingJob, cache: Cache) -> list[Episode]:
    """The episodes of a training that is done."""
    report, problem, transitions = cache.get(recipe), recipe.parameters.problem, 0
    about = {"problem": problem.name, "mass_scale": recipe.plant.mass_scale, "seed": recipe.parameters.seed}
    rows = []
    for number, episode in enumerate(report.episodes, start=1):
        transitions += episode["kept"]
        reward = round(sum(episode["reward"][name] for name in problem.quantities), DIGITS)
        counted = {"episode": number, "transitions": transitions, "reward": reward, "commit": report.commit}
        rows.append(Episode.model_validate({**episode, **about, **counted}))
    return rows


def retrain(wanted: Sequence[TrainingJob], root: Path, processes: int | str, engine: str = "pybullet") -> Trained:
    """Train what is not there yet, over processes or a cluster whose machines share `root`.

    Raises `JobError` where one cannot go on, or wrote elsewhere.
    """
    trained = under(root.absolute(), wanted, engine)
    run([*trained.made.values()], Cache(root / "cache"), processes)
    if missing := [trained.policy(recipe) for recipe in wanted if not trained.policy(recipe).is_file()]:
        raise JobError(f"{missing[0]}: is not there: expected workers that share the folder {root}")
    write_rows(root / "episodes.csv", Episode, trained.episodes())
    return trained


def read_log(path: Path = COMMITTED) -> list[Episode]:
    """The episodes in a log."""
    return read_rows(path, Episode)

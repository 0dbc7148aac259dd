"""`--retrain`: the policies that experiments walk with, trained anew in `DIR/training`; and the log of their episodes.

The log in the package, training_log.csv, is `DIR/training/episodes.csv` of the trainings in
studies/docs/results_paper.md.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from pydantic import BaseModel, ConfigDict
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.cache import Cache
from rabbit_experiments.conditions import TRAINING_SCALE
from rabbit_experiments.engine import run
from rabbit_experiments.tables import read_rows, write_rows
from rabbit_experiments.training_setup import POLICY
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import policy_path
from rl_trainer.parameters import TrainingParameters

from rabbit_reproduce.setting import OURS, Setting
from rabbit_reproduce.training_jobs import TrainingJob

COMMITTED = Path(__file__).with_name("training_log.csv")
DIGITS = 5  # of a reward
SEEDS = (1, 2, 3)


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
    """As the shipped policies were trained."""
    return TrainingJob(TrainingParameters(problem=problem, seed=seed), mass_scale)


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
    """Trainings under `root` that are done, in a setting."""

    root: Path
    recipes: tuple[TrainingJob, ...]
    setting: Setting = OURS

    def own(self, assembly: Assembly) -> Assembly:
        """The same with the policy that was trained here in place of the shipped one."""
        policy = self._policies.get(assembly.policy)
        return replace(assembly, policy=str(policy)) if policy else assembly

    @property
    def jobs(self) -> list[TrainingJob]:
        """The trainings themselves."""
        return [self._made(recipe) for recipe in self.recipes]

    @cached_property
    def _policies(self) -> dict[str, Path]:
        """File by the path of the shipped policy that it stands in for."""
        return {str(policy_path(name)): self.policy(made) for name, made in SHIPPED.items() if made in self.recipes}

    def policy(self, recipe: TrainingJob, episode: int | None = None) -> Path:
        """The last policy's file, or the one after an episode."""
        folder = self._made(recipe).folder
        return folder / POLICY if episode is None else folder / "policies" / f"{episode:03d}.safetensors"

    def episodes(self) -> list[Episode]:
        """Of all trainings."""
        return [row for recipe in self.jobs for row in episodes_of(recipe, Cache(self.root / "cache"))]

    def _made(self, recipe: TrainingJob) -> TrainingJob:
        """The training itself."""
        return replace(self.setting.recipe(recipe), root=self.root, title=recipe.name)


def episodes_of(recipe: TrainingJob, cache: Cache) -> list[Episode]:
    """The episodes of a training that is done."""
    report, problem, transitions = cache.get(recipe), recipe.parameters.problem, 0
    about = {"problem": problem.name, "mass_scale": recipe.mass_scale, "seed": recipe.parameters.seed}
    rows = []
    for number, episode in enumerate(report.episodes, start=1):
        transitions += episode["kept"]
        reward = round(sum(episode["reward"][name] for name in problem.quantities), DIGITS)
        counted = {"episode": number, "transitions": transitions, "reward": reward, "commit": report.commit}
        rows.append(Episode.model_validate({**episode, **about, **counted}))
    return rows


def retrain(wanted: Sequence[TrainingJob], root: Path, processes: int, setting: Setting = OURS) -> Trained:
    """Train what is not there yet, over processes of this machine; raises `JobError` where one cannot go on."""
    trained = Trained(root, tuple(wanted), setting)
    run(trained.jobs, Cache(root / "cache"), processes)
    write_rows(root / "episodes.csv", Episode, trained.episodes())
    return trained


def read_log(path: Path = COMMITTED) -> list[Episode]:
    """The episodes in a log."""
    return read_rows(path, Episode)

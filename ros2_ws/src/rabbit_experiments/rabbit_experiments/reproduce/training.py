"""`--retrain`: the policies that experiments walk with, trained anew in `rabbit reproduce`'s folder.

DIR/training/NAME-KEY/     a session of `rabbit train`, KEY the content that decides it
DIR/training/episodes.csv  all their episodes

A stopped training goes on at the episode it was in; one that is done is not made again, until its code, parameters,
gait or libraries change.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from cbf_clf_qp.problem import Problem
from rabbit_description.gait import load_gait
from rabbit_description.plugins import modules
from rabbit_sim.parameters import PLANTS, SimulationParameters
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import policy_path
from rl_trainer.parameters import LEARNERS, TrainingParameters

from rabbit_experiments import provenance
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.conditions import TRAINING_SCALE, TRAINING_SLACK_WEIGHT
from rabbit_experiments.parallel import in_processes
from rabbit_experiments.reproduce.source_files import sources_hash
from rabbit_experiments.reproduce.training_log import Episode, read_session, write_log

SOURCES = ("rabbit_experiments.training_setup", *modules(PLANTS), *modules(LEARNERS))
POLICY = "policy.safetensors"
COLUMNS = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))


@dataclass(frozen=True)
class Recipe:
    """A training as `rabbit train` does it with these options."""

    problem: Problem
    seed: int = 1
    mass_scale: float = TRAINING_SCALE
    episodes: int = TrainingParameters().episodes

    @property
    def name(self) -> str:
        """Of its folder, without the key."""
        return f"{self.problem.name}-scale-{self.mass_scale:g}-seed-{self.seed}"

    @property
    def command(self) -> str:
        """That makes the same policy."""
        options = f"--problem {self.problem.name} --seed {self.seed} --mass-scale {self.mass_scale:g}"
        return f"rabbit train {options} --episodes {self.episodes} --out DIR"

    @property
    def parameters(self) -> TrainingParameters:
        """Of the learner."""
        return TrainingParameters(problem=self.problem, seed=self.seed, episodes=self.episodes)

    @property
    def controller(self) -> ControllerParameters:
        """That walks while it learns."""
        return load_parameters("ours", controller=self.problem.name, slack_weight=TRAINING_SLACK_WEIGHT)

    @property
    def plant(self) -> SimulationParameters:
        """That it walks on."""
        terrain = self.controller.terrain
        steps = self.parameters.walking_steps
        return SimulationParameters(mass_scale=self.mass_scale, terrain=terrain, stones=steps, stop_at_miss=False)

    def folder(self, root: Path) -> Path:
        """The session's."""
        decides = {
            "parameters": self.parameters.model_dump(mode="json"),
            "controller": self.controller.model_dump(mode="json"),
            "plant": self.plant.model_dump(mode="json"),
            "gait": load_gait(self.controller.gait).model_dump(mode="json", exclude={"metadata"}),
            "code": sources_hash(*SOURCES),
            "versions": provenance.versions(),
        }
        return root / f"{self.name}-{provenance.content_key(decides)}"

    def train(self, root: Path) -> None:
        """Train, or go on training; raises what `training` raises."""
        from rabbit_experiments.training_setup import training  # torch

        folder = self.folder(root)
        if (folder / POLICY).is_file():
            return
        with training(folder, self.parameters, self.controller, self.plant, self.command) as job:
            for _ in job.reports:
                pass
            job.session.trainer.policy_file().write(folder / POLICY)


SHIPPED = {  # by the name of the policy that they made
    **{problem.name: Recipe(problem) for problem in PAPER},
    f"{RL_CBF_CLF_QP}-scale-0.7": Recipe(RL_CBF_CLF_QP, mass_scale=0.7),
}
HALF = Recipe(RL_CBF_CLF_QP, mass_scale=0.5)  # where the paper's method fails
SEEDS = (1, 2, 3)


def recipes(quick: bool) -> list[Recipe]:
    """All that `--retrain` trains: the policies that are shipped, one at scale 0.5, and more seeds at scale 2."""
    more = [replace(SHIPPED[problem.name], seed=seed) for seed in SEEDS[1:] for problem in PAPER]
    return [*SHIPPED.values(), HALF, *(() if quick else more)]


def that_made(policies: Iterable[str]) -> list[Recipe]:
    """The trainings of those among these files that are shipped."""
    wanted = set(policies)
    return [recipe for name, recipe in SHIPPED.items() if str(policy_path(name)) in wanted]


@dataclass(frozen=True)
class Trained:
    """Trainings under `root` that are done."""

    root: Path
    recipes: tuple[Recipe, ...]

    def own(self, assembly: Assembly) -> Assembly:
        """The same with the policy that was trained here in place of the shipped one."""
        policy = self._policies.get(assembly.policy)
        return replace(assembly, policy=str(policy)) if policy else assembly

    @cached_property
    def _policies(self) -> dict[str, Path]:
        """File by the path of the shipped policy that it stands in for."""
        return {str(policy_path(name)): self.policy(made) for name, made in SHIPPED.items() if made in self.recipes}

    def policy(self, recipe: Recipe, episode: int | None = None) -> Path:
        """The last policy's file, or the one after an episode."""
        folder = recipe.folder(self.root)
        return folder / POLICY if episode is None else folder / "policies" / f"{episode:03d}.safetensors"

    def episodes(self) -> list[Episode]:
        """Of all trainings."""
        return [row for recipe in self.recipes for row in read_session(recipe.folder(self.root))]


def retrain(wanted: Sequence[Recipe], root: Path, jobs: int) -> Trained:
    """Train what is not there yet, over processes of this machine, with a bar.

    Raises:
        CheckpointError: a session's checkpoint is damaged.
    """
    left = [recipe for recipe in wanted if not (recipe.folder(root) / POLICY).is_file()]
    with Progress(*COLUMNS) as progress:
        task = progress.add_task("training", total=len(wanted), completed=len(wanted) - len(left))
        for recipe in in_processes(_train, [(recipe, root) for recipe in left], jobs):
            progress.update(task, advance=1, description=recipe.name)
    trained = Trained(root, tuple(wanted))
    write_log(trained.episodes(), root / "episodes.csv")
    return trained


def _train(recipe: Recipe, root: Path) -> Recipe:
    recipe.train(root)
    return recipe

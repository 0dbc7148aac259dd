"""What each choice of the learning is worth: variants of the training over seeds, judged on the same courses.

python -m rabbit_reproduce.ablations [VARIANT ...] --out DIR \\
    --seeds 1 --seeds 2 --seeds 3 --runs 20 --seed 40001 --jobs 2

A variant trains as `rabbit train` does; its last policy walks courses of 20 stones at scale 2 with motor lag, the same
courses for all. `--list` names the variants. A study that was stopped goes on with the same command.

DIR/ablations.csv      a row a variant and training seed
DIR/ablations.md       a line a variant
DIR/training/          the training sessions
DIR/cache/             the trainings and walks that are done

Reward terms are in a variant's own units; those of another norm, error unit or choice of ticks do not compare. Wilson's
interval takes the courses of all seeds for independent.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import BaseModel, ConfigDict
from rabbit_common.own_folder import own_folder
from rabbit_description.atomic_file import replace_text
from rabbit_description.yaml_file import read_mapping
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.cache import Cache, JobError
from rabbit_experiments.conditions import EVALUATION_LAG, TRAINING_SCALE
from rabbit_experiments.engine import run
from rabbit_experiments.evaluation import Scenario
from rabbit_experiments.summary import Walks, wilson
from rabbit_experiments.tables import markdown_table, write_rows
from rabbit_experiments.training_setup import POLICY
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_trainer.parameters import TrainingParameters, paper_literal
from rl_trainer.training import LearnerType

from rabbit_reproduce import ablated_learners
from rabbit_reproduce.training_jobs import TrainingJob, TrainingReport

MOST_EPISODES = 600  # of a variant that trains until it has as many: walks that fail at once give 10 to 16 each
NEWEST = 5  # episodes whose reward terms a row has
ROWS, TABLE = "ablations.csv", "ablations.md"


@dataclass(frozen=True)
class Variant:
    """`changes` to the training parameters, from those that work or the paper's; trains until it has `transitions`.

    `learner` is in place of the one that they name. Without `transitions` the number of episodes alone ends it.
    `against` is the variant to compare it with.
    """

    meaning: str
    changes: dict[str, Any] = field(default_factory=dict)
    against: str = "default"
    transitions: float = math.inf
    literal: bool = False
    learner: LearnerType | None = None

    def parameters(self, seed: int, episodes: int | None = None) -> TrainingParameters:
        """Of a training, `episodes` in place of its own number."""
        changes = {"seed": seed, **self.changes}
        if self.transitions < math.inf:
            changes["episodes"] = MOST_EPISODES
        if episodes:
            changes["episodes"] = episodes
        return (
            paper_literal(RL_CBF_CLF_QP, **changes)
            if self.literal
            else TrainingParameters(problem=RL_CBF_CLF_QP, **changes)
        )


def _variants() -> dict[str, Variant]:
    """What ablations.yaml says."""
    told = read_mapping(Path(__file__).with_name("ablations.yaml"))
    for each in told.values():
        each["changes"] = {k: tuple(v) if isinstance(v, list) else v for k, v in each.get("changes", {}).items()}
        each["learner"] = getattr(ablated_learners, each["learner"]) if "learner" in each else None
    return {name: Variant(**each) for name, each in told.items()}


VARIANTS = _variants()


class Row(BaseModel):
    """A row of ablations.csv: ticks of the courses walked, reward terms of the last episodes of the training."""

    model_config = ConfigDict(frozen=True)

    variant: str
    training_seed: int
    transitions: int
    episodes: int
    training_seconds: float
    walked: int
    runs: int
    mean_stones: float
    falls: str
    ticks_over_cone: int
    ticks: int
    reward_V: float
    reward_B1: float
    reward_B2: float
    reward_C1: float
    reward_C2: float


@dataclass(frozen=True)
class Study:
    """What all rows have in common; `episodes` in place of every variant's own number."""

    out: Path
    runs: int = 20
    seed: int = 40001
    episodes: int | None = None

    @property
    def cache(self) -> Cache:
        """What is done."""
        return Cache(self.out / "cache")

    def recipe(self, name: str, seed: int) -> TrainingJob:
        """The training of a row."""
        variant = VARIANTS[name]
        parameters, root = variant.parameters(seed, self.episodes), self.out / "training"
        title = f"{name}, seed {seed}"
        return TrainingJob(parameters, transitions=variant.transitions, root=root, title=title, learner=variant.learner)

    def scenario(self, recipe: TrainingJob) -> Scenario:
        """The courses that the policy of a training that is done is judged on."""
        simulation = SimulationParameters(mass_scale=TRAINING_SCALE, motor_lag=EVALUATION_LAG)
        controller = load_parameters("ours", controller=RL_CBF_CLF_QP.name)
        assembly = Assembly(simulation, controller, str(recipe.folder / POLICY))
        return Scenario(assembly, self.runs, self.seed, recipe.title)

    def follow(self, wanted: Sequence[tuple[str, int]], processes: int) -> bool:
        """Train and walk what is left, and write the rows that are whole; whether all are."""
        recipes, cache = [self.recipe(*each) for each in wanted], self.cache
        try:
            with suppress(JobError):  # printed by the engine; the others can still be done
                run(recipes, cache, processes)
            trained = [recipe for recipe in recipes if cache.get(recipe)]
            run([job for recipe in trained for job in self.scenario(recipe).walks], cache, processes)
        finally:
            rows = [self.row(name, recipe, cache) for (name, _), recipe in zip(wanted, recipes, strict=True)]
            self.write([row for row in rows if row])
        return None not in rows

    def row(self, name: str, recipe: TrainingJob, cache: Cache) -> Row | None:
        """A row, once its training and all of its walks are done."""
        report = cache.get(recipe)
        results = [cache.get(job) for job in self.scenario(recipe).walks] if report else [None]
        if None in results:
            return None
        walks = Walks([result.row for result in results if result])
        return Row(
            variant=name,
            training_seed=recipe.parameters.seed,
            transitions=report.transitions,
            episodes=len(report.episodes),
            training_seconds=round(sum(episode["seconds"] for episode in report.episodes), 1),
            walked=walks.walked,
            runs=walks.runs,
            mean_stones=walks.mean_stones,
            falls="; ".join(f"{kind} {count}" for kind, count in sorted(walks.falls.items())),
            ticks_over_cone=walks.total("ticks_over_cone"),
            ticks=walks.total("ticks"),
            **{f"reward_{name}": mean_reward(report, name) for name in RL_CBF_CLF_QP.quantities},
        )

    def write(self, rows: Sequence[Row]) -> None:
        """Both tables, in the order of `VARIANTS`."""
        ordered = sorted(rows, key=lambda each: (list(VARIANTS).index(each.variant), each.training_seed))
        self.out.mkdir(parents=True, exist_ok=True)
        write_rows(self.out / ROWS, Row, ordered)
        replace_text(self.out / TABLE, markdown(ordered))


def mean_reward(report: TrainingReport, quantity: str) -> float:
    """A term of the reward over all transitions kept in the newest episodes."""
    episodes = report.episodes[-NEWEST:]
    kept = sum(episode["kept"] for episode in episodes)
    total = sum(episode["reward"][quantity] * episode["kept"] for episode in episodes)
    return float(total / kept) if kept else math.nan


def markdown(rows: Sequence[Row]) -> str:
    """The table: a line a variant, figures of single seeds in the order of the seeds."""
    heads = ("variant", "what changed", "against", "walked, 95% interval", "by seed", "mean stones", "transitions")
    lines = []
    for name, variant in VARIANTS.items():
        own = [row for row in rows if row.variant == name]
        if not own:
            continue
        walked, runs = sum(row.walked for row in own), sum(row.runs for row in own)
        low, high = wilson(walked, runs)
        cells = (
            f"`{name}`",
            variant.meaning,
            f"`{variant.against}`" if variant.against else "",
            f"{walked} of {runs}, {low:.2f} to {high:.2f}",
            " / ".join(str(row.walked) for row in own),
            f"{sum(row.mean_stones * row.runs for row in own) / runs:.1f}",
            " / ".join(str(row.transitions) for row in own),
        )
        lines.append(cells)
    return markdown_table(heads, lines)


def main(
    variants: Annotated[list[str] | None, typer.Argument(help="variants by name (default: all)")] = None,
    out: Annotated[Path, typer.Option(help="folder of the study; one that was stopped there goes on")] = Path(
        "runs/ablations"
    ),
    seeds: Annotated[list[int], typer.Option(min=0, help="seeds of the trainings, one each")] = [1, 2, 3],  # noqa: B006
    runs: Annotated[int, typer.Option(min=1, help="courses of 20 stones for each policy")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="seed of courses and first states")] = 40001,
    jobs: Annotated[int, typer.Option(min=1, help="processes")] = 1,
    episodes: Annotated[
        int | None, typer.Option(min=1, help="episodes of each training (default: every variant's own number)")
    ] = None,
    show: Annotated[bool, typer.Option("--list", help="the variants, and nothing more")] = False,
) -> None:
    """Train variants of the learner and judge them on the same courses."""
    if show:
        for name, variant in VARIANTS.items():
            print(f"{name:20s} {variant.meaning}" + f" (against {variant.against})" * bool(variant.against))
        return
    names = variants or list(VARIANTS)
    if unknown := [name for name in names if name not in VARIANTS]:
        typer.echo(f"{unknown[0]}: no such variant; --list names them", err=True)
        raise typer.Exit(2)
    own_folder(out, "ablations")
    wanted = [(name, each) for each in dict.fromkeys(seeds) for name in dict.fromkeys(names)]
    try:
        complete = Study(out, runs, seed, episodes).follow(wanted, jobs)
    except KeyboardInterrupt as stop:
        typer.echo("stopped; the same command goes on from the last whole episodes", err=True)
        raise typer.Exit(130) from stop
    print(f"written {out}")
    if not complete:
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)

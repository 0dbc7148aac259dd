"""What each choice of the learning is worth: variants of the training over seeds, judged on the same courses.

python -m rabbit_experiments.ablations [VARIANT ...] --out DIR \\
    --seeds 1 --seeds 2 --seeds 3 --runs 20 --seed 40001 --jobs 2

A variant trains as `rabbit train` does; its last policy walks courses of 20 stones at scale 2 with motor lag, the same
courses for all. `--list` names the variants. A study that was stopped goes on with the same command.

DIR/ablations.json    what all rows have in common, with its key; written first
DIR/ablations.csv     a row a variant and training seed, as it is done
DIR/ablations.md      a line a variant
DIR/VARIANT/SEED/     the training session; episodes.jsonl has a report an episode

Reward terms are in a variant's own units; those of another norm, error unit or choice of ticks do not compare. Wilson's
interval takes the courses of all seeds for independent.
"""

import csv
import io
import json
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import rl_trainer
import typer
from pydantic import BaseModel, ConfigDict
from rabbit_description.atomic_file import replacing
from rabbit_sim.parameters import SimulationParameters
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.scene import ControllerError
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import PolicyFileError
from rl_trainer.parameters import TrainingParameters, paper_literal
from rl_trainer.session import CheckpointError
from rl_trainer.training import Trainer

from rabbit_experiments import provenance
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.conditions import EVALUATION_LAG, TRAINING_SCALE, TRAINING_SLACK_WEIGHT
from rabbit_experiments.evaluation import episode_seeds, evaluate
from rabbit_experiments.markdown import markdown_table
from rabbit_experiments.parallel import in_processes
from rabbit_experiments.summary import falls, wilson
from rabbit_experiments.training_setup import training

TRANSITIONS = 6500  # what `default` collects in its 18 episodes: 5,900 to 7,200
MOST_EPISODES = 600  # of a variant that trains until it has as many: walks that fail at once give 10 to 16 each
NEWEST = 5  # episodes whose reward terms a row has
ABOUT, ROWS, TABLE, EPISODES = "ablations.json", "ablations.csv", "ablations.md", "episodes.jsonl"


class StudyError(RuntimeError):
    """A folder whose rows are of another study, or cannot be read."""


@dataclass(frozen=True)
class Variant:
    """`changes` to the training parameters, from those that work or the paper's; trains until it has `transitions`.

    Without `transitions` the number of episodes alone ends it. `against` is the variant to compare it with.
    """

    meaning: str
    changes: dict[str, Any] = field(default_factory=dict)
    against: str = "default"
    transitions: float = math.inf
    literal: bool = False

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


def _critic(meaning: str, against: str, **changes: Any) -> Variant:
    """A plain critic: its walks end soon, so it has the default's transitions and updates a tick, not its episodes."""
    return Variant(meaning, {"critic": "plain", "updates_least": 0, **changes}, against, TRANSITIONS)


_UNLABELLED = {"relabel": False}
VARIANTS = {
    "default": Variant("the parameters that work", against=""),
    "plain-critic": _critic("a network for each quantity's Q in place of the reward's form", "default"),
    "no-relabel": _critic("plain critic, learns from the actions taken only", "plain-critic", **_UNLABELLED),
    "gamma-0.9": _critic("discount 0.9", "no-relabel", **_UNLABELLED, discount=0.9),
    "gamma-0.99": _critic("discount 0.99, no penalty", "no-relabel", **_UNLABELLED, discount=0.99),
    "penalty": _critic(
        "discount 0.99, penalty 10 for a failure", "gamma-0.99", **_UNLABELLED, discount=0.99, failure_penalty=10.0
    ),
    "one-head": _critic("one Q for the sum of all terms", "no-relabel", **_UNLABELLED, heads="one"),
    "absolute-error": Variant("absolute errors in the reward, not squared", {"error_norm": "absolute"}),
    "separate-networks": Variant(
        "a network for each quantity (Remark 1), 300-225 so that a policy file holds them",
        {"shared": False, "hidden1": 300, "hidden2": 225},
    ),
    "no-l-min": Variant("the stone ahead is not observed (contribution 3)", {"observe_l_min": False}),
    "plain-clf": Variant("CLF outputs of their own, not a matrix contracted with LgV", {"structured": False}),
    "varying-alpha": Variant("alpha free to vary with the state", {"alpha_decay": 0.0}),
    "not-affine": Variant("the critic does not know that errors are affine in mu", {"affine": False}),
    "V-difference": Variant("V-dot from V's own difference", {"clf_difference": "value"}),
    "nominal-at-start": Variant("nominal values of a tick's start, not its mean", {"nominal_value": "start"}),
    "absolute-clf": Variant("V-dot's error not in units of abs(LgV) + 1", {"relative_clf": False}),
    "every-tick": Variant("no measured tick is left out", {"leave_out": ()}),
    "latest-weights": Variant("the actor walks, not its average", {"act_with_average": False}),
    "one-sigma": Variant("the same exploration in all episodes", {"sigma_factors": (1.0,)}),
    "no-nominal-episodes": Variant("on-policy from the first episode", {"nominal_episodes": 0}),
    "regression": Variant("regression in place of DDPG", {"learner": "regression"}),
    "paper-literal": Variant("DDPG as the paper states it", literal=True),
    "paper-literal-long": Variant("60 episodes", {"episodes": 60}, "paper-literal", literal=True),
    "paper-literal-equal": Variant("as many transitions as the default", {}, "default", TRANSITIONS, literal=True),
}


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
    def controller(self) -> ControllerParameters:
        """Of the training, as `rabbit train` has it."""
        return load_parameters("ours", controller=RL_CBF_CLF_QP.name, slack_weight=TRAINING_SLACK_WEIGHT)

    @property
    def plant(self) -> SimulationParameters:
        """Of the training, as `rabbit train` has it."""
        steps = TrainingParameters().walking_steps
        return SimulationParameters(mass_scale=TRAINING_SCALE, stones=steps, stop_at_miss=False)

    def assembly(self, policy: str) -> Assembly:
        """Of the courses that policies are judged on."""
        simulation = SimulationParameters(mass_scale=TRAINING_SCALE, motor_lag=EVALUATION_LAG)
        return Assembly(simulation, load_parameters("ours", controller=RL_CBF_CLF_QP.name), policy)

    def about(self) -> dict[str, Any]:
        """What decides every row, where it comes from, and the key that tells studies apart."""
        decides = {
            "runs": self.runs,
            "seed": self.seed,
            "episodes": self.episodes,
            "training": {"controller": self.controller.model_dump(mode="json"), "plant": self.plant.model_dump()},
            "judged": self.assembly("zero").identity(),
            "code": provenance.code_hash((*provenance.PACKAGES, rl_trainer)),
            "versions": provenance.versions(),
        }
        return {"key": provenance.content_key(decides), "commit": provenance.commit(), **decides}

    def row(self, name: str, seed: int) -> Row:
        """Train, or go on training, and walk with the last policy; raises what `training` and a walk raise."""
        trainer, episodes = self._train(name, seed)
        policy = self._folder(name, seed) / "policies" / f"{trainer.episode:03d}.safetensors"
        walks = [walk.row for walk in evaluate(self.assembly(str(policy)), episode_seeds(self.seed, self.runs))]
        return Row(
            variant=name,
            training_seed=seed,
            transitions=trainer.transitions,
            episodes=trainer.episode,
            training_seconds=round(sum(episode["seconds"] for episode in episodes), 1),
            walked=sum(walk.success for walk in walks),
            runs=self.runs,
            mean_stones=float(np.mean([walk.stones for walk in walks])),
            falls="; ".join(f"{kind} {count}" for kind, count in sorted(falls(walks).items())),
            ticks_over_cone=sum(walk.ticks_over_cone for walk in walks),
            ticks=sum(walk.ticks for walk in walks),
            **{
                f"reward_{quantity}": mean_reward(episodes[-NEWEST:], quantity) for quantity in RL_CBF_CLF_QP.quantities
            },
        )

    def _folder(self, name: str, seed: int) -> Path:
        return self.out / name / str(seed)

    def _train(self, name: str, seed: int) -> tuple[Trainer, list[dict[str, Any]]]:
        """The trainer when it is done, and the report and seconds of each episode."""
        variant, folder = VARIANTS[name], self._folder(name, seed)
        parameters = variant.parameters(seed, self.episodes)
        with training(folder, parameters, self.controller, self.plant) as job, (folder / EPISODES).open("a+") as log:
            trainer = job.session.trainer
            while trainer.episode < parameters.episodes and trainer.transitions < variant.transitions:
                start = time.perf_counter()
                report = next(job.reports)
                log.write(json.dumps({**asdict(report), "seconds": time.perf_counter() - start}) + "\n")
                log.flush()
            log.seek(0)
            return trainer, [json.loads(line) for line in log]


def mean_reward(episodes: Sequence[dict[str, Any]], quantity: str) -> float:
    """A term of the reward over all transitions kept of some episodes' reports."""
    kept = sum(episode["kept"] for episode in episodes)
    total = sum(episode["reward"][quantity] * episode["kept"] for episode in episodes)
    return float(total / kept) if kept else math.nan


class Rows:
    """The rows of a folder, by variant and training seed; a stopped study finds its own again."""

    def __init__(self, study: Study) -> None:
        """Raises `StudyError` where the folder holds another study's rows, or what cannot be read."""
        self._out, about = study.out, study.about()
        self.done: dict[tuple[str, int], Row] = {}
        study.out.mkdir(parents=True, exist_ok=True)
        try:
            if (study.out / ABOUT).exists() and json.loads((study.out / ABOUT).read_text())["key"] != about["key"]:
                raise StudyError(f"{study.out}: holds another study (other parameters, seed, runs, code or versions)")
            if (study.out / ROWS).exists():
                with (study.out / ROWS).open(newline="") as file:
                    rows = [Row.model_validate(row) for row in csv.DictReader(file)]
                self.done = {(row.variant, row.training_seed): row for row in rows}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StudyError(f"{study.out}: cannot be read: {error}") from error
        self._write(ABOUT, json.dumps(about, indent=2))

    def add(self, row: Row) -> None:
        """Keep a row, and write the table anew."""
        self.done[row.variant, row.training_seed] = row
        rows = sorted(self.done.values(), key=lambda each: (list(VARIANTS).index(each.variant), each.training_seed))
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, fieldnames=list(Row.model_fields))
        writer.writeheader()
        writer.writerows(each.model_dump() for each in rows)
        self._write(ROWS, text.getvalue())
        self._write(TABLE, markdown(rows))

    def _write(self, name: str, text: str) -> None:
        with replacing(self._out / name) as path:
            path.write_text(text, encoding="utf-8", newline="")


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


Done = tuple[str, int, Row | str]  # variant, training seed, and its row or why there is none


def study_rows(study: Study, left: Sequence[tuple[str, int]], jobs: int) -> Iterator[Done]:
    """Rows in any order, as they are done."""
    return in_processes(_done, [(study, *each) for each in left], jobs)


def _done(study: Study, name: str, seed: int) -> Done:
    try:
        return name, seed, study.row(name, seed)
    except (CheckpointError, ControllerError, PolicyFileError, np.linalg.LinAlgError) as error:
        return name, seed, f"no row: {error}"  # the others can still be done


def follow(study: Study, wanted: Sequence[tuple[str, int]], jobs: int) -> bool:
    """Do what is left of the study, with a bar over its trainings; whether every row is there."""
    rows = Rows(study)
    left = [each for each in wanted if each not in rows.done]
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns) as progress:
        task = progress.add_task("training", total=len(wanted), completed=len(wanted) - len(left))
        for name, seed, row in study_rows(study, left, jobs):
            if isinstance(row, Row):
                rows.add(row)
            progress.update(task, advance=1)
            progress.console.print(f"{name}, seed {seed}: {row_text(row)}", highlight=False, soft_wrap=True)
    return all(each in rows.done for each in wanted)


def row_text(row: Row | str) -> str:
    """A row in a line."""
    if isinstance(row, str):
        return row
    seconds = f"{row.training_seconds:.0f} s of training"
    return f"{row.walked} of {row.runs} courses, {row.transitions} transitions, {seconds}"


def main(
    variants: Annotated[list[str] | None, typer.Argument(help="by name; all of them")] = None,
    out: Annotated[Path, typer.Option(help="folder of the study; one that was stopped there goes on")] = Path(
        "runs/ablations"
    ),
    seeds: Annotated[list[int], typer.Option(min=0, help="of the trainings, once for each")] = [1, 2, 3],  # noqa: B006
    runs: Annotated[int, typer.Option(min=1, help="courses of 20 stones for each policy")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="of courses and first states")] = 40001,
    jobs: Annotated[int, typer.Option(min=1, help="processes")] = 1,
    episodes: Annotated[int | None, typer.Option(min=1, help="in place of every variant's own number")] = None,
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
    wanted = [(name, each) for each in dict.fromkeys(seeds) for name in dict.fromkeys(names)]
    try:
        complete = follow(Study(out, runs, seed, episodes), wanted, jobs)
    except StudyError as error:
        typer.echo(error, err=True)
        raise typer.Exit(2) from error
    except KeyboardInterrupt as stop:
        typer.echo("stopped; the same command goes on from the last whole episodes", err=True)
        raise typer.Exit(130) from stop
    print(f"written {out}")
    if not complete:
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)

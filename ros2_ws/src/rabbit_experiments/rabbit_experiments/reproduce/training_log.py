"""What became of each episode of training sessions, as one small CSV file; learning curves are drawn from it.

python -m rabbit_experiments.reproduce.training_log SESSION ... --out FILE

A session is a folder of `rabbit train`: its TensorBoard scalars have the episodes, its newest policy says what was
trained. The file in the package, training_log.csv, was made so from the sessions that docs/results.md reports.
"""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import BaseModel, ConfigDict, ValidationError
from rl_cbf_clf_controller.weights import PolicyFileError, read

COMMITTED = Path(__file__).with_name("training_log.csv")
DIGITS = 5  # of a reward; TensorBoard keeps 7


class LogError(ValueError):
    """A folder or file that holds no training log: names it, and says what was expected."""


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


def read_session(folder: Path) -> list[Episode]:
    """The episodes of a session; a killed and resumed one has each once.

    Raises:
        LogError: no session, or one without a whole episode.
    """
    policies = sorted((folder / "policies").glob("*.safetensors"))
    if not policies or not (folder / "tensorboard").is_dir():
        raise LogError(f"{folder}: expected a folder of `rabbit train` with an episode done")
    try:
        about = read(policies[-1]).metadata
    except PolicyFileError as error:
        raise LogError(str(error)) from error
    scalars = _scalars(folder / "tensorboard")
    rewards = [scalars[f"reward/{name}"] for name in about.names]
    counts = {name: scalars[f"episode/{name}"] for name in ("sigma", "steps", "ticks", "kept")}
    found: list[Episode] = []
    for i, step in enumerate(sorted(counts["steps"])):
        values = {name: series[step] for name, series in counts.items()}
        kept = int(values["kept"])
        found.append(
            Episode(
                problem=about.problem,
                mass_scale=float(about.plant["mass_scale"]),
                seed=about.training_seed,
                commit=about.commit,
                episode=i + 1,
                transitions=kept + (found[-1].transitions if found else 0),
                reward=round(sum(series[step] for series in rewards), DIGITS),
                **values,
            )
        )
    return found


def _scalars(folder: Path) -> dict[str, dict[int, float]]:
    """Value by step of every scalar of a TensorBoard folder."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator  # a second, for this alone

    log = EventAccumulator(str(folder), size_guidance={"scalars": 0})
    log.Reload()
    return {name: {event.step: event.value for event in log.Scalars(name)} for name in log.Tags()["scalars"]}


def write_log(rows: Sequence[Episode], path: Path) -> None:
    """Write a log."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(Episode.model_fields), lineterminator="\n")
        writer.writeheader()
        writer.writerows(row.model_dump() for row in rows)


def read_log(path: Path) -> list[Episode]:
    """Read a log.

    Raises:
        LogError: no such file, or one that holds something else.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return [Episode.model_validate(row) for row in csv.DictReader(file)]
    except (OSError, UnicodeDecodeError, csv.Error, ValidationError) as error:
        raise LogError(f"{path}: expected a training log: {error}") from error


def main(
    sessions: Annotated[list[Path], typer.Argument(help="folders of `rabbit train`")],
    out: Annotated[Path, typer.Option(help="CSV file")] = COMMITTED,
) -> None:
    """Write the episodes of training sessions to one file."""
    from rabbit_cli.options import complaints

    with complaints(LogError):
        rows: list[Any] = [row for folder in sessions for row in read_session(folder)]
    write_log(rows, out)
    print(f"written {out}: {len(rows)} episodes of {len(sessions)} sessions")


if __name__ == "__main__":
    typer.run(main)

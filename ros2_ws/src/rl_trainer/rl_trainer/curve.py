"""How a training goes, an episode a row: in the folder's curve.csv, and by the same names in TensorBoard."""

from collections.abc import Sequence
from pathlib import Path

from rabbit_description.atomic_file import replace_table

from rl_trainer.training import EpisodeReport

CURVE = "curve.csv"


def scalars(report: EpisodeReport) -> dict[str, float]:
    """What is told of an episode, by name."""
    told = {f"episode/{name}": float(getattr(report, name)) for name in ("steps", "ticks", "kept", "failed", "sigma")}
    for group in ("reward", "losses", "left_out"):
        told |= {f"{group}/{name}": value for name, value in getattr(report, group).items()}
    return told


def write_curve(folder: Path, reports: Sequence[EpisodeReport]) -> None:
    """Write curve.csv: the episode, counted from 0, and its `scalars`; a cell is empty where an episode has none."""
    replace_table(folder / CURVE, ({"episode": report.episode, **scalars(report)} for report in reports))

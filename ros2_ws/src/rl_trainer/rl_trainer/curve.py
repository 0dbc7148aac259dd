"""How a training goes, an episode a row: in the folder's curve.csv, and by the same names in TensorBoard."""

import csv
from collections.abc import Sequence
from pathlib import Path

from rabbit_description.atomic_file import replacing

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
    rows = [{"episode": report.episode, **scalars(report)} for report in reports]
    names = dict.fromkeys(name for row in rows for name in row)
    with replacing(folder / CURVE) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(names))
        table.writeheader()
        table.writerows(rows)

"""What one run is and what it leaves behind. A job is the grain of cache, resumption and parallel work.

walk          the figures of a run, as `rabbit evaluate` has them     RunRow, JSON
records       all its ticks, for a figure                             WalkRecords, npz
feasibility   which ticks' hard rows a linear programme finds empty   Feasibility, JSON
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel
from rabbit_description.atomic_file import replacing
from rabbit_description.plugins import modules
from rabbit_sim.parameters import PLANTS
from rabbit_viewer.walk_records import load_records, save_records

from rabbit_experiments import evaluation
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import record_walk, walk
from rabbit_experiments.metrics import RunRow
from rabbit_experiments.reproduce import feasibility
from rabbit_experiments.reproduce.feasibility import Feasibility, measure

Kind = Literal["walk", "records", "feasibility"]
SOURCES: dict[Kind, tuple[str, ...]] = {  # modules that a run of this kind goes through, with all that they import
    "walk": (evaluation.__name__, *modules(PLANTS)),
    "records": (evaluation.__name__, *modules(PLANTS)),
    "feasibility": (feasibility.__name__, *modules(PLANTS)),
}
Result = Any  # RunRow, WalkRecords or Feasibility, by kind


@dataclass(frozen=True)
class Job:
    """One run of `assembly` from episode seed `seed`; `judges` are asked at its states, where the kind is feasibility.

    `title` is what the progress says.
    """

    kind: Kind
    assembly: Assembly
    seed: int
    judges: tuple[Assembly, ...] = ()
    title: str = field(default="", compare=False)

    def do(self) -> Result:
        """The run, from parts that have seen nothing yet."""
        if self.kind == "walk":
            return walk(self.assembly, 0, self.seed).row
        if self.kind == "records":
            return record_walk(self.assembly, self.seed)
        return measure(self.assembly, self.judges, self.seed)


def suffix(kind: Kind) -> str:
    """Of a result's file."""
    return ".npz" if kind == "records" else ".json"


def save(kind: Kind, result: Result, path: Path) -> None:
    """Write a result at once or not at all."""
    if kind == "records":
        save_records(result, path)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        partial.write_text(json.dumps(result.model_dump(mode="python")), encoding="utf-8")  # keeps NaN


def load(kind: Kind, path: Path) -> Result:
    """Read a result; raises `ValueError` or `OSError` where it is none."""
    return _LOADERS[kind](path)


def _from_json(model: type[BaseModel]) -> Callable[[Path], Result]:
    return lambda path: model.model_validate(json.loads(path.read_text(encoding="utf-8")))


_LOADERS: dict[Kind, Callable[[Path], Result]] = {
    "walk": _from_json(RunRow),
    "records": load_records,
    "feasibility": _from_json(Feasibility),
}

"""What experiments leave, from which the page over all of them is made.

DIR/claims.csv        every claim with its verdict, and the command that judges it
DIR/runs.csv          every line of every experiment on every plant, with the command that makes it
DIR/NAME/TABLE.csv    what else an experiment counts
DIR/NAME/FIGURE.png   its figure
"""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from matplotlib.figure import Figure
from pydantic import BaseModel, ConfigDict
from rabbit_description.atomic_file import replace_text
from rabbit_viewer import style

CLAIMS, RUNS = "claims.csv", "runs.csv"
Cell = str | int | float | bool | None


class Verdict(StrEnum):
    """The verdict on a claim."""

    REPRODUCED = "reproduced"
    PARTLY = "partly"
    NOT = "not"
    NOTHING = "shows nothing"  # the nominal controller passes too, so that learning is not what did it
    OPEN = "no claim"  # ours, beside the paper


def judge(parts: Mapping[str, bool], nominal_passes: bool = False) -> Verdict:
    """All parts hold: reproduced, or shows nothing where the nominal controller passes as well. Some: partly.

    Raises:
        ValueError: no parts.
    """
    if not parts:
        raise ValueError("parts: expected at least one")
    if not any(parts.values()):
        return Verdict.NOT
    if not all(parts.values()):
        return Verdict.PARTLY
    return Verdict.NOTHING if nominal_passes else Verdict.REPRODUCED


def missing(parts: Mapping[str, bool]) -> str:
    """Which parts do not hold, in words; nothing where all do."""
    wrong = [name for name, holds in parts.items() if not holds]
    return "not: " + "; ".join(wrong) if wrong else ""


class Claim(BaseModel):
    """What the paper says, what we found, and what becomes of it, in PyBullet and `on_rigid`.

    `tuned`: what the nominal controller at its best does in the same place; `undone`: it does what the claim has
    learning do, or walks where the claim has it fail.
    """

    model_config = ConfigDict(frozen=True)

    claim: str
    paper: str = "-"
    ours: str
    verdict: Verdict = Verdict.OPEN
    on_rigid: Verdict | None = None
    tuned: str = "-"
    undone: bool = False


@dataclass(frozen=True)
class Table:
    """Rows; those named `runs` go into the file that all experiments share."""

    name: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]

    @property
    def csv(self) -> str:
        """Bare values."""
        text = io.StringIO(newline="")
        csv.writer(text, lineterminator="\n").writerows([self.columns, *self.rows])
        return text.getvalue()


@dataclass(frozen=True)
class Report:
    """One experiment's; `about` has what every row of its claims says."""

    name: str
    about: Mapping[str, Cell]
    claims: Sequence[Claim]
    tables: Sequence[Table] = ()
    figures: Mapping[str, Figure] | None = None

    def write(self, out: Path) -> None:
        """Put everything into `out`, in place of what it has of this experiment."""
        for table in self.tables:
            if f"{table.name}.csv" == RUNS:
                self._put(out / RUNS, table.columns, table.rows)
            else:
                (out / self.name).mkdir(parents=True, exist_ok=True)
                replace_text(out / self.name / f"{table.name}.csv", table.csv)
        rows = [(*claim.model_dump().values(), *self.about.values()) for claim in self.claims]
        self._put(out / CLAIMS, (*Claim.model_fields, *self.about), rows)
        for name, figure in (self.figures or {}).items():
            style.save(figure, out / self.name / f"{name}.png", dpi=110)

    def _put(self, path: Path, columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
        heads, own = ("experiment", *columns), [(self.name, *row) for row in rows]
        others = [
            tuple(row.get(head, "") for head in heads) for row in read_rows(path) if row["experiment"] != self.name
        ]
        replace_text(path, Table("", heads, sorted([*others, *own], key=lambda row: str(row[0]))).csv)


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of a file of these; none where there is no such file."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))

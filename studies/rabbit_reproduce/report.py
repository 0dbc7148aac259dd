"""What an experiment leaves: claims with their verdicts, tables and figures, in a folder of its own.

DIR/NAME/report.json      all of it, from which the page over all experiments is made
DIR/NAME/TABLE.md, .csv   each table
DIR/NAME/FIGURE.png       each figure, for a page
DIR/NAME/FIGURE-*.pdf, .svg   as wide as one and as two columns of a paper
"""

import csv
import io
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path

from matplotlib.figure import Figure
from pydantic import BaseModel, ConfigDict, ValidationError
from rabbit_description.atomic_file import replace_text
from rabbit_description.bounded_file import FileError, read_text
from rabbit_experiments.tables import markdown_table
from rabbit_viewer import style

REPORT = "report.json"
MOST_BYTES = 100_000_000
Cell = str | int | float | None
WIDTHS = {"": None, "-1-column": 1, "-2-columns": 2}  # of each figure, by what its file's name ends in
Drawn = dict[str, dict[str, Figure]]  # by name, then by width


class Verdict(StrEnum):
    """Of a claim."""

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


class Table(BaseModel):
    """A table; `long` ones are written as CSV alone."""

    model_config = ConfigDict(frozen=True)

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    long: bool = False

    @property
    def markdown(self) -> str:
        """With a rule below the head."""
        return markdown_table(self.columns, ([_cell(cell) for cell in row] for row in self.rows))

    @property
    def csv(self) -> str:
        """Bare values."""
        text = io.StringIO(newline="")
        csv.writer(text).writerows([self.columns, *self.rows])
        return text.getvalue()


class Report(BaseModel):
    """One experiment's. `policies` has versions by name, `figures` captions by name without suffix."""

    model_config = ConfigDict(frozen=True)

    name: str
    title: str
    label: str
    paper: str
    why: str = ""
    quick: bool
    retrained: bool
    plant: str = "pybullet"  # on which claims are judged
    commit: str
    policies: dict[str, str]
    claims: tuple[Claim, ...]
    tables: tuple[Table, ...]
    figures: dict[str, str]

    def write(self, out: Path, drawn: Drawn) -> None:
        """Put everything into `out/NAME`."""
        folder = out / self.name
        folder.mkdir(parents=True, exist_ok=True)
        for table in self.tables:
            replace_text(folder / f"{table.name}.csv", table.csv)
            if not table.long:
                replace_text(folder / f"{table.name}.md", table.markdown)
        for name, widths in drawn.items():
            for width, figure in widths.items():
                for suffix in ("svg", "pdf") if width else ("png",):
                    style.save(figure, folder / f"{name}{width}.{suffix}", dpi=160)
        replace_text(folder / REPORT, self.model_dump_json(indent=1))


def read_report(folder: Path) -> Report | None:
    """The report of an experiment's folder; None where there is none, or one of another version."""
    try:
        return Report.model_validate_json(read_text(folder / REPORT, MOST_BYTES))
    except (FileError, ValidationError):
        return None


def _cell(cell: Cell) -> str:
    if cell is None:
        return "-"
    text = f"{cell:.3g}" if isinstance(cell, float) else str(cell)
    return text.replace("|", "\\|")

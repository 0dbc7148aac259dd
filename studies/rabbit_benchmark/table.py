"""The benchmark's table: what each method walked in each cell, course by course, and the comparisons that follow."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator
from rabbit_experiments.summary import wilson
from rabbit_experiments.tables import markdown_table, read_rows, write_rows

from rabbit_benchmark.comparison import Paired, paired

WALKED, ENDED = "w", "."


class BenchmarkRow(BaseModel):
    """A row of benchmark.csv: Wilson's 95% interval, ms of the median control tick; `reason` where nothing was run.

    `by_course` has a letter for each course, in the order that all methods share: `w` walked, `.` not. It is empty in
    older tables.
    """

    model_config = ConfigDict(frozen=True)

    method: str
    cell: str
    walked: int | None = None
    courses: int | None = None
    low: float | None = None
    high: float | None = None
    mean_stones: float | None = None
    tick_ms: float | None = None
    reason: str = ""
    by_course: str = ""

    @model_validator(mode="before")
    @classmethod
    def _blank_is_none(cls, given: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in given.items() if value != ""}

    @property
    def outcomes(self) -> list[bool]:
        """Whether each course was walked."""
        return [letter == WALKED for letter in self.by_course]


def by_course(outcomes: Iterable[bool]) -> str:
    """A letter for each course."""
    return "".join(WALKED if is_walked else ENDED for is_walked in outcomes)


class Table:
    """Rows by method and cell."""

    def __init__(self, rows: Iterable[BenchmarkRow]) -> None:
        self.rows = {(row.method, row.cell): row for row in rows}
        self.methods = list(dict.fromkeys(method for method, _ in self.rows))
        self.cells = list(dict.fromkeys(cell for _, cell in self.rows))

    @classmethod
    def read(cls, path: Path) -> "Table":
        """Reads the table of a file; raises `ValueError` where it is none."""
        return cls(read_rows(path, BenchmarkRow))

    def write(self, path: Path) -> None:
        """Writes it to a file."""
        write_rows(path, BenchmarkRow, self.rows.values())

    def walked(self, method: str, cells: Sequence[str]) -> int:
        """Courses that it walked there."""
        return sum(self.rows[method, cell].walked or 0 for cell in cells if (method, cell) in self.rows)

    def courses(self, method: str, cells: Sequence[str]) -> int:
        """Courses that it has there."""
        return sum(self.rows[method, cell].courses or 0 for cell in cells if (method, cell) in self.rows)

    def rate_text(self, method: str, cells: Sequence[str]) -> str:
        """Walked of all courses there, with Wilson's 95% interval; blank where it lacks a cell."""
        return rate_text(self.walked(method, cells), self.courses(method, cells)) if self._has(method, cells) else ""

    def counts(self, method: str, maps: Iterable[Sequence[str]]) -> list[str]:
        """Courses that it walked in the cells of each map, and in all; blank where it lacks a cell."""
        walked = [str(self.walked(method, cells)) if self._has(method, cells) else "" for cells in maps]
        return [*walked, f"{sum(map(int, walked)):,}" if all(walked) else ""]

    def leaderboard(
        self, titles: Mapping[str, str], maps: Mapping[str, Sequence[str]], sizes: Sequence[int], about: Sequence[str]
    ) -> str:
        """A row for each method of `titles`: its `counts` of maps of these `sizes`; `about`: seed, engine, commit."""
        heads = [f"{name}, of {size}" for name, size in zip(maps, sizes, strict=True)]
        lines = [[title, *self.counts(method, maps.values()), *about] for method, title in titles.items()]
        return markdown_table(("method", *heads, f"all, of {sum(sizes):,}", "seed", "engine", "commit"), lines)

    def _has(self, method: str, cells: Sequence[str]) -> bool:
        return all(self.courses(method, [cell]) for cell in cells)

    def paired(self, this: str, other: str, cells: Sequence[str]) -> Paired | None:
        """Two methods on their common courses there; None where a row does not say how each course ended."""
        common = [cell for cell in cells if self.courses(this, [cell]) and self.courses(other, [cell])]
        both = [(self.rows[this, cell], self.rows[other, cell]) for cell in common]
        if any(len(row.by_course) != row.courses for pair in both for row in pair):
            return None
        walked = [outcomes for one, two in both for outcomes in zip(one.outcomes, two.outcomes, strict=True)]
        return paired([one for one, _ in walked], [two for _, two in walked])

    def walked_more(self, reference: str) -> dict[str, list[str]]:
        """The methods, by cell, that walk the most courses there, where the reference does not."""
        by_cell = {}
        for cell in self.cells:
            walked = {method: self.walked(method, [cell]) for method in self.methods if (method, cell) in self.rows}
            if (most := max(walked.values())) > walked.get(reference, most):
                by_cell[cell] = [method for method, courses in walked.items() if courses == most]
        return by_cell


def rate_text(walked: int, courses: int) -> str:
    """As in `29 of 200 (0.10 to 0.20)`, with Wilson's 95% interval."""
    return "{} of {} ({:.2f} to {:.2f})".format(walked, courses, *wilson(walked, courses))

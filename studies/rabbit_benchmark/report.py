"""What the benchmark leaves beside its table: a picture and a page."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rabbit_description.atomic_file import replace_text
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments import provenance
from rabbit_experiments.cache import Cache
from rabbit_experiments.metrics import RunResult
from rabbit_experiments.summary import Walks, times
from rabbit_experiments.tables import markdown_table
from rabbit_reproduce.table_lines import PLANT_TITLES as ENGINES
from rabbit_viewer import style

from rabbit_benchmark.cells import Cell
from rabbit_benchmark.comparison import Paired, holm
from rabbit_benchmark.families import Split
from rabbit_benchmark.methods import REFERENCE, Method
from rabbit_benchmark.protocol import Plan, Protocol
from rabbit_benchmark.table import BenchmarkRow, Table, by_course


@dataclass(frozen=True)
class Benchmark:
    """All runs, done."""

    protocol: Protocol
    methods: Sequence[Method]
    cells: Sequence[Cell]
    results: dict[tuple[Method, Cell], list[RunResult] | str]
    reference: str

    @classmethod
    def from_cache(
        cls,
        protocol: Protocol,
        methods: Sequence[Method],
        cells: Sequence[Cell],
        runs: Plan,
        cache: Cache,
        reference: str = REFERENCE,
    ) -> "Benchmark":
        """Makes it of what `engine.run` kept."""
        results = {
            key: jobs if isinstance(jobs, str) else [cache.get(job) for job in jobs] for key, jobs in runs.items()
        }
        return cls(protocol, methods, cells, results, reference)

    def write(self, out: Path) -> Path:
        """benchmark.csv, cells.png and benchmark.md, which is returned."""
        self.table.write(out / "benchmark.csv")
        style.save(self.figure(), out / "cells.png", dpi=150)
        page = out / "benchmark.md"
        replace_text(page, self.page())
        return page

    @cached_property
    def table(self) -> Table:
        """A row for each method and cell."""
        return Table(self._row(method, cell) for method in self.methods for cell in self.cells)

    def figure(self) -> Figure:
        """Courses walked, a column for each method, a row for each cell."""
        figure, (axes,) = style.figure(1, height=1.2 + 0.2 * len(self.cells), width=3.0 + 0.5 * len(self.methods))
        walks = [[self._walks(method, cell) for method in self.methods] for cell in self.cells]
        rate_map(axes, [cell.name for cell in self.cells], [method.name for method in self.methods], walks)
        return figure

    def page(self) -> str:
        """The page."""
        seconds = self.protocol.tick_seconds
        tick = "" if seconds == TICK_SECONDS else f", ticks of {seconds * 1e3:g} ms"
        head = (
            f"# Benchmark\n\n    {provenance.command()}\n\n"
            f"Commit {provenance.commit() or 'unknown'}. Seed {self.protocol.seed} ({self.protocol.seeds}), "
            f"{self.protocol.courses} courses of {self.protocol.stones} stones or steps a cell, "
            f"{ENGINES[self.protocol.plant]}{tick}. "
            "All methods walk the same courses. Walked of courses, with Wilson's 95% interval.\n\n"
        )
        return (
            f"{head}## Courses walked on each map\n\n{self._maps()}\n"
            f"## Courses walked in each cell\n\n{self._table()}\n![cells](cells.png)\n\n"
            f"## Compared with {self.reference}\n\n{self._comparison()}\n"
            f"## Cost and training data\n\n{self._cost()}\n"
            f"## For the leaderboard\n\n{self._leaderboard()}"
        )

    def _maps(self) -> str:
        """A column for each map and terrain; blank where a cell lacks."""
        groups, lines = self._groups(), []
        for method in self.methods:
            walks = [[self._walks(method, cell) for cell in cells] for cells in groups.values()]
            whole = [None if None in group else Walks([row for w in group if w for row in w.rows]) for group in walks]
            lines.append([method.title, *map(_rate, whole)])
        return markdown_table(("method", *groups), lines)

    def _groups(self) -> dict[str, list[Cell]]:
        """Cells by map and terrain."""
        groups = dict[str, list[Cell]]()
        for cell in self.cells:
            groups.setdefault(f"{cell.map}, {cell.terrain}", []).append(cell)
        return groups

    def _table(self) -> str:
        lines = [[cell.name, *(_rate(self._walks(method, cell)) for method in self.methods)] for cell in self.cells]
        blank = dict.fromkeys((method.name, why) for (method, _), why in self.results.items() if isinstance(why, str))
        notes = "".join(f"\n{name} is blank where it has {reason}.\n" for name, reason in blank)
        return markdown_table(("cell", *(method.title for method in self.methods)), lines) + notes

    def _comparison(self) -> str:
        reference = next((method for method in self.methods if method.name == self.reference), None)
        others = [method for method in self.methods if method != reference]
        if not reference or not others:
            return f"Nothing to compare: it takes {self.reference} and another method.\n"
        pairs = [self._paired(other, reference, self.cells) for other in others]
        adjusted = holm([pair.p_value for pair in pairs])
        lines = [
            [other.title, *map(str, (pair.courses, pair.only_this, pair.only_other)), f"{pair.p_value:.2g}", f"{p:.2g}"]
            for other, pair, p in zip(others, pairs, adjusted, strict=True)
        ]
        columns = ("method", "common courses", "it alone walked", f"{self.reference} alone", "p", "p (Holm)")
        where = self._groups() | {cell.name: [cell] for cell in self.cells if cell.map in get_args(Split)}
        differences = [
            [name, *(_points(self._paired(other, reference, cells)) for other in others)]
            for name, cells in where.items()
        ]
        return (
            "Exact McNemar test over the common courses of all cells here, two-sided. It speaks of these cells: "
            f"the courses of one cell share a plant.\n\n{markdown_table(columns, lines)}\n"
            f"Courses walked of a hundred, more than {self.reference}, with the paired 95% interval:\n\n"
            f"{markdown_table(('where', *(other.title for other in others)), differences)}\n"
            f"Where another method walks more courses than {self.reference}:\n\n"
            f"{walked_more(self.table, self.reference)}"
        )

    def _paired(self, this: Method, other: Method, cells: Sequence[Cell]) -> Paired:
        """Two methods on their common courses in some cells."""
        pair = self.table.paired(this.name, other.name, [cell.name for cell in cells])
        assert pair
        return pair

    def _cost(self) -> str:
        lines = []
        for method in self.methods:
            in_cells = [self.results[method, cell] for cell in self.cells]
            every = [result for results in in_cells if not isinstance(results, str) for result in results]
            tick = f"{times(every)['tick_ms_p50']:.2f}" if every else ""
            lines.append((method.title, tick, method.trained_on or "nothing"))
        return markdown_table(("method", "tick, median (ms)", "trained on"), lines)

    def _leaderboard(self) -> str:
        """A row for each method: courses walked on each map, of all, and what they can be walked again with."""
        groups, about = self._groups(), [str(self.protocol.seed), ENGINES[self.protocol.plant], provenance.commit()]
        sizes = {name: sum(cell.courses(self.protocol.courses) for cell in cells) for name, cells in groups.items()}
        lines = []
        for method in self.methods:
            walks = [[self._walks(method, cell) for cell in cells] for cells in groups.values()]
            walked = ["" if None in group else str(sum(w.walked for w in group if w)) for group in walks]
            every = f"{sum(map(int, walked)):,}" if all(walked) else ""
            lines.append([method.title, *walked, every, *about])
        columns = [f"{name}, of {size}" for name, size in sizes.items()]
        return markdown_table(
            ("method", *columns, f"all, of {sum(sizes.values()):,}", "seed", "engine", "commit"), lines
        )

    def _walks(self, method: Method, cell: Cell) -> Walks | None:
        results = self.results[method, cell]
        return None if isinstance(results, str) else Walks([result.row for result in results])

    def _row(self, method: Method, cell: Cell) -> BenchmarkRow:
        about, results = {"method": method.name, "cell": cell.name}, self.results[method, cell]
        if isinstance(results, str):
            return BenchmarkRow(**about, reason=results)
        walks = Walks([result.row for result in results])
        (low, high), tick = walks.interval, times(results)["tick_ms_p50"]
        figures = {"walked": walks.walked, "courses": walks.runs, "low": low, "high": high}
        letters = by_course(row.success for row in walks.rows)
        return BenchmarkRow(**about, **figures, mean_stones=walks.mean_stones, tick_ms=tick, by_course=letters)


def walked_more(table: Table, reference: str) -> str:
    """The cells where another method walks more courses, and which walk the most; of an oracle too, the bound."""
    lines = []
    for cell, most in table.walked_more(reference).items():
        row, best = (table.rows[method, cell] for method in (reference, most[0]))
        lines.append([f"`{cell}`", str(row.courses), str(row.walked), str(best.walked), ", ".join(most)])
    return markdown_table(("cell", "courses", reference, "the most", "by"), lines) if lines else "Nowhere.\n"


def _points(pair: Paired) -> str:
    """A difference in points, as in `+3.0 (-1.2 to +7.1)`."""
    if not pair.courses:
        return ""
    difference, low, high = (100 * share for share in pair.difference)
    return f"{difference:+.1f} ({low:+.1f} to {high:+.1f})"


def _rate(walks: Walks | None) -> str:
    return walks.rate_text if walks else ""


def rate_map(axes: Axes, rows: Sequence[str], columns: Sequence[str], walks: Sequence[Sequence[Walks | None]]) -> None:
    """Share of courses walked as colour, their number in it, a row of `walks` for each of `rows`; None is blank."""
    rates = np.array([[cell.walked / cell.runs if cell else np.nan for cell in row] for row in walks])
    axes.imshow(rates, cmap="cividis", vmin=0, vmax=1, aspect="auto")
    for (i, j), rate in np.ndenumerate(rates):
        if cell := walks[i][j]:
            axes.text(j, i, str(cell.walked), ha="center", va="center", color="black" if rate > 0.5 else "white")
    axes.set_yticks(range(len(rows)), rows)
    axes.set_xticks(range(len(columns)), columns, rotation=90)
    axes.grid(visible=False)

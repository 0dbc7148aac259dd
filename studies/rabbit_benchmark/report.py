"""What the benchmark leaves beside its table: a picture and a page."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import get_args

import numpy as np
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
    """All `runs`, done: `cache` has what `engine.run` kept of them."""

    protocol: Protocol
    methods: Sequence[Method]
    cells: Sequence[Cell]
    runs: Plan
    cache: Cache
    reference: str = REFERENCE

    @cached_property
    def results(self) -> dict[tuple[Method, Cell], list[RunResult] | str]:
        """Results by method and cell, or the reason why there are none."""
        get = self.cache.get
        return {key: jobs if isinstance(jobs, str) else list(map(get, jobs)) for key, jobs in self.runs.items()}

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
        rates = np.full((len(self.cells), len(self.methods)), np.nan)
        for (i, cell), (j, method) in product(enumerate(self.cells), enumerate(self.methods)):
            row = self.table.rows[method.name, cell.name]
            if row.walked is not None and row.courses:
                rates[i, j] = row.walked / row.courses
                colour = "black" if rates[i, j] > 0.5 else "white"
                axes.text(j, i, str(row.walked), ha="center", va="center", color=colour)
        axes.imshow(rates, cmap="cividis", vmin=0, vmax=1, aspect="auto")
        axes.set_yticks(range(len(self.cells)), [cell.name for cell in self.cells])
        axes.set_xticks(range(len(self.methods)), [method.name for method in self.methods], rotation=90)
        axes.grid(visible=False)
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
        groups, rate = self._groups(), self.table.rate_text
        lines = [[method.title, *(rate(method.name, cells) for cells in groups.values())] for method in self.methods]
        return markdown_table(("method", *groups), lines)

    def _groups(self) -> dict[str, list[str]]:
        """Cells by map and terrain."""
        groups = dict[str, list[str]]()
        for cell in self.cells:
            groups.setdefault(f"{cell.map}, {cell.terrain}", []).append(cell.name)
        return groups

    def _table(self) -> str:
        rate = self.table.rate_text
        lines = [[cell.name, *(rate(method.name, [cell.name]) for method in self.methods)] for cell in self.cells]
        blank = dict.fromkeys((method.name, why) for (method, _), why in self.results.items() if isinstance(why, str))
        notes = "".join(f"\n{name} is blank where it has {reason}.\n" for name, reason in blank)
        return markdown_table(("cell", *(method.title for method in self.methods)), lines) + notes

    def _comparison(self) -> str:
        others = [method for method in self.methods if method.name != self.reference]
        if len(others) in (0, len(self.methods)):
            return f"Nothing to compare: it takes {self.reference} and another method.\n"
        pairs = [self._paired(other, [cell.name for cell in self.cells]) for other in others]
        adjusted = holm([pair.p_value for pair in pairs])
        lines = [
            [other.title, *map(str, (pair.courses, pair.only_this, pair.only_other)), f"{pair.p_value:.2g}", f"{p:.2g}"]
            for other, pair, p in zip(others, pairs, adjusted, strict=True)
        ]
        columns = ("method", "common courses", "it alone walked", f"{self.reference} alone", "p", "p (Holm)")
        where = self._groups() | {cell.name: [cell.name] for cell in self.cells if cell.map in get_args(Split)}
        differences = [
            [name, *(_points(self._paired(other, cells)) for other in others)] for name, cells in where.items()
        ]
        return (
            "Exact McNemar test over the common courses of all cells here, two-sided. It speaks of these cells: "
            f"the courses of one cell share a plant.\n\n{markdown_table(columns, lines)}\n"
            f"Courses walked of a hundred, more than {self.reference}, with the paired 95% interval:\n\n"
            f"{markdown_table(('where', *(other.title for other in others)), differences)}\n"
            f"Where another method walks more courses than {self.reference}:\n\n"
            f"{walked_more(self.table, self.reference)}"
        )

    def _paired(self, method: Method, cells: Sequence[str]) -> Paired:
        """A method and the reference on their common courses in some cells."""
        pair = self.table.paired(method.name, self.reference, cells)
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
        sizes = Counter[str]()
        for cell in self.cells:
            sizes[f"{cell.map}, {cell.terrain}"] += cell.courses(self.protocol.courses)
        titles = {method.name: method.title for method in self.methods}
        about = str(self.protocol.seed), ENGINES[self.protocol.plant], provenance.commit()
        return self.table.leaderboard(titles, self._groups(), [*sizes.values()], about)

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

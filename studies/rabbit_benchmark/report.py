"""What the benchmark leaves: a table, a picture and a page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure
from pydantic import BaseModel, ConfigDict
from rabbit_description.atomic_file import replace_text, replacing
from rabbit_experiments import provenance
from rabbit_experiments.cache import Cache
from rabbit_experiments.metrics import RunResult
from rabbit_experiments.summary import Walks, times
from rabbit_experiments.tables import markdown_table, write_rows
from rabbit_reproduce.success_map import side_by_side, success_map
from rabbit_reproduce.table_lines import PLANT_TITLES

from rabbit_benchmark.cells import Cell
from rabbit_benchmark.comparison import holm, paired
from rabbit_benchmark.methods import REFERENCE, Method
from rabbit_benchmark.protocol import SEEDS, Plan, Protocol


class BenchmarkRow(BaseModel):
    """A row of benchmark.csv: Wilson's 95% interval, ms of the median control tick; `reason` where nothing was run."""

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


@dataclass(frozen=True)
class Benchmark:
    """All runs, done."""

    protocol: Protocol
    methods: Sequence[Method]
    cells: Sequence[Cell]
    results: dict[tuple[Method, Cell], list[RunResult] | str]

    @classmethod
    def from_cache(
        cls, protocol: Protocol, methods: Sequence[Method], cells: Sequence[Cell], runs: Plan, cache: Cache
    ) -> "Benchmark":
        """With what `engine.run` kept."""
        results = {
            key: jobs if isinstance(jobs, str) else [cache.get(job) for job in jobs] for key, jobs in runs.items()
        }
        return cls(protocol, methods, cells, results)

    def write(self, out: Path) -> Path:
        """benchmark.csv, maps.png, cells.png and benchmark.md, which is returned."""
        write_rows(out / "benchmark.csv", BenchmarkRow, self.rows())
        for name, figure in (("maps.png", self.maps_figure()), ("cells.png", self.cells_figure())):
            with replacing(out / name) as partial:
                figure.savefig(partial, format="png", dpi=150, bbox_inches="tight")
        page = out / "benchmark.md"
        replace_text(page, self.page())
        return page

    def rows(self) -> list[BenchmarkRow]:
        """One for each method and cell."""
        return [self._row(method, cell) for method in self.methods for cell in self.cells]

    def maps_figure(self) -> Figure:
        """Courses walked, a row for each method, a column for each map and terrain."""
        columns, walks = self._maps()
        return success_map([method.title for method in self.methods], columns, walks)[0]

    def cells_figure(self) -> Figure:
        """Courses walked, a panel for each terrain, a row for each of its cells."""
        panels = dict[str, tuple[list[str], list[list[Walks | None]]]]()
        for terrain in dict.fromkeys(cell.terrain for cell in self.cells):
            cells = [cell for cell in self.cells if cell.terrain == terrain]
            walks = [[self._walks(method, cell) for method in self.methods] for cell in cells]
            panels[terrain] = [cell.name.removeprefix(f"{terrain}/") for cell in cells], walks
        return side_by_side(panels, [method.name for method in self.methods])

    def page(self) -> str:
        """The page."""
        seeds = self.protocol.seeds
        head = (
            f"# Benchmark\n\n    {provenance.command()}\n\n"
            f"Commit {provenance.commit() or 'unknown'}. The {seeds} seeds ({SEEDS[seeds]}), "
            f"{self.protocol.courses} courses of {self.protocol.stones} stones or steps a cell, "
            f"{PLANT_TITLES[self.protocol.plant]}. All methods walk the same courses. Walked of courses, with "
            "Wilson's 95% interval.\n\n"
        )
        return (
            f"{head}## Courses walked on each map\n\n{self._maps_table()}\n![maps](maps.png)\n\n"
            f"## Courses walked in each cell\n\n{self._table()}\n![cells](cells.png)\n\n"
            f"## Compared with {REFERENCE}\n\n{self._comparison()}\n"
            f"## Cost and training data\n\n{self._cost()}"
        )

    def _maps(self) -> tuple[list[str], list[list[Walks | None]]]:
        """Columns, one for each map and terrain, and for each method the walks in its cells; None if one lacks."""
        groups = dict[str, list[Cell]]()
        for cell in self.cells:
            groups.setdefault(f"{cell.map}, {cell.terrain}", []).append(cell)
        walks = [
            [_together([self._walks(method, cell) for cell in cells]) for cells in groups.values()]
            for method in self.methods
        ]
        return list(groups), walks

    def _maps_table(self) -> str:
        columns, walks = self._maps()
        lines = [[method.title, *map(_rate, row)] for method, row in zip(self.methods, walks, strict=True)]
        return markdown_table(("method", *columns), lines)

    def _table(self) -> str:
        lines = [[cell.name, *(_rate(self._walks(each, cell)) for each in self.methods)] for cell in self.cells]
        blank = dict.fromkeys((method.name, why) for (method, _), why in self.results.items() if isinstance(why, str))
        notes = "".join(f"\n{name} is blank where it has {reason}.\n" for name, reason in blank)
        return markdown_table(("cell", *(each.title for each in self.methods)), lines) + notes

    def _comparison(self) -> str:
        reference = next((each for each in self.methods if each.name == REFERENCE), None)
        others = [each for each in self.methods if each != reference]
        if not reference or not others:
            return f"Nothing to compare: it takes {REFERENCE} and another method.\n"
        pairs = {}
        for other in others:
            walked: tuple[list[bool], list[bool]] = [], []
            for cell in self.cells:
                mine, its = self.results[other, cell], self.results[reference, cell]
                if not isinstance(mine, str) and not isinstance(its, str):
                    walked[0].extend(each.row.success for each in mine)
                    walked[1].extend(each.row.success for each in its)
            pairs[other] = paired(*walked)
        adjusted = holm([each.p_value for each in pairs.values()])
        lines = [
            (
                other.title,
                str(each.courses),
                str(each.only_this),
                str(each.only_other),
                f"{each.p_value:.2g}",
                f"{p:.2g}",
            )
            for (other, each), p in zip(pairs.items(), adjusted, strict=True)
        ]
        columns = ("method", "common courses", "it alone walked", f"{REFERENCE} alone", "p", "p (Holm)")
        text = (
            "Exact McNemar test over the common courses of all cells here, two-sided. It speaks of these cells: "
            "the courses of one cell share a plant.\n\n"
        )
        return text + markdown_table(columns, lines)

    def _cost(self) -> str:
        lines = []
        for method in self.methods:
            found = [self.results[method, cell] for cell in self.cells]
            every = [result for each in found if not isinstance(each, str) for result in each]
            tick = times(every)["tick_ms_p50"] if every else None
            lines.append((method.title, "" if tick is None else f"{tick:.2f}", method.trained_on or "nothing"))
        return markdown_table(("method", "tick, median (ms)", "trained on"), lines)

    def _walks(self, method: Method, cell: Cell) -> Walks | None:
        results = self.results[method, cell]
        return None if isinstance(results, str) else Walks([each.row for each in results])

    def _row(self, method: Method, cell: Cell) -> BenchmarkRow:
        results = self.results[method, cell]
        if isinstance(results, str):
            return BenchmarkRow(method=method.name, cell=cell.name, reason=results)
        walks = Walks([each.row for each in results])
        low, high = walks.interval
        return BenchmarkRow(
            method=method.name,
            cell=cell.name,
            walked=walks.walked,
            courses=walks.runs,
            low=low,
            high=high,
            mean_stones=walks.mean_stones,
            tick_ms=times(results)["tick_ms_p50"],
        )


def _rate(walks: Walks | None) -> str:
    return walks.rate_text if walks else ""


def _together(walks: Sequence[Walks | None]) -> Walks | None:
    """All of them as one, None if one is missing."""
    rows = [each.rows for each in walks if each]
    return Walks([row for each in rows for row in each]) if len(rows) == len(walks) else None

"""An experiment over one parameter of the plant: every controller at every value, and the rates as a figure."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

from matplotlib.figure import Figure
from rabbit_experiments.summary import Walks

from rabbit_reproduce.controllers import Contender
from rabbit_reproduce.curves import rate_figure
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.table_lines import Found, Line, Runs

RUNS = Runs(10, 1)  # there are many values


class Sweep(Experiment):
    """`field` of the plant takes `values`; `plants` has each controller's plant apart from it.

    `axis` names the parameter with its unit, of which there are `scale` in the field's own; `paper_values` has what the
    paper says of single cells; where `nominal` walks too, a row shows nothing.
    """

    field: str
    values: tuple[float, ...]
    plants: ClassVar[Mapping[Contender, dict[str, Any]]]
    axis: str
    scale: float = 1.0
    caption: str
    paper_values: ClassVar[Mapping[tuple[Contender, float], str]] = {}
    nominal: ClassVar[Contender | None] = None

    @property
    def unit(self) -> str:
        """Of the axis."""
        return self.axis.rpartition("(")[2].rstrip(")")

    @cached_property
    def grid(self) -> dict[Contender, dict[float, Line]]:
        """A line for each controller and value."""
        return {each: {value: self._line(each, value) for value in self.values} for each in self.plants}

    def lines(self) -> Sequence[Line]:
        return [line for row in self.grid.values() for line in row.values()]

    def walks(self, found: Found, contender: Contender) -> dict[float, Walks]:
        """A controller's runs on the main plant, by value."""
        return {value: found.walks(line) for value, line in self.grid[contender].items()}

    def figures(self, found: Found) -> dict[str, tuple[str, Figure]]:
        rates = {each: list(self.walks(found, each).values()) for each in self.plants}
        return {
            "rates": (self.caption, rate_figure(self.values, rates, self.axis, self.scale, list(self.paper_values)))
        }

    def _line(self, contender: Contender, value: float) -> Line:
        assembly = contender.assembly(**self.plants[contender], **{self.field: value})
        paper = self.paper_values.get((contender, value), "")
        beside = self._line(self.nominal, value) if self.nominal and contender is not self.nominal else None
        return Line(
            f"{contender.title}, {value * self.scale:g} {self.unit}", assembly, paper, runs=RUNS, nominal=beside
        )


def largest(walks: Mapping[float, Walks]) -> tuple[float | None, float | None]:
    """The largest value that walks, and the largest below which every smaller one walks too; None where none does."""
    passing = [value for value, each in sorted(walks.items()) if each.passes]
    unbroken = None
    for value, each in sorted(walks.items()):
        if not each.passes:
            break
        unbroken = value
    return (passing[-1] if passing else None), unbroken


def largest_text(walks: Mapping[float, Walks], scale: float, unit: str) -> str:
    """The same in words."""
    last, unbroken = largest(walks)
    if last is None:
        return "walks at none"
    if unbroken == last:
        return f"walks up to {last * scale:g} {unit}"
    up_to = f"without a hole up to {unbroken * scale:g} {unit}" if unbroken is not None else "not at the least"
    return f"largest {last * scale:g} {unit}, {up_to}"

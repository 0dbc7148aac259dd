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
    values: Sequence[float]
    plants: ClassVar[Mapping[Contender, dict[str, Any]]]
    axis: str
    scale: float = 1.0
    paper_values: ClassVar[Mapping[tuple[Contender, float], str]] = {}
    nominal: ClassVar[Contender | None] = None

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        return {(each, value): self._line(each, value) for each in self.plants for value in self.values}

    def row(self, found: Found, contender: Contender) -> dict[float, Walks]:
        """A controller's runs, by value."""
        return {value: found.walks(self.by_key[contender, value]) for value in self.values}

    def figures(self, found: Found) -> dict[str, tuple[str, Figure]]:
        rates = {each: list(self.row(found, each).values()) for each in self.plants}
        figure = rate_figure(self.values, rates, self.axis, self.scale, list(self.paper_values))
        return {"rates": (self.caption, figure)}

    def largest(self, walks: Mapping[float, Walks]) -> str:
        """The largest value that walks, in words, and up to which one all do."""
        ordered = sorted(walks.items())
        passing = [value for value, each in ordered if each.passes]
        whole = [value for i, (value, _) in enumerate(ordered) if all(each.passes for _, each in ordered[: i + 1])]
        if not passing:
            return "walks at none"
        if whole and whole[-1] == passing[-1]:
            return f"walks up to {self._text(whole[-1])}"
        up_to = f"without a hole up to {self._text(whole[-1])}" if whole else "not at the least"
        return f"largest {self._text(passing[-1])}, {up_to}"

    def _text(self, value: float) -> str:
        return f"{value * self.scale:g} {self.axis.rpartition('(')[2].rstrip(')')}"

    def _line(self, contender: Contender, value: float) -> Line:
        assembly = contender.assembly(**self.plants[contender], **{self.field: value})
        paper = self.paper_values.get((contender, value), "")
        beside = self._line(self.nominal, value) if self.nominal and contender is not self.nominal else None
        return Line(f"{contender.title}, {self._text(value)}", assembly, paper, runs=RUNS, nominal=beside)

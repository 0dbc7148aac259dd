"""A tiny experiment: one stone, nominal and oracle."""

from collections.abc import Callable

import pytest
from matplotlib.figure import Figure
from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE
from rabbit_reproduce.curves import tracking_figure
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim, judge
from rabbit_reproduce.table_lines import Found, Line, Size


class OneStone(Experiment):
    """At `mass_scale`."""

    name = "one-stone"
    title = "One stone"
    label = "fig:none"
    paper = "Nothing."

    shown = ("nominal",)

    def __init__(self, mass_scale: float = 1.0) -> None:
        assembly, oracle = (each.assembly(stones=1, mass_scale=mass_scale) for each in (CBF_CLF, CBF_CLF_ORACLE))
        self.by_key = {"nominal": Line("nominal", assembly, "walks"), "oracle": Line("oracle", oracle)}

    def claims(self, found: Found) -> list[Claim]:
        """It walks."""
        walks = found.walks(self.by_key["nominal"])
        return [
            Claim(
                claim="it walks", paper="walks", ours=walks.text, verdict=judge({"walks": walks.walked == walks.runs})
            )
        ]

    def figures(self, found: Found) -> dict[str, Figure]:
        """One."""
        return {"errors": tracking_figure({CBF_CLF: found.records(self.by_key["nominal"])})}


@pytest.fixture
def one_stone() -> Callable[..., OneStone]:
    """Makes it: `one_stone(name, mass_scale)`."""

    def make(name: str = OneStone.name, mass_scale: float = 1.0) -> OneStone:
        kind: type[OneStone] = type("Named", (OneStone,), {"name": name})
        return kind(mass_scale)

    return make


@pytest.fixture
def tiny() -> Size:
    """Two runs, one beside."""
    return Size(quick=True, runs=2, beside=1)

"""How much of an imperfection the walk over stones takes: learned, with exact estimates, and nominal."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from rabbit_experiments.reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE, RL_CBF_CLF
from rabbit_experiments.reproduce.report import Claim
from rabbit_experiments.reproduce.sweep import Sweep, largest_text
from rabbit_experiments.reproduce.table_lines import Found
from rabbit_experiments.reproduce.verdict import Verdict


@dataclass(eq=False)
class Tolerance(Sweep):
    """A sweep over `what`; learned and oracle at scale 2, nominal at scale 1."""

    name: str
    title: str
    label: str
    paper: str
    field: str
    values: tuple[float, ...]
    axis: str
    what: str
    scale: float = 1.0
    plants: ClassVar = {RL_CBF_CLF: {"mass_scale": 2.0}, CBF_CLF_ORACLE: {"mass_scale": 2.0}, CBF_CLF: {}}

    def __post_init__(self) -> None:
        over = f"Courses of 20 stones walked over the {self.what}"
        self.caption = f"{over}; learned and oracle at scale 2, nominal at scale 1; 95% intervals."

    def claims(self, found: Found) -> Sequence[Claim]:
        """How much each takes."""
        return [
            Claim(
                claim=f"{self.what} that {each.title} takes (scale {plant.get('mass_scale', 1.0):g})",
                paper="-",
                ours=largest_text(self.walks(found, each), self.scale, self.unit),
                verdict=Verdict.OPEN,
            )
            for each, plant in self.plants.items()
        ]

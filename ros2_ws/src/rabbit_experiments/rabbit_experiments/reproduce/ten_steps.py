"""Ten steps on flat ground: the controllers' tracking errors, their derivatives and force ratios over time."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

from matplotlib.figure import Figure

from rabbit_experiments.reproduce.controllers import CLF, FLAT, IO_RL, RL_CLF, Contender
from rabbit_experiments.reproduce.curves import tracking_figure
from rabbit_experiments.reproduce.experiment import Experiment
from rabbit_experiments.reproduce.report import Claim
from rabbit_experiments.reproduce.table_lines import HEADLINE, Found, Line
from rabbit_experiments.reproduce.verdict import judge

STEPS = 10


class TenSteps(Experiment):
    """`plant` has what is wrong with the model."""

    plant: ClassVar[Mapping[str, Any]]

    @cached_property
    def by_contender(self) -> dict[Contender, Line]:
        """A line each."""
        return {each: Line(each.title, each.assembly(stones=STEPS, **self.plant), runs=HEADLINE) for each in FLAT}

    def lines(self) -> Sequence[Line]:
        return list(self.by_contender.values())

    def recorded(self) -> Sequence[Line]:
        return self.lines()

    def figures(self, found: Found) -> dict[str, tuple[str, Figure]]:
        walks = {each: found.records(line) for each, line in self.by_contender.items()}
        caption = (
            f"{self.title}: tracking error, its derivative and force ratio of the first run. "
            "Dots: within 30 ms of an impact. Cross: it fell."
        )
        return {"tracking": (caption, tracking_figure(walks))}

    def walking_claims(self, found: Found) -> list[Claim]:
        """The learned ones walk, the nominal one does not."""
        walks = {each: found.walks(line) for each, line in self.by_contender.items()}
        return [
            Claim(
                claim=f"{each.title} walks ten steps: {self.title[0].lower()}{self.title[1:]}",
                paper="walks",
                ours=f"{walks[each].text}; nominal {walks[CLF].text}",
                verdict=judge({"walks": walks[each].passes}, walks[CLF].passes),
            )
            for each in (RL_CLF, IO_RL)
        ]

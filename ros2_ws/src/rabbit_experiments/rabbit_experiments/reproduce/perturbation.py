"""A perturbation of the Discussion: at scale 1 and 2, flat and on stones, the nominal controller beside."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from rabbit_experiments.reproduce.controllers import CBF_CLF, CLF, RL_CBF_CLF, RL_CLF, Contender
from rabbit_experiments.reproduce.experiment import Experiment
from rabbit_experiments.reproduce.report import Claim
from rabbit_experiments.reproduce.table_lines import Found, Line
from rabbit_experiments.reproduce.verdict import judge

PAIRS = {"flat": (RL_CLF, CLF), "stones": (RL_CBF_CLF, CBF_CLF)}
SCALES = (1.0, 2.0)
Place = tuple[float, str]


@dataclass(eq=False)
class Perturbation(Experiment):
    """`field` of the plant has `value`; `what` names it in a line."""

    name: str
    title: str
    paper: str
    field: str
    value: float
    what: str
    why: str
    label = "sec:discussion"
    judged_on_rigid = True

    @cached_property
    def by_place(self) -> dict[Place, tuple[Line, Line]]:
        """The learned controller's line and the nominal one's, by scale and terrain."""
        places = [(scale, terrain) for scale in SCALES for terrain in PAIRS]
        return {place: self._lines(place) for place in places}

    def lines(self) -> Sequence[Line]:
        return [line for pair in self.by_place.values() for line in pair]

    def claims(self, found: Found) -> Sequence[Claim]:
        return [self._claim(found, place) for place in self.by_place]

    def _lines(self, place: Place) -> tuple[Line, Line]:
        learned, nominal = PAIRS[place[1]]
        beside = self._line(nominal, place)
        return replace(self._line(learned, place), paper="walks", nominal=beside), beside

    def _line(self, contender: Contender, place: Place) -> Line:
        scale, terrain = place
        assembly = contender.assembly(**{"mass_scale": scale, self.field: self.value})
        return Line(f"{contender.title}, {self.what}, scale {scale:g}, {terrain}", assembly)

    def _claim(self, found: Found, place: Place) -> Claim:
        (learned, nominal), (scale, terrain) = (found.walks(line) for line in self.by_place[place]), place
        return Claim(
            claim=f"{PAIRS[terrain][0].title} walks with {self.what}, scale {scale:g}, {terrain}",
            paper="successful results",
            ours=f"{learned.text}; nominal {nominal.text}",
            verdict=judge({"walks": learned.passes}, nominal.passes),
        )

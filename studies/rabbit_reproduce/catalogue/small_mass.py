"""Less mass than the model believes: scales 0.7 and 0.5 (Discussion)."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.summary import Walks

from rabbit_reproduce.controllers import (
    CBF_CLF,
    CBF_CLF_ORACLE,
    CLF,
    CLF_ORACLE,
    RL_CBF_CLF,
    RL_CBF_CLF_LIGHT,
    RL_CLF,
    Contender,
)
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim, judge
from rabbit_reproduce.table_lines import MAIN, Found, Line, Runs

WHO = {"flat": (RL_CLF, CLF, CLF_ORACLE), "stones": (RL_CBF_CLF, CBF_CLF, CBF_CLF_ORACLE)}
NOMINAL = {each: row[1] for row in WHO.values() for each in row}
SCALES = (0.7, 0.5)
LONG, LONG_RUNS = 1000, Runs(20, 1)  # steps that stand for "indefinitely"
AT_ONCE = 2.0  # steps, mean, within which "fails after just one step" counts as the same


class SmallMass(Experiment):
    """A policy trained at 0.7, as the paper's was, and those trained at 2, an error of the other sign."""

    name = "small-mass"
    title = "Mass scales 0.7 and 0.5"
    label = "sec:discussion"
    paper = (
        "At scale 0.7, trained there, it walks indefinitely within its constraints, and the nominal controller fails "
        "after one step. At 0.5 the nominal controller lasts 0.06 s and the method fails."
    )
    why = (
        "With these gains the nominal controllers do not fail at once at 0.7: they walk on flat ground, and half "
        "of the courses of stones. The policy trained at 0.7 walks 20 stones, but of 1,000 some 90: most episodes "
        "of its training ended within a few steps (docs/history/lab-notes.md), and mu'mu with exact rows loses courses "
        "of 20 there, too."
    )
    judged_on_rigid = True

    @cached_property
    def grid(self) -> dict[tuple[float, Contender], Line]:
        """A line for each scale and controller, 20 steps."""
        return {
            (scale, each): self._line(scale, each)
            for scale in SCALES
            for each in (*WHO["flat"], *WHO["stones"], RL_CBF_CLF_LIGHT)
        }

    @cached_property
    def long(self) -> Line:
        """A thousand steps."""
        assembly = RL_CBF_CLF_LIGHT.assembly(mass_scale=SCALES[0], stones=LONG)
        what = f"{RL_CBF_CLF_LIGHT.title}, scale {SCALES[0]:g}, {LONG} steps"
        return Line(what, assembly, "indefinitely", LONG_RUNS, (MAIN,))

    def lines(self) -> Sequence[Line]:
        return [*self.grid.values(), self.long]

    def claims(self, found: Found) -> Sequence[Claim]:
        """The learned controllers, and the nominal ones."""
        walks = {key: found.walks(line) for key, line in self.grid.items()}
        return [
            *([self._trained(found, walks)] if found.column is MAIN else []),
            *(self._at_once(terrain, walks) for terrain in WHO),
            self._half(walks),
            *(self._untrained(terrain, scale, walks) for scale in SCALES for terrain in WHO),
        ]

    def _line(self, scale: float, contender: Contender) -> Line:
        nominal = NOMINAL.get(contender, CBF_CLF)
        beside = self._line(scale, nominal) if contender is not nominal else None
        return Line(f"{contender.title}, scale {scale:g}", contender.assembly(mass_scale=scale), nominal=beside)

    def _trained(self, found: Found, walks: dict[tuple[float, Contender], Walks]) -> Claim:
        """The paper's claim, with a policy trained as the paper's."""
        long, nominal = found.walks(self.long), walks[SCALES[0], CBF_CLF]
        short = walks[SCALES[0], RL_CBF_CLF_LIGHT]
        forces = f"{long.total('ticks_over_cone')} and {long.total('ticks_lost')} of {long.total('ticks')} ticks"
        return Claim(
            claim=f"{self.long.what}, constraints kept",
            paper="indefinitely long periods, safety and friction respected",
            ours=f"{long.text} steps; over the cone and lost {forces}; 20 steps: {short.text}, nominal {nominal.text}",
            verdict=judge(
                {
                    "walks": long.passes,
                    "keeps the forces": long.total("ticks_over_cone") + long.total("ticks_lost") == 0,
                },
                nominal.passes,
            ),
        )

    def _at_once(self, terrain: str, walks: dict[tuple[float, Contender], Walks]) -> Claim:
        nominal = WHO[terrain][1]
        mine = walks[SCALES[0], nominal]
        return Claim(
            claim=f"{nominal.title} fails at once at scale 0.7",
            paper="fails after one step",
            ours=mine.text,
            verdict=judge({"fails": not mine.passes, "at once": mine.mean_stones <= AT_ONCE}),
        )

    def _half(self, walks: dict[tuple[float, Contender], Walks]) -> Claim:
        """Trained at 2 or 0.7, or with exact estimates, which no training can better.

        A training at 0.5 is among those of `learning-curves --retrain`.
        """
        at = {each: row for (scale, each), row in walks.items() if scale == SCALES[1]}
        trained, oracle = at[RL_CBF_CLF_LIGHT], at[CBF_CLF_ORACLE]
        lasted = float(np.median([row.ticks for row in at[CBF_CLF].rows])) * TICK_SECONDS
        return Claim(
            claim="scale 0.5 is beyond the method, even with exact estimates",
            paper="nominal lasts 0.06 s, the method fails",
            ours=f"trained at 0.7 {trained.text}; oracle {oracle.text}; nominal lasts {lasted:.2f} s",
            verdict=judge(
                {"fails": not trained.passes and not oracle.passes, "nominal fails": not at[CBF_CLF].passes},
            ),
        )

    def _untrained(self, terrain: str, scale: float, walks: dict[tuple[float, Contender], Walks]) -> Claim:
        """Not in the paper: the policies of scale 2."""
        learned, nominal, oracle = (walks[scale, each] for each in WHO[terrain])
        return Claim(
            claim=f"{WHO[terrain][0].title} trained at scale 2 walks at {scale:g}",
            ours=f"{learned.text}; nominal {nominal.text}, oracle {oracle.text}",
        )

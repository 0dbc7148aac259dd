"""The nominal CBF-CLF-QP over stones at twice the mass: how far it comes, and what it does without force rows."""

from collections.abc import Sequence
from functools import cached_property

from rabbit_experiments.summary import Walks

from rabbit_reproduce.controllers import CBF_CLF, RL_CBF_CLF
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim, judge
from rabbit_reproduce.table_lines import Found, Line, Runs

PAPER_MEAN, PAPER_STD = 5.6, 4.64
PAPER_RUNS = Runs(10, 10)
PAPER_INTERVAL = (2.28, 8.92)  # Student's 95%, of the paper's mean
AGAIN = 2  # violations in each run, on average, that count as "repeatedly"


class NominalStones(Experiment):
    """The paper does not say at which scale the force rows were left out: scale 2, as everything there, and 1."""

    name = "nominal-stones"
    title = "Nominal CBF-CLF-QP on stones, ten runs"
    label = "sec:results, Simulation 2"
    paper = (
        "With force rows it leaves the stones after 5.6 +- 4.64 steps (10 runs of 20). Without them it violates the "
        "friction cone and the unilateral normal force repeatedly."
    )
    judged_on_rigid = True

    @cached_property
    def whole(self) -> Line:
        """With all rows."""
        assembly = CBF_CLF.assembly(mass_scale=2.0)
        return Line(f"{CBF_CLF.title}, scale 2", assembly, "5.6 +- 4.64 stones", PAPER_RUNS)

    @cached_property
    def without(self) -> dict[str, Line]:
        """Without force rows."""
        no_rows = {"force_rows": False}
        cases = {"scale 2": (CBF_CLF, 2.0), "scale 1": (CBF_CLF, 1.0), "learned, scale 2": (RL_CBF_CLF, 2.0)}
        return {
            name: Line(
                f"{each.title}, no force rows, scale {scale:g}",
                each.assembly(no_rows, mass_scale=scale),
                "",
                PAPER_RUNS,
            )
            for name, (each, scale) in cases.items()
        }

    def lines(self) -> Sequence[Line]:
        return [self.whole, *self.without.values()]

    def claims(self, found: Found) -> Sequence[Claim]:
        """How far, and the two forces."""
        return [self._how_far(found.walks(self.whole)), self._forces(found.walks(self.without["scale 2"]))]

    def _how_far(self, walks: Walks) -> Claim:
        low, high = walks.stones_interval or (walks.mean_stones,) * 2
        alike = low <= PAPER_INTERVAL[1] and high >= PAPER_INTERVAL[0]
        return Claim(
            claim="the nominal CBF-CLF-QP leaves the stones before the twentieth, after about as many as in the paper",
            paper=f"{PAPER_MEAN} +- {PAPER_STD} steps (mean's interval {PAPER_INTERVAL[0]} to {PAPER_INTERVAL[1]})",
            ours=f"{walks.mean_stones:.2f} +- {walks.std_stones or 0:.2f} ({low:.2f} to {high:.2f}), "
            f"{walks.walked} of {walks.runs} courses walked",
            verdict=judge({"leaves them": not walks.passes, "intervals of the means overlap": alike}),
        )

    def _forces(self, walks: Walks) -> Claim:
        over, lost = walks.total("ticks_over_cone"), walks.total("ticks_lost")
        return Claim(
            claim="without force rows it violates cone and unilateral force repeatedly",
            paper="repeatedly",
            ours=f"{over} ticks over the cone, {lost} without a push from the ground, in {walks.runs} runs",
            verdict=judge({"cone": over >= AGAIN * walks.runs, "unilateral": lost >= AGAIN * walks.runs}),
        )

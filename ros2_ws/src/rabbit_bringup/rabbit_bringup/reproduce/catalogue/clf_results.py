"""Twice the mass on flat ground, ten steps: tracking error, its derivative, force ratio [fig:clf-results]."""

from collections.abc import Sequence
from typing import ClassVar

from rabbit_bringup.reproduce.contenders import CLF, IO_RL, RL_CLF
from rabbit_bringup.reproduce.curves import force_ratio
from rabbit_bringup.reproduce.lines import Found
from rabbit_bringup.reproduce.report import Claim
from rabbit_bringup.reproduce.ten_steps import TenSteps
from rabbit_bringup.reproduce.verdict import judge

EARLY = 2  # steps in which the paper's IO-RL leaves the cone


class ClfResults(TenSteps):
    """Also which controller keeps the friction cone without a row for it."""

    name = "clf-results"
    title = "Twice the mass, flat ground, ten steps"
    label = "fig:clf-results"
    paper = (
        "RL-CLF-QP and IO-RL + CLF-QP walk ten steps at twice the mass, the nominal CLF-QP and L1-CLF-QP do not. "
        "RL-CLF-QP keeps |F_T/F_N| <= 0.8 in all steps; IO-RL + CLF-QP exceeds it in the first two."
    )
    plant: ClassVar = {"mass_scale": 2.0}

    def claims(self, found: Found) -> Sequence[Claim]:
        """Who walks, and who keeps the cone."""
        nominal, learned = found.walks(self.by_contender[CLF]), found.walks(self.by_contender[RL_CLF])
        over = learned.total("ticks_over_cone")
        return [
            *self.walking_claims(found),
            Claim(
                claim="the nominal CLF-QP fails",
                paper="fails",
                ours=nominal.text,
                verdict=judge({"fails": not nominal.passes}),
            ),
            Claim(
                claim="RL-CLF-QP keeps the friction cone",
                paper="|F_T/F_N| <= 0.8 in all steps",
                ours=f"{over} of {learned.total('ticks')} ticks over, largest {learned.max_ratio:.2f}",
                verdict=judge({"never over": over == 0}),
            ),
            self._first_steps(found),
        ]

    def _first_steps(self, found: Found) -> Claim:
        """IO-RL in the figure's own walk."""
        walk = found.records(self.by_contender[IO_RL])
        limit = float(walk.about["friction_coeff"])
        late, impact = (ratio > limit for ratio in force_ratio(walk))
        early = walk.step_index < EARLY
        there, at_impact, after = ((late & early).sum(), (impact & early).sum(), (late & ~early).sum())
        leaves = bool(there + at_impact)
        return Claim(
            claim="IO-RL + CLF-QP leaves the cone in its first two steps",
            paper="exceeds 0.8 in the first two steps, not later",
            ours=f"first run: {there} ticks over there and {at_impact} within 30 ms of an impact; {after} later",
            verdict=judge({"leaves it there": leaves, "and only there": leaves and after == 0}),
        )

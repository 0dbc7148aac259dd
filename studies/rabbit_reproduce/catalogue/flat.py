"""Ten steps on flat ground: tracking errors, force ratios [fig:clf-results], [fig:clf-torso-results]."""

from functools import cached_property
from typing import Any

from matplotlib.figure import Figure

from rabbit_reproduce.controllers import CLF, FLAT, IO_RL, L1_CLF, RL_CLF, Contender
from rabbit_reproduce.curves import late_and_impact_ratio, tracking_figure
from rabbit_reproduce.experiment import Experiment, forces_kept
from rabbit_reproduce.report import Claim
from rabbit_reproduce.table_lines import HEADLINE, MAIN, Line, Results

STEPS = 10
AGAIN = 2  # ticks over the cone in a run, on average, that count as several steps
EARLY = 2  # steps in which the paper's IO-RL leaves the cone
WITH_ROWS = "force rows"  # that the paper proposes


class TenSteps(Experiment):
    """`plant` has what is wrong with the model."""

    shown = FLAT
    plant: dict[str, Any]

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        return {who: Line(who.title, who.assembly(stones=STEPS, **self.plant), runs=HEADLINE) for who in FLAT}

    def figures(self, results: Results) -> dict[str, Figure]:
        walks: dict[Contender, Any] = {contender: results.records(self.by_key[contender]) for contender in FLAT}
        return {"tracking": tracking_figure(walks)}

    def claims(self, results: Results) -> list[Claim]:
        """The learned ones walk, the nominal one does not."""
        walks, tuned = self.walks(results), self.at_best(results, self.by_key[CLF])
        nominal, words = walks[CLF], {"title": f"{self.title[0].lower()}{self.title[1:]}"}
        claims = []
        for contender in (RL_CLF, IO_RL):
            ours, parts = f"{walks[contender].text}; nominal {nominal.text}", {"walks": walks[contender].passes}
            claims.append(self.claim("walks", ours, parts, nominal.passes, tuned, who=contender.title, **words))
        return claims


class ClfResults(TenSteps):
    """Ten steps, and which controller keeps the friction cone without a row for it."""

    name = "clf-results"

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        tuning = {"flat_force_rows": True}
        with_rows = {
            (who, WITH_ROWS): Line(f"{who.title}, {WITH_ROWS}", who.assembly(tuning, stones=STEPS, **self.plant))
            for who in (RL_CLF, IO_RL)
        }
        return super().by_key | with_rows

    def claims(self, results: Results) -> list[Claim]:
        """Who walks, and who keeps the cone."""
        walks = self.walks(results)
        learned, l1, bare, kept = (walks[key] for key in (RL_CLF, L1_CLF, IO_RL, (IO_RL, WITH_ROWS)))
        over, over_l1, over_bare, over_kept = (w.total("ticks_over_cone") for w in (learned, l1, bare, kept))
        claims, tuned = super().claims(results), self.at_best(results, self.by_key[CLF])
        for contender in (L1_CLF, CLF):
            ours, parts = walks[contender].text, {"fails": not walks[contender].passes}
            beside = tuned if contender is CLF else ("-", False)
            claims.append(self.claim("fails", ours, parts, tuned=beside, who=contender.title))
        ours = f"{over} of {learned.total('ticks')} ticks over, largest {learned.max_ratio:.2f}"
        claims.append(self.claim("cone", ours, {"never over": over == 0}, tuned=forces_kept(tuned)))
        if results.column is MAIN:
            claims.append(self._first_steps(results))
        ours = f"{over_l1} of {l1.total('ticks')} ticks over, largest {l1.max_ratio:.2f}"
        claims.append(self.claim("l1", ours, {"several a run": over_l1 >= AGAIN * l1.runs}))
        ours = f"without: {over_bare} ticks over; with: {kept.text}, {over_kept} of {kept.total('ticks')} over"
        parts = {"leaves it without": over_bare > 0, "keeps it with": kept.passes and over_kept == 0}
        return [*claims, self.claim("rows", ours, parts)]

    def _first_steps(self, results: Results) -> Claim:
        """IO-RL in the figure's own walk."""
        walk = results.records(self.by_key[IO_RL])
        limit = float(walk.about["friction_coeff"])
        late, impact = (ratio > limit for ratio in late_and_impact_ratio(walk))
        early = walk.step_index < EARLY
        there, at_impact, after = ((late & early).sum(), (impact & early).sum(), (late & ~early).sum())
        leaves = bool(there + at_impact)
        ours = f"first run: {there} ticks over there and {at_impact} within 30 ms of an impact; {after} later"
        return self.claim("first steps", ours, {"leaves it there": leaves, "and only there": leaves and after == 0})

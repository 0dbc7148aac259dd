"""20 stones at twice the mass: swing foot against l_min and l_max, force ratio [fig:rl-cbf-clf-results]."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from matplotlib.figure import Figure
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.walk_records import WalkRecords
from rabbit_viewer import style
from rabbit_viewer.pictures import plot_steps, plot_stones, swing_foot

from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE, RL_CBF_CLF, ROBUST, Contender
from rabbit_reproduce.curves import WIDTH, finish_ratio, late_and_impact_ratio
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim, judge
from rabbit_reproduce.table_lines import HEADLINE, Found, Line

CAPTION = (
    "First run of RL-CBF-CLF-QP over 20 stones at mass scale 2. Top: swing foot against the stones' edges; dots are "
    "landings. Bottom: force ratio; dots are within 30 ms of an impact."
)


class RlCbfClfResults(Experiment):
    """The paper's main result; nominal controller and oracle beside."""

    name = "rl-cbf-clf-results"
    title = "20 stones at twice the mass"
    label = "fig:rl-cbf-clf-results"
    paper = "The foot placement is always on the stones, and the contact force never exceeds the friction limit of 0.8."
    judged_on_rigid = True

    @cached_property
    def by_contender(self) -> dict[Contender, Line]:
        """A line each."""
        each_paper = {RL_CBF_CLF: "20 of 20 stones, once", CBF_CLF: "5.6 stones", ROBUST: "", CBF_CLF_ORACLE: ""}
        return {
            each: Line(each.title, each.assembly(mass_scale=2.0), paper, HEADLINE) for each, paper in each_paper.items()
        }

    def lines(self) -> Sequence[Line]:
        return list(self.by_contender.values())

    def recorded(self) -> Sequence[Line]:
        return [self.by_contender[RL_CBF_CLF]]

    def figures(self, found: Found) -> dict[str, tuple[str, Figure]]:
        return {"swing_foot": (CAPTION, swing_foot_figure(found.records(self.by_contender[RL_CBF_CLF])))}

    def claims(self, found: Found) -> Sequence[Claim]:
        """Stones and forces, over all runs."""
        learned, nominal = (found.walks(self.by_contender[each]) for each in (RL_CBF_CLF, CBF_CLF))
        over, at_impact = learned.total("ticks_over_cone"), learned.total("ticks_over_cone_at_impact")
        clean = nominal.total("ticks_over_cone") == 0
        return [
            Claim(
                claim="RL-CBF-CLF-QP walks 20 stones at scale 2, the foot always on the stone",
                paper="always, in one walk",
                ours=f"{learned.text} stones; nominal {nominal.text}",
                verdict=judge({"walks": learned.passes}, nominal.passes),
            ),
            Claim(
                claim="its contact force never exceeds the friction limit",
                paper="|F_T/F_N| <= 0.8",
                ours=f"{over} of {learned.total('ticks')} ticks over, {at_impact} more within 30 ms of an impact; "
                f"largest ratio {learned.max_ratio:.2f}",
                verdict=judge({"never over": over == 0}, nominal.passes and clean),
            ),
        ]


def swing_foot_figure(walk: WalkRecords) -> Figure:
    """The paper's two panels over time."""
    figure, (length, ratio) = style.figure(2, height=2.0, width=WIDTH)
    plot_stones(walk, length)
    plot_steps(walk, length, swing_foot(walk)[:, 0], style.BLUE, "swing foot $l_f$")
    seconds = walk.landings[:, 1] * TICK_SECONDS
    length.plot(seconds, walk.landings[:, 2], "o", color=style.BLACK, markersize=3, label="landing")
    length.set_ylabel("$l_f$ (m)")
    style.legend(length)
    late, impact = late_and_impact_ratio(walk)
    ratio.plot(walk.time, late, color=style.BLUE, linewidth=1)
    ratio.plot(walk.time, impact, ".", color=style.BLUE, markersize=2, alpha=0.5)
    finish_ratio(ratio, walk)
    end = float(np.max(seconds, initial=walk.time[-1]))
    ratio.set(ylabel=r"$|F_T / F_N|$", xlabel="time (s)", xlim=(0, 1.01 * end))
    figure.align_ylabels()
    return figure

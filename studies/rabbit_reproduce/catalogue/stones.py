"""Over stones at twice the mass: swing foot and force ratio [fig:rl-cbf-clf-results], the grey area in which the foot
stays during the whole step [fig:stepping-stone], and the nominal controller [sec:results, Simulation 2]."""

from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from rabbit_description.state import TICK_SECONDS, Array
from rabbit_experiments.evaluation import SeededRun
from rabbit_experiments.summary import Walks
from rabbit_experiments.walk_records import WalkRecords
from rabbit_viewer import style
from rabbit_viewer.geometry import allowed_area
from rabbit_viewer.pictures import plot_steps, plot_stones, swing_foot

from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE, RL_CBF_CLF, ROBUST
from rabbit_reproduce.curves import finish_ratio, late_and_impact_ratio
from rabbit_reproduce.experiment import Experiment, forces_kept
from rabbit_reproduce.report import Claim
from rabbit_reproduce.table_lines import HEADLINE, Line, Results, Runs, Size

SHOWN = 3  # steps of the grey area: with the nearest stone, the middle one, the farthest
DEPTH, TOP = 0.02, 0.15  # m, of a drawn stone, and of the panel
PAPER_RUNS = Runs(10, 10)
PAPER_INTERVAL = (2.28, 8.92)  # Student's 95%, of the paper's mean
AGAIN = 2  # violations in each run, on average, that count as "repeatedly"


class RlCbfClfResults(Experiment):
    """The paper's main result; nominal controller and oracle beside."""

    name = "rl-cbf-clf-results"
    shown = (RL_CBF_CLF,)

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        each_paper = {RL_CBF_CLF: "20 of 20 stones, once", CBF_CLF: "5.6 stones", ROBUST: "", CBF_CLF_ORACLE: ""}
        return {
            who: Line(who.title, who.assembly(mass_scale=2.0), paper, HEADLINE) for who, paper in each_paper.items()
        }

    def figures(self, results: Results) -> dict[str, Figure]:
        return {"swing_foot": swing_foot_figure(results.records(self.by_key[RL_CBF_CLF]))}

    def claims(self, results: Results) -> list[Claim]:
        """Stones and forces, over all runs."""
        walks = self.walks(results)
        learned, nominal = walks[RL_CBF_CLF], walks[CBF_CLF]
        over, at_impact = learned.total("ticks_over_cone"), learned.total("ticks_over_cone_at_impact")
        clean = nominal.total("ticks_over_cone") == 0
        stones = f"{learned.text} stones; nominal {nominal.text}"
        forces = (
            f"{over} of {learned.total('ticks')} ticks over, {at_impact} more within 30 ms of an impact; "
            f"largest ratio {learned.max_ratio:.2f}"
        )
        tuned = self.at_best(results, self.by_key[CBF_CLF])
        return [
            self.claim("stones", stones, {"walks": learned.passes}, nominal.passes, tuned),
            self.claim("cone", forces, {"never over": over == 0}, nominal.passes and clean, forces_kept(tuned)),
        ]


class SteppingStone(Experiment):
    """The swing foot in the walk of [fig:rl-cbf-clf-results]."""

    name = "stepping-stone"
    shown = (RL_CBF_CLF,)

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        return {RL_CBF_CLF: Line(RL_CBF_CLF.title, RL_CBF_CLF.assembly(mass_scale=2.0), runs=HEADLINE)}

    def figures(self, results: Results) -> dict[str, Figure]:
        return {"grey_area": grey_area_figure(results.records(self.by_key[RL_CBF_CLF]))}

    def claims(self, results: Results) -> list[Claim]:
        """Both barriers with the stone's true edges, at every tick of the first run."""
        learned, tuned = (results.records(line) for line in self.lines())
        (ours, always), (text, tuned_always) = map(left_area, (learned, tuned))
        undone = tuned_always and tuned.about["outcome"] == "walked"
        return [self.claim("area", ours, {"always": always}, tuned=(text, undone))]

    def jobs(self, size: Size) -> list[SeededRun]:
        return [line.scenario(size).recorded for line in self.lines()] + super().jobs(size)


class NominalStones(Experiment):
    """The paper does not say at which scale the force rows were left out: scale 2, as everything there, and 1."""

    name = "nominal-stones"

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        """The lines with all rows, and without force rows."""
        all_rows = CBF_CLF.assembly(mass_scale=2.0)
        lines = {"whole": Line(f"{CBF_CLF.title}, scale 2", all_rows, "5.6 +- 4.64 stones", PAPER_RUNS)}
        for who, scale in ((CBF_CLF, 2.0), (CBF_CLF, 1.0), (RL_CBF_CLF, 2.0)):
            what = f"{who.title}, no force rows, scale {scale:g}"
            lines[what] = Line(what, who.assembly({"force_rows": False}, mass_scale=scale), "", PAPER_RUNS)
        return lines

    def claims(self, results: Results) -> list[Claim]:
        """How far, and the two forces."""
        walks = self.walks(results)
        bare = f"{CBF_CLF.title}, no force rows, scale 2"
        whole, without = walks["whole"], walks[bare]
        best, best_bare = (self.at_best(results, self.by_key[key]) for key in ("whole", bare))
        low, high = whole.stones_interval or (whole.mean_stones,) * 2
        alike = low <= PAPER_INTERVAL[1] and high >= PAPER_INTERVAL[0]
        far = (
            f"{whole.mean_stones:.2f} +- {whole.std_stones or 0:.2f} ({low:.2f} to {high:.2f}), "
            f"{whole.walked} of {whole.runs} courses walked"
        )
        leaves = {"leaves them": not whole.passes, "intervals of the means overlap": alike}
        (forces, repeatedly), (forces_at_best, again) = map(violations, (without, best_bare))
        return [
            self.claim("leaves", far, leaves, tuned=best),
            self.claim("forces", forces, repeatedly, tuned=(forces_at_best, not any(again.values()))),
        ]


def violations(walks: Walks) -> tuple[str, dict[str, bool]]:
    """Violations of cone and unilateral force, in words, and of which there are some in each run."""
    over, lost = walks.total("ticks_over_cone"), walks.total("ticks_lost")
    text = f"{over} ticks over the cone, {lost} without a push from the ground, in {walks.runs} runs"
    return text, {"cone": over >= AGAIN * walks.runs, "unilateral": lost >= AGAIN * walks.runs}


def swing_foot_figure(walk: WalkRecords) -> Figure:
    """The paper's two panels over time."""
    figure, (length, ratio) = style.figure(2, height=2.0)
    plot_stones(walk, length)
    plot_steps(walk, length, swing_foot(walk)[:, 0], style.BLUE, "swing foot $l_f$")
    seconds = walk.landings[:, 1] * TICK_SECONDS
    length.plot(seconds, walk.landings[:, 2], "o", color=style.BLACK, markersize=3, label="landing")
    length.set_ylabel("$l_f$ (m)")
    style.legend(length)
    late, impact = late_and_impact_ratio(walk)
    ratio.plot(walk.time, late, color=style.BLUE)
    ratio.plot(walk.time, impact, ".", color=style.BLUE, markersize=2, alpha=0.5)
    finish_ratio(ratio, walk)
    end = float(np.max(seconds, initial=walk.time[-1]))
    ratio.set(ylabel=r"$|F_T / F_N|$", xlabel="time (s)", xlim=(0, 1.01 * end))
    figure.align_ylabels()
    return figure


def barriers(walk: WalkRecords) -> Array:
    """B1 and B2 for the stones' own edges, no margin, (n, 2), m."""
    (length, height), (near, far) = swing_foot(walk).T, walk.preview.T
    R1, R2 = float(walk.about["R1"]), float(walk.about["R2"])
    outer = R1 + far - np.hypot(R1 + length, height)
    inner = np.hypot(length - near / 2, height + R2) - np.hypot(near / 2, R2)
    return np.stack([outer, inner], axis=1)


def left_area(walk: WalkRecords) -> tuple[str, bool]:
    """How far the swing foot leaves the grey area, in words, and whether it never does."""
    least = barriers(walk).min(axis=1)
    steps = {int(step) for step in walk.step_index[least < 0]}
    text = (
        f"first run: outside in {(least < 0).sum()} of {len(least)} ticks, in {len(steps)} of "
        f"{walk.step_index[-1] + 1} steps, by {max(0.0, -least.min()) * 1e3:.1f} mm at most"
    )
    return text, not steps


def grey_area_figure(walk: WalkRecords) -> Figure:
    """A panel a step."""
    steps = np.unique(walk.step_index[walk.step_index < len(walk.landings)])
    first = np.array([np.flatnonzero(walk.step_index == step)[0] for step in steps])
    by_edge = first[np.argsort(walk.preview[first, 0])]
    chosen = by_edge[np.linspace(0, len(by_edge) - 1, min(SHOWN, len(by_edge))).round().astype(int)]
    figure, panels = style.figure(len(chosen), height=1.5)
    foot = swing_foot(walk)
    for axes, row in zip(panels, chosen.tolist(), strict=True):
        near, far = walk.preview[row].tolist()
        half = (far - near) / 2
        area = allowed_area(near, far, float(walk.about["R1"]), float(walk.about["R2"]))
        axes.add_patch(Polygon(area.tolist(), facecolor=style.AREA, linewidth=0, label="grey area"))
        for left in (-half, near):
            axes.add_patch(Rectangle((left, -DEPTH), 2 * half, DEPTH, color=style.STONE, linewidth=0))
        step = walk.step_index == walk.step_index[row]
        axes.plot(*foot[step].T, color=style.BLUE, label="swing foot $F$")
        axes.plot(walk.landings[walk.step_index[row], 2], 0.0, "o", color=style.BLUE, markersize=4, label="landing")
        for edge, name in ((near, "$l_{min}$"), (far, "$l_{max}$")):
            axes.axvline(edge, color=style.RED, linestyle="--", linewidth=0.8)
            aside, end = (-3, "right") if edge == near else (3, "left")
            axes.annotate(name, (edge, 0.96 * TOP), (aside, 0), textcoords="offset points", va="top", ha=end)
        axes.set(ylabel="$h_f$ (m)", ylim=(-DEPTH, TOP), xlim=(-0.45, 0.55))
        axes.set_title(f"stone {walk.step_index[row] + 1}: $l_{{min}}$ = {near:.3f} m", loc="right", fontsize="medium")
        axes.grid(visible=False)
    style.legend(panels[0])
    panels[-1].set_xlabel("from the stance foot (m)")
    return figure

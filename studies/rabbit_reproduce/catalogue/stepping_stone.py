"""The stones and the grey area in which the swing foot stays during the whole step [fig:stepping-stone]."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from rabbit_description.state import Array
from rabbit_experiments.walk_records import WalkRecords
from rabbit_viewer import style
from rabbit_viewer.geometry import allowed_area
from rabbit_viewer.pictures import swing_foot

from rabbit_reproduce.controllers import RL_CBF_CLF
from rabbit_reproduce.curves import WIDTH
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim, judge
from rabbit_reproduce.table_lines import HEADLINE, Found, Line

SHOWN = 3  # steps: with the nearest stone, the middle one, the farthest
DEPTH, TOP = 0.02, 0.15  # m, of a drawn stone, and of the panel
CAPTION = (
    "Stance foot at 0, the next stone, and the grey area that both barriers allow, with the swing foot's path: the "
    "steps with the nearest, the middle and the farthest stone of the first run (RL-CBF-CLF-QP, mass scale 2)."
)


class SteppingStone(Experiment):
    """In the walk of [fig:rl-cbf-clf-results]."""

    name = "stepping-stone"
    title = "Stones and grey area"
    label = "fig:stepping-stone"
    paper = (
        "Two barriers keep the swing foot within the grey area during the entire step, so that it lands on the stone."
    )

    @cached_property
    def line(self) -> Line:
        """What walks."""
        return Line(RL_CBF_CLF.title, RL_CBF_CLF.assembly(mass_scale=2.0), runs=HEADLINE)

    def lines(self) -> Sequence[Line]:
        return [self.line]

    def recorded(self) -> Sequence[Line]:
        return [self.line]

    def figures(self, found: Found) -> dict[str, tuple[str, Figure]]:
        return {"grey_area": (CAPTION, grey_area_figure(found.records(self.line)))}

    def claims(self, found: Found) -> Sequence[Claim]:
        """Both barriers with the stone's true edges, at every tick of the first run."""
        walk = found.records(self.line)
        least = barriers(walk).min(axis=1)
        steps = {int(step) for step in walk.step_index[least < 0]}
        return [
            Claim(
                claim="the swing foot stays in the grey area during the entire step",
                paper="always",
                ours=f"first run: outside in {(least < 0).sum()} of {len(least)} ticks, in {len(steps)} of "
                f"{walk.step_index[-1] + 1} steps, by {max(0.0, -least.min()) * 1e3:.1f} mm at most",
                verdict=judge({"always": not steps}),
            )
        ]


def barriers(walk: WalkRecords) -> Array:
    """B1 and B2 for the stones' own edges, no margin, (n, 2), m."""
    (length, height), (near, far) = swing_foot(walk).T, walk.preview.T
    R1, R2 = float(walk.about["R1"]), float(walk.about["R2"])
    outer = R1 + far - np.hypot(R1 + length, height)
    inner = np.hypot(length - near / 2, height + R2) - np.hypot(near / 2, R2)
    return np.stack([outer, inner], axis=1)


def grey_area_figure(walk: WalkRecords) -> Figure:
    """A panel a step."""
    steps = np.unique(walk.step_index[walk.step_index < len(walk.landings)])
    first = np.array([np.flatnonzero(walk.step_index == step)[0] for step in steps])
    by_edge = first[np.argsort(walk.preview[first, 0])]
    chosen = by_edge[np.linspace(0, len(by_edge) - 1, min(SHOWN, len(by_edge))).round().astype(int)]
    figure, panels = style.figure(len(chosen), height=1.5, width=WIDTH)
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
            axes.annotate(name, (edge, 0.96 * TOP), ha="right" if edge == near else "left", va="top")
        axes.set(ylabel="$h_f$ (m)", ylim=(-DEPTH, TOP), xlim=(-0.45, 0.55))
        axes.set_title(f"stone {walk.step_index[row] + 1}: $l_{{min}}$ = {near:.3f} m", loc="right", fontsize=9)
        axes.grid(visible=False)
    style.legend(panels[0])
    panels[-1].set_xlabel("from the stance foot (m)")
    return figure

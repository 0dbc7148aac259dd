"""Curves of the paper's figures: errors and force ratio over time, and rates over a parameter."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rabbit_description.force_ratio import force_ratio, impact_ticks
from rabbit_description.state import JOINTS, Array
from rabbit_experiments.summary import Walks, wilson
from rabbit_experiments.walk_records import WalkRecords
from rabbit_viewer import style

from rabbit_reproduce.controllers import Contender

RATIO_TOP = (1.0, 2.0)  # of the panel, at least and at most
PANELS = (r"$\|y\|$ (rad)", r"$\|\dot y\|$ (rad/s)", r"$|F_T / F_N|$")


def late_and_impact_ratio(walk: WalkRecords) -> tuple[Array, Array]:
    """|F_T| / F_N of the stance foot, (n,), more than 30 ms after an impact and within; NaN elsewhere and unloaded."""
    ratio = force_ratio(walk.stance_force)
    starts = walk.tick[walk.step_starts]
    age = walk.tick - starts[np.searchsorted(starts, walk.tick, side="right") - 1]
    late = age >= impact_ticks(walk.tick_seconds)
    return np.where(late, ratio, np.nan), np.where(late, np.nan, ratio)


def tracking_figure(walks: Mapping[Contender, WalkRecords]) -> Figure:
    """Tracking error, its derivative and force ratio over time, a curve a controller; a cross where it ended badly."""
    figure, panels = style.figure(len(PANELS), height=1.9)
    for contender, walk in walks.items():
        look: dict[str, Any] = {"color": contender.colour, "linestyle": contender.line}
        late, impact = late_and_impact_ratio(walk)
        y, dy = (np.linalg.norm(part, axis=1) for part in (walk.eta[:, :JOINTS], walk.eta[:, JOINTS:]))
        for axes, values in zip(panels, (y, dy, late), strict=True):
            axes.plot(walk.time, values, label=contender.title if axes is panels[0] else None, **look)
        panels[2].plot(walk.time, impact, ".", color=contender.colour, markersize=2, alpha=0.5)
        if walk.about["outcome"] != "walked":
            for axes, values in zip(panels[:2], (y, dy), strict=True):
                axes.plot(walk.time[-1], values[-1], "x", color=contender.colour, markersize=7, clip_on=False)
    finish_ratio(panels[2], next(iter(walks.values())))
    for axes, label in zip(panels, PANELS, strict=True):
        axes.set_ylabel(label)
    for axes in panels[:2]:
        axes.set_ylim(bottom=0)
    style.legend(panels[0])
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_xlim(0, max(len(walk.tick) * walk.tick_seconds for walk in walks.values()))
    figure.align_ylabels(panels)
    return figure


def finish_ratio(axes: Axes, walk: WalkRecords) -> None:
    """Limit and range of a panel of force ratios."""
    limit = float(walk.about["friction_coeff"])
    style.limit(axes, limit, f"$k_f$ = {limit:g}")
    axes.set_ylim(0, 1.05 * float(np.clip(axes.dataLim.y1, *RATIO_TOP)))
    style.legend(axes)


def rate_figure(
    values: Sequence[float],
    walks: Mapping[Contender, Sequence[Walks]],
    label: str,
    scale: float = 1.0,
    marks: Sequence[tuple[Contender, float]] = (),
) -> Figure:
    """Share of runs that walked over a parameter, with Wilson's 95% interval; `scale` brings it to the label's unit.

    `marks`: values that the paper names, each a vertical line in its controller's colour.
    """
    figure, (axes,) = style.figure(1, height=3.2)
    draw_rates(axes, values, walks, scale)
    for contender, value in marks:
        is_first = contender not in [named for named, other in marks if other < value]
        said = f"paper: {contender.title}" if is_first else None
        axes.axvline(value * scale, color=contender.colour, linewidth=3, alpha=0.25, label=said)
    axes.set_xlabel(label)
    style.legend(axes, columns=3)
    return figure


def draw_rates(
    axes: Axes, values: Sequence[float], walks: Mapping[Contender, Sequence[Walks]], scale: float = 1.0
) -> None:
    """A curve a controller, with its intervals."""
    x = np.array(values) * scale
    shift = 0.008 * float(np.ptp(x))  # beside one another, where they would hide each other
    for i, (contender, row) in enumerate(walks.items()):
        at = x + shift * (i - (len(walks) - 1) / 2)
        rate = np.array([walks.walked / walks.runs for walks in row])
        ends = np.array([wilson(walks.walked, walks.runs) for walks in row]).T
        bars = np.abs(ends - rate)
        look: dict[str, Any] = {"color": contender.colour, "linestyle": contender.line, "marker": "o"}
        axes.plot(at, rate, markersize=4, label=contender.title, **look)
        axes.errorbar(at, rate, yerr=bars, fmt="none", ecolor=contender.colour, elinewidth=0.8, alpha=0.45)
    axes.set(ylabel="courses walked", ylim=(-0.03, 1.03))

"""Pictures of one walk: the robot, swing foot against stones, barriers, CLF, ground force, torques."""

from itertools import cycle, pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rabbit_description.force_ratio import force_ratio
from rabbit_description.state import Array
from rabbit_experiments.walk_records import RESCUE_NEEDED, WalkRecords

from rabbit_viewer import style
from rabbit_viewer.filmstrip import draw_walk
from rabbit_viewer.geometry import legs_of

IMPACT = 0.04  # s: a mean over a tick that begins within 30 ms of impact
MILLIMETRES = 1e3  # in a metre
FAR_OFF = 50.0  # mm from a stone, drawn no farther
NAMES = ("hip, stance leg", "knee, stance leg", "hip, swing leg", "knee, swing leg")
BARRIER_COLOURS = style.BLUE, style.ORANGE, style.GREEN, style.PURPLE
BARRIER_LABELS = {"B1": "B1 (m): before the far edge", "B2": "B2 (m): past the near edge"}


def draw(walk: WalkRecords, out: Path, suffix: str = ".png") -> list[Path]:
    """All pictures of a walk; returns their paths. CLF, barriers and quantities are drawn where there are some."""
    pictures = [draw_walk, draw_swing_foot, draw_forces, draw_torques]
    if np.isfinite(walk.V).any():
        pictures.insert(2, draw_clf)
    if np.isfinite(walk.barriers).any():
        pictures.insert(2, draw_barriers)
    if np.isfinite(walk.measured).any():
        pictures.append(draw_quantities)
    with style.look():
        return [picture(walk, out / f"{picture.__name__.removeprefix('draw_')}{suffix}") for picture in pictures]


def draw_swing_foot(walk: WalkRecords, path: Path) -> Path:
    """l_f over time against each step's l_min and l_max, its height, and where on its stone each landing was."""
    position, on_stones = swing_foot(walk), bool(np.isfinite(walk.preview).any())
    figure, (length, height, *landing) = style.figure(3 if on_stones else 2, height=2.1)
    plot_steps(walk, length, position[:, 0], style.BLUE, "swing foot l_f")
    plot_steps(walk, height, position[:, 1], style.BLUE, "")
    if landing:
        plot_stones(walk, length)
        _draw_landings(walk, *landing)
    length.set_ylabel("l_f (m)")
    height.set_ylabel("h_f (m)")
    style.legend(length)
    return _finish(walk, figure, path)


def draw_barriers(walk: WalkRecords, path: Path) -> Path:
    """All barriers; whole, and near zero."""
    figure, panels = style.figure(2)
    for axes, label in zip(panels, ("barrier B", "near zero"), strict=True):
        for name, B, colour in zip(walk.barrier_names, walk.barriers.T, cycle(BARRIER_COLOURS)):
            plot_steps(walk, axes, B, colour, BARRIER_LABELS.get(name, name))
        style.limit(axes, 0.0, "limit")
        axes.set_ylabel(label)
    panels[1].set_ylim(-0.02, 0.06)
    style.legend(panels[0])
    return _finish(walk, figure, path)


def draw_clf(walk: WalkRecords, path: Path) -> Path:
    """V, and the slacks that were used, if any."""
    slacks = (
        (walk.clf_slack, 0.0, style.GREEN, "d, of the CLF row"),
        (walk.rescue_slack, RESCUE_NEEDED, style.RED, "of last resort"),
    )
    used = [slack for slack in slacks if (slack[0] > slack[1]).any()]
    figure, panels = style.figure(2 if used else 1)
    plot_steps(walk, panels[0], walk.V, style.BLUE, "")
    panels[0].set_ylabel("CLF V (rad²/s²)")
    for values, least, colour, label in used:
        needed = np.where(values > least, values, np.nan)
        panels[1].plot(walk.time, needed, ".-", markersize=3, color=colour, label=label)
        panels[1].set_ylabel("slack (rad/s²)")
        style.legend(panels[1])
    for axes in panels:
        axes.set_yscale("log")
    return _finish(walk, figure, path)


def draw_forces(walk: WalkRecords, path: Path) -> Path:
    """Friction ratio against the cone, and the stance foot's forces."""
    tangential, normal = walk.stance_force.T
    ratio = force_ratio(walk.stance_force)
    figure, (cone, force) = style.figure(2)
    for i, start in enumerate(walk.time[walk.step_starts[1:]] - walk.tick_seconds):
        for axes in (cone, force):
            label = None if i else "30 ms after impact"
            axes.axvspan(start, start + IMPACT, color=style.AREA, linewidth=0, label=label)
    cone.plot(walk.time, ratio, color=style.BLUE, label="|F_T| / F_N")
    style.limit(cone, float(walk.about.get("friction_coeff", 0.8)), "friction cone")
    cone.set_ylim(0, max(1.0, float(np.nanmax(ratio, initial=0))) * 1.05)
    cone.set_ylabel("force ratio (1)")
    force.plot(walk.time, normal, color=style.BLACK, label="F_N")
    force.plot(walk.time, tangential, color=style.ORANGE, label="F_T")
    force.set_ylabel("ground force (N)")
    style.legend(cone)
    style.legend(force)
    return _finish(walk, figure, path)


def draw_torques(walk: WalkRecords, path: Path) -> Path:
    """The four joint torques, by what their leg does, and their limit."""
    figure, panels = style.figure(2)
    torque = np.where(walk.stance[:, None] == 1, walk.torque[:, [2, 3, 0, 1]], walk.torque)
    limit = float(walk.about.get("torque_limit", 200.0))
    for axes, columns in zip(panels, ((0, 1), (2, 3)), strict=True):
        for column, colour in zip(columns, (style.BLUE, style.ORANGE), strict=True):
            axes.step(walk.time, torque[:, column], where="post", color=colour, label=NAMES[column])
        style.limit(axes, limit, "limit")
        axes.axhline(-limit, color=style.RED, linestyle="--", linewidth=1)
        axes.set_ylabel("torque (N m)")
        style.legend(axes)
    return _finish(walk, figure, path)


def draw_quantities(walk: WalkRecords, path: Path) -> Path:
    """Each quantity over a tick: measured, by the nominal model, and with the estimates."""
    names = walk.about.get("quantities", [f"quantity {i + 1}" for i in range(walk.nominal_b.shape[1])])
    figure, panels = style.figure(len(names), height=1.8)
    nominal = np.einsum("tij,tj->ti", walk.nominal_a, walk.mu) + walk.nominal_b
    estimated = nominal + np.einsum("tij,tj->ti", walk.alpha, walk.mu) + walk.beta
    measured = np.vstack([walk.measured[1:], np.full_like(walk.measured[:1], np.nan)])  # published a tick later
    for i, (axes, name) in enumerate(zip(panels, names, strict=True)):
        axes.plot(walk.time, measured[:, i], ".", markersize=3, color=style.BLACK, label="measured")
        plot_steps(walk, axes, nominal[:, i], style.ORANGE, "nominal model")
        plot_steps(walk, axes, estimated[:, i], style.BLUE, "with the estimates")
        low, high = np.nanpercentile(np.concatenate([measured[:, i], estimated[:, i]]), (1, 99))
        axes.set_ylim(low - 0.3 * (high - low), high + 0.3 * (high - low))
        axes.set_ylabel(name)
    style.legend(panels[0])
    return _finish(walk, figure, path)


def swing_foot(walk: WalkRecords) -> Array:
    """l_f and h_f, the swing foot from the stance foot, (n, 2), m."""
    both, row = legs_of(walk)[:, :, 2], np.arange(len(walk.tick))
    return both[1 - walk.stance, row] - both[walk.stance, row]


def plot_steps(walk: WalkRecords, axes: Axes, values: Array, colour: str, label: str) -> None:
    """A line that is broken where the legs swap."""
    time, broken = (np.insert(line.astype(float), walk.step_starts[1:], np.nan) for line in (walk.time, values))
    axes.plot(time, broken, color=colour, label=label)


def plot_stones(walk: WalkRecords, axes: Axes) -> None:
    """Each step's l_min and l_max over its time."""
    for first, last in pairwise([*walk.step_starts.tolist(), len(walk.tick)]):
        time, edges = walk.time[first:last], walk.preview[first:last]
        axes.fill_between(time, *edges.T, color=style.AREA, linewidth=0)
        label = "" if first else "$l_{min}$, $l_{max}$"
        axes.plot(time, edges[:, 0], color=style.RED, linestyle="--", linewidth=1, label=label)
        axes.plot(time, edges[:, 1], color=style.RED, linestyle="--", linewidth=1)


def _draw_landings(walk: WalkRecords, axes: Axes) -> None:
    """Each landing's place on its stone, past the near edge; one that is far off is drawn at the panel's end."""
    _, tick, length, near, far, on_stone = walk.landings.T
    time, missed = tick * walk.tick_seconds, (length < near) | (length > far) | (on_stone == 0)
    width = (far - near) * MILLIMETRES
    place = np.clip((length - near) * MILLIMETRES, -FAR_OFF, width + FAR_OFF)
    axes.bar(time, width, width=0.01 * _end(walk), color=style.AREA, label="stone")
    for chosen, marker, colour, label in ((~missed, "o", style.GREEN, "landed"), (missed, "X", style.PURPLE, "missed")):
        if chosen.any():
            axes.plot(time[chosen], place[chosen], marker, color=colour, label=label, markersize=5, clip_on=False)
    axes.set_ylabel("past near edge (mm)")
    if len(time):
        style.legend(axes)


def _end(walk: WalkRecords) -> float:
    """Seconds to be shown."""
    landed: float = walk.landings[:, 1].max(initial=0) * walk.tick_seconds
    return max(float(walk.time[-1]), landed, walk.tick_seconds)


def _finish(walk: WalkRecords, figure: Figure, path: Path) -> Path:
    figure.axes[-1].set(xlabel="time (s)", xlim=(0, 1.02 * _end(walk)))
    figure.suptitle(str(walk.about.get("title", "")), fontsize=10)
    return style.save(figure, path)

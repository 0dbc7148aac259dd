"""Pictures of one walk: the robot, swing foot against stones, barriers, CLF, ground force, torques."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from rabbit_description.force_ratio import force_ratio
from rabbit_description.state import ACTUATED, Array
from rabbit_experiments.walk_records import WalkRecords

from rabbit_viewer import style
from rabbit_viewer.geometry import legs_of
from rabbit_viewer.panels import LOG, Panel, draw_panels
from rabbit_viewer.scene import SIZE, Scene

IMPACT = 0.03  # s, in which the ground's force is an impact's
MILLIMETRES = 1e3  # in a metre
STILLS = 3
FAR_OFF = 50.0  # mm from a stone, drawn no farther
NEAR_ZERO = {"value": "symlog", "linthresh": 0.01}  # a scale that shows a barrier whole, and near zero


def draw(walk: WalkRecords, out: Path, suffix: str = ".png") -> list[Path]:
    """All pictures of a walk; returns their paths. Quantities are drawn where some were measured."""
    with style.look():
        robot = [draw_walk(walk, out / f"walk{suffix}"), draw_swing_foot(walk, out / f"swing_foot{suffix}")]
    of = {"rows": panels(walk)} | ({"quantities": quantity_panels(walk)} if np.isfinite(walk.measured).any() else {})
    look: Any = {"title": str(walk.about.get("title", "")), "xlabel": "time (s); grey: 30 ms after an impact"}
    look |= {"starts": walk.step_starts[1:].tolist(), "shaded": IMPACT}
    return robot + [draw_panels(shown, walk.time, out / f"{name}{suffix}", **look) for name, shown in of.items()]


def draw_walk(walk: WalkRecords, path: Path) -> Path:
    """The robot at its last landings, as the film shows it, the newest last."""
    rows, scene = [*walk.step_starts[1:].tolist(), len(walk.tick) - 1][-STILLS:], Scene(walk)
    figure, panels = style.figure(len(rows), height=style.PAGE * SIZE[1] / SIZE[0])
    for axes, row in zip(panels, rows, strict=True):
        axes.imshow(scene.frame(row))
        axes.set_axis_off()
    return style.save(figure, path)


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
    figure.axes[-1].set(xlabel="time (s)", xlim=(0, 1.02 * _end(walk)))
    figure.suptitle(str(walk.about.get("title", "")), fontsize=10)
    return style.save(figure, path)


def panels(walk: WalkRecords) -> list[Panel]:
    """What was decided, and the stance foot's force; nothing of what the controller does not have."""
    about: Any = walk.about
    limits = [about["torque_limit"] * sign for sign in (-1, 1)] if "torque_limit" in about else []
    cone = [about["friction_coeff"]] if "friction_coeff" in about else []
    panels = [
        Panel("barriers B", dict(zip(walk.barrier_names, walk.barriers.T, strict=True)), [0.0], NEAR_ZERO),
        Panel("V", {"V": walk.V}, scale=LOG),
        Panel("slacks", {"clf_slack": walk.clf_slack, "rescue_slack": walk.rescue_slack}),
        Panel("friction |F_T|/F_N", {"ratio": force_ratio(walk.stance_force)}, cone),
        Panel("ground force (N)", dict(zip(("F_T", "F_N"), walk.stance_force.T, strict=True))),
        Panel("torques (N m)", dict(zip(ACTUATED, walk.torque.T, strict=True)), limits),
    ]
    return [panel for panel in panels if any(np.isfinite(values).any() for values in panel.curves.values())]


def quantity_panels(walk: WalkRecords) -> list[Panel]:
    """Each quantity over a tick: measured, by the nominal model, and with the estimates."""
    names = walk.about.get("quantities", [f"quantity {i + 1}" for i in range(walk.nominal_b.shape[1])])
    nominal = np.einsum("tij,tj->ti", walk.nominal_a, walk.mu) + walk.nominal_b
    estimated = nominal + np.einsum("tij,tj->ti", walk.alpha, walk.mu) + walk.beta
    measured = np.vstack([walk.measured[1:], np.full_like(walk.measured[:1], np.nan)])  # published a tick later
    panels = []
    for i, name in enumerate(names):
        curves = {"measured": measured[:, i], "nominal model": nominal[:, i], "with the estimates": estimated[:, i]}
        low, high = np.nanpercentile(np.concatenate([measured[:, i], estimated[:, i]]), (1, 99))
        room = 0.3 * (high - low)
        panels.append(Panel(name, curves, ends=(low - room, high + room)))
    return panels


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

"""Pictures of a gait and of a gait library: joints, what they ask of motors and ground, the walk as stick figures."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler
from rabbit_description.gait import Gait, GaitLibrary
from rabbit_description.state import Array

from rabbit_gait_design.analysis import PayloadReport
from rabbit_gait_design.orbit import GaitFigures, Orbit, Stone

COLOURS: Colormap = mpl.colormaps["viridis"]  # of the step lengths or slopes
JOINT_PANELS = ((0, 0), (0, 1), (0, 2), (1, 0))
JOINTS = ("stance hip", "stance knee", "swing hip", "swing knee")
TORSO_LENGTH, LEG_SEGMENT = 0.63, 0.4  # m
# Okabe and Ito's colours, which colour-blind people can tell apart
BLUE, ORANGE, GREEN, PURPLE, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#8C8C8C"
LOOK: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "legend.fontsize": "small",
    "axes.prop_cycle": cycler(color=[BLUE, ORANGE, GREEN, PURPLE, RED, GREY]),
}


@mpl.rc_context(LOOK)
def plot_gait(gait: Gait, stone: Stone | None = None) -> Figure:
    """Joint angles, rates and torques, ground force, swing foot, barrier conditions, and the stick figures below."""
    orbit = Orbit(gait, 201)
    figure = Figure(figsize=(11, 8.5), layout="constrained")
    grid = figure.add_gridspec(3, 3, height_ratios=(1, 1, 1.35))
    axes = [figure.add_subplot(grid[row, column]) for row in range(2) for column in range(3)]
    _plot_joints(axes[0], orbit, "q", "joint angle (rad)")
    _plot_joints(axes[1], orbit, "dq", "joint rate (rad/s)")
    _plot_joints(axes[2], orbit, "torque", "torque (N m)")
    _plot_force(axes[3], orbit)
    _plot_foot(axes[4], orbit, stone)
    _plot_barriers(axes[5], orbit, stone)
    draw_stick_figures(figure.add_subplot(grid[2, :]), orbit)
    figure.suptitle(f"{gait.name}: {gait.step_length:g} m, {gait.step_length / gait.step_time:.2f} m/s")
    return figure


def draw_stick_figures(axes: Axes, orbit: Orbit, width: float = 6.6) -> None:
    """The robot at each landing and, faintly, between, over `width` m; the legs change places at each landing."""
    q = orbit.series("q")
    landing = orbit.instants[-1].swing[0]
    slope = np.radians(orbit.gait.slope)
    for step in range(int((width - 1) / landing)):
        near, far = (BLUE, ORANGE) if step % 2 == 0 else (ORANGE, BLUE)
        _draw_robot(axes, q[len(q) // 2], step * landing, near, far, slope, opacity=0.3)
        _draw_robot(axes, q[0], step * landing, near, far, slope)
    axes.axline((0.0, 0.0), slope=np.tan(slope), color="black", linewidth=0.8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x (m)", ylabel="z (m)")


@mpl.rc_context(LOOK)
def plot_library(library: GaitLibrary) -> Figure:
    """Desired joints over the phase angle, swing foot, figures, and the walk of both ends, over the step length; of a
    library for slopes over the slope, at its start's length."""
    if len(library.slopes) > 1:
        gaits = [row[library.lengths.index(library.start_length)] for row in library.rows]
        places, label = library.slopes, "slope (degrees)"
    else:
        gaits, places, label = library.gaits, library.lengths, "step length (m)"
    orbits = [Orbit(gait, 201) for gait in gaits]
    figure = Figure(figsize=(11, 9.5), layout="constrained")
    grid = figure.add_gridspec(4, 3, height_ratios=(1, 1, 0.9, 0.9))
    for joint, (row, column) in enumerate(JOINT_PANELS):
        _plot_joint(figure.add_subplot(grid[row, column]), orbits, joint)
    _plot_feet(figure.add_subplot(grid[1, 1]), orbits)
    _plot_figures(figure.add_subplot(grid[1, 2]), places, [orbit.figures() for orbit in orbits], label)
    for row, orbit in ((2, orbits[0]), (3, orbits[-1])):
        axes = figure.add_subplot(grid[row, :])
        draw_stick_figures(axes, orbit)
        axes.set_title(
            f"steps of {orbit.gait.step_length:g} m" + f", slope {orbit.gait.slope:g}°" * bool(orbit.gait.slope)
        )
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(places[0], places[-1]), COLOURS)
    figure.colorbar(scale, ax=figure.axes[:5], label=label, shrink=0.7, location="right")
    figure.suptitle(f"{library.name}: {len(library.gaits)} gaits")
    return figure


@mpl.rc_context(LOOK)
def plot_payloads(reports: dict[str, Sequence[PayloadReport]]) -> Figure:
    """Fixed point against the least phase rate, eigenvalue, and peak torque over the payload, a line a gait."""
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    rate, eigenvalue, torque = figure.subplots(1, 3)
    for name, rows in reports.items():
        load = [row.payload for row in rows]
        (line,) = rate.plot(load, [row.phase_rate for row in rows], marker="o", markersize=3, label=name)
        rate.plot(load, [row.least_phase_rate for row in rows], linestyle=":", color=line.get_color())
        eigenvalue.plot(load, [row.eigenvalue for row in rows], marker="o", markersize=3)
        torque.plot(load, [row.peak_torque for row in rows], marker="o", markersize=3)
    rate.set(title="fixed point (dotted: least)", xlabel="payload (kg)", ylabel="phase rate after impact (1/s)")
    eigenvalue.set(title="Poincaré eigenvalue", xlabel="payload (kg)", ylim=(0, 1))
    torque.set(title="peak torque", xlabel="payload (kg)", ylabel="torque (N m)")
    rate.legend()
    return figure


def _plot_joints(axes: Axes, orbit: Orbit, name: str, label: str) -> None:
    axes.plot(orbit.times, orbit.series(name)[:, -4:], label=JOINTS)
    axes.set(xlabel="time (s)", ylabel=label)
    _legend(axes)


def _plot_force(axes: Axes, orbit: Orbit) -> None:
    tangential, normal = orbit.series("force").T
    most = np.max(np.abs(tangential) / normal)
    axes.plot(orbit.times, normal, label="F_N")
    axes.plot(orbit.times, tangential, label=f"F_T (at most {most:.2f} F_N)")
    axes.set(xlabel="time (s)", ylabel="ground force (N)")
    _legend(axes)


def _plot_foot(axes: Axes, orbit: Orbit, stone: Stone | None) -> None:
    swing = orbit.series("swing")
    axes.plot(swing[:, 0], swing[:, 1], label="swing foot")
    if stone is not None:
        centre, radius = stone.l_min / 2, np.hypot(stone.l_min / 2, stone.R2)
        x = np.linspace(0.0, stone.l_min, 100)
        axes.plot(x, np.sqrt(radius**2 - (x - centre) ** 2) - stone.R2, "--", color=RED, label="B2 = 0")
        axes.plot([stone.l_min, stone.l_max], [0, 0], linewidth=5, color=GREY, label="stone", solid_capstyle="butt")
    axes.set(xlabel="from the stance foot (m)", ylabel="height (m)", ylim=(-0.005, 1.15 * swing[:, 1].max()))
    _legend(axes)


def _plot_barriers(axes: Axes, orbit: Orbit, stone: Stone | None) -> None:
    if stone is None:
        axes.set_visible(False)
        return
    axes.plot(orbit.phases, orbit.ecbf_conditions(stone), label=("B1", "B2"))
    axes.axhline(0.0, color=RED, linestyle="--", linewidth=1, label="limit")
    axes.set(xlabel="phase (1)", ylabel="B'' + (p1+p2) B' + p1 p2 B (m/s²)", yscale="symlog")
    axes.set_ylim(bottom=min(-1.0, axes.dataLim.y0))
    _legend(axes)


def _legend(axes: Axes) -> None:
    """Above the panel, where it hides nothing."""
    columns = 3 if len(axes.lines) < len(JOINTS) else 2
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=columns, borderaxespad=0.2)


def _draw_robot(
    axes: Axes, q: Array, shift: float, stance_colour: str, swing_colour: str, slope: float, opacity: float = 1.0
) -> None:
    """On ground that rises by `slope`, rad."""
    cos, sin = np.cos(slope), np.sin(slope)
    level = np.array([[cos, -sin], [sin, cos]])  # from along the ground to along the horizon
    hip = q[:2] + (shift, 0.0)
    shoulder = hip + TORSO_LENGTH * _up(q[2])
    look: Any = {"alpha": opacity, "linewidth": 1.0 + opacity, "solid_capstyle": "round"}
    axes.plot(*level @ np.column_stack([hip, shoulder]), color="black", **look)
    for joint, colour in ((5, swing_colour), (3, stance_colour)):
        knee = hip - LEG_SEGMENT * _up(q[2] + q[joint])
        foot = knee - LEG_SEGMENT * _up(q[2] + q[joint] + q[joint + 1])
        axes.plot(*level @ np.column_stack([hip, knee, foot]), color=colour, marker=".", markersize=4, **look)


def _up(angle: float) -> Array:
    """Unit vector (x, z) of a link turned by `angle` about +y."""
    return np.array([np.sin(angle), np.cos(angle)])


def _colours(orbits: Sequence[Orbit]) -> Sequence[Any]:
    places = np.array([(orbit.gait.slope, orbit.gait.step_length) for orbit in orbits]).sum(axis=1)
    return list(COLOURS((places - places[0]) / (places[-1] - places[0])))


def _plot_joint(axes: Axes, orbits: Sequence[Orbit], joint: int) -> None:
    for orbit, colour in zip(orbits, _colours(orbits), strict=True):
        span = orbit.gait.phase_angle_end - orbit.gait.phase_angle_start
        axes.plot(orbit.gait.phase_angle_start + span * orbit.phases, orbit.series("q")[:, 3 + joint], color=colour)
    axes.set(xlabel="phase angle (rad)", ylabel=f"{JOINTS[joint]} (rad)")


def _plot_feet(axes: Axes, orbits: Sequence[Orbit]) -> None:
    for orbit, colour in zip(orbits, _colours(orbits), strict=True):
        axes.plot(*orbit.series("swing").T, color=colour)
    axes.set(xlabel="from the stance foot (m)", ylabel="swing foot's height (m)")


def _plot_figures(axes: Axes, places: Sequence[float], figures: Sequence[GaitFigures], label: str) -> None:
    axes.plot(places, [each.speed for each in figures], marker="o", markersize=3, label="speed (m/s)")
    axes.plot(places, [each.eigenvalue for each in figures], marker="s", markersize=3, label="eigenvalue")
    share = [each.least_phase_rate / each.start_phase_rate for each in figures]
    axes.plot(places, share, marker="^", markersize=3, label="least over own phase rate")
    axes.set(xlabel=label, ylim=(0, None))
    axes.legend()

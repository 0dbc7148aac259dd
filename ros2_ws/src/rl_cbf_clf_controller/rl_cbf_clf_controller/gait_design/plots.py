"""Pictures of a gait: what the joints do, what it asks of motors and ground, and the walk as stick figures."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rabbit_description.gait import Gait
from rabbit_description.state import Array

from rl_cbf_clf_controller.gait_design.analysis import PayloadReport
from rl_cbf_clf_controller.gait_design.orbit import Orbit, Stone

JOINTS = ("stance hip", "stance knee", "swing hip", "swing knee")
TORSO_LENGTH, LEG_SEGMENT = 0.63, 0.4  # m
STANCE_COLOUR, SWING_COLOUR, TORSO_COLOUR = "tab:blue", "tab:orange", "0.35"


def plot_gait(gait: Gait, stone: Stone | None = None) -> Figure:
    """Joint angles, rates and torques, ground force, swing foot, barrier conditions, and the stick figures below."""
    orbit = Orbit(gait, 201)
    figure = Figure(figsize=(11, 8.5), layout="constrained")
    grid = figure.add_gridspec(3, 3, height_ratios=(1, 1, 1.25))
    axes = [figure.add_subplot(grid[row, column]) for row in range(2) for column in range(3)]
    _plot_joints(axes[0], orbit, "q", "joint angle, rad")
    _plot_joints(axes[1], orbit, "dq", "joint rate, rad/s")
    _plot_joints(axes[2], orbit, "torque", "torque, N m")
    _plot_force(axes[3], orbit)
    _plot_foot(axes[4], orbit, stone)
    _plot_barriers(axes[5], orbit, stone)
    draw_stick_figures(figure.add_subplot(grid[2, :]), orbit)
    figure.suptitle(f"{gait.name}: {gait.step_length:g} m, {gait.step_length / gait.step_time:.2f} m/s")
    return figure


def draw_stick_figures(axes: Axes, orbit: Orbit, figures: int = 5, steps: int = 6) -> None:
    """The robot at equal times over `steps` steps, the legs changing places at each landing."""
    times = np.linspace(0.0, orbit.times[-1], figures)
    q = np.array([np.interp(times, orbit.times, column) for column in orbit.series("q").T]).T
    landing = orbit.instants[-1].swing[0]
    for step in range(steps):
        near, far = (STANCE_COLOUR, SWING_COLOUR) if step % 2 == 0 else (SWING_COLOUR, STANCE_COLOUR)
        for pose in q:
            _draw_robot(axes, pose, step * landing, near, far)
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_aspect("equal")
    axes.set(xlabel="x, m", ylabel="z, m")


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
    rate.set(title="fixed point (dotted: least)", xlabel="payload, kg", ylabel="phase rate after impact, 1/s")
    eigenvalue.set(title="Poincaré eigenvalue", xlabel="payload, kg", ylim=(0, 1))
    torque.set(title="peak torque", xlabel="payload, kg", ylabel="N m")
    rate.legend(fontsize="small")
    return figure


def _plot_joints(axes: Axes, orbit: Orbit, name: str, label: str) -> None:
    lines = axes.plot(orbit.times, orbit.series(name)[:, -4:])
    axes.set(xlabel="time, s", ylabel=label)
    axes.legend(
        lines,
        JOINTS,
        fontsize="xx-small",
        loc="upper center",
        ncols=4,
        bbox_to_anchor=(0.5, 1.15),
        columnspacing=0.8,
        handlelength=1.0,
    )


def _plot_force(axes: Axes, orbit: Orbit) -> None:
    force = orbit.series("force")
    axes.plot(orbit.times, force[:, 1], label="F_N, N")
    axes.plot(orbit.times, force[:, 0], label="F_T, N")
    ratio = axes.twinx()
    ratio.plot(orbit.times, np.abs(force[:, 0]) / force[:, 1], color="tab:red", linestyle="--")
    ratio.set_ylim(0, 1)
    ratio.set_ylabel("|F_T| / F_N", color="tab:red")
    axes.set(xlabel="time, s", ylabel="ground force, N")
    axes.legend(fontsize="x-small", loc="center")


def _plot_foot(axes: Axes, orbit: Orbit, stone: Stone | None) -> None:
    swing = orbit.series("swing")
    axes.plot(swing[:, 0], swing[:, 1], label="swing foot")
    if stone is not None:
        centre, radius = stone.l_min / 2, np.hypot(stone.l_min / 2, stone.R2)
        x = np.linspace(0.0, stone.l_min, 100)
        axes.plot(x, np.sqrt(radius**2 - (x - centre) ** 2) - stone.R2, "--", color="tab:red", label="circle of B2")
        axes.plot([stone.l_min, stone.l_max], [0, 0], linewidth=5, color="0.5", label="stone")
    axes.set(xlabel="forward of the stance foot, m", ylabel="height, m")
    axes.set_ylim(-0.005, 1.5 * swing[:, 1].max())
    axes.legend(fontsize="x-small", loc="upper right")


def _plot_barriers(axes: Axes, orbit: Orbit, stone: Stone | None) -> None:
    if stone is None:
        axes.set_visible(False)
        return
    lines = axes.plot(orbit.phases, orbit.ecbf_conditions(stone))
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set(xlabel="phase", ylabel="B'' + (p1+p2) B' + p1 p2 B, m/s²", yscale="symlog")
    axes.legend(lines, ("B1", "B2"), fontsize="x-small")


def _draw_robot(axes: Axes, q: Array, shift: float, stance_colour: str, swing_colour: str) -> None:
    hip = q[:2] + (shift, 0.0)
    shoulder = hip + TORSO_LENGTH * _up(q[2])
    axes.plot(*np.column_stack([hip, shoulder]), color=TORSO_COLOUR, linewidth=1.5)
    for joint, colour in ((5, swing_colour), (3, stance_colour)):
        knee = hip - LEG_SEGMENT * _up(q[2] + q[joint])
        foot = knee - LEG_SEGMENT * _up(q[2] + q[joint] + q[joint + 1])
        axes.plot(*np.column_stack([hip, knee, foot]), color=colour, linewidth=1.0, marker=".", markersize=2)


def _up(angle: float) -> Array:
    """Unit vector (x, z) of a link turned by `angle` about +y."""
    return np.array([np.sin(angle), np.cos(angle)])

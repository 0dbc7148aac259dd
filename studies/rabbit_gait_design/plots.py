"""Pictures of a gait and of a gait library: joints, what they ask of motors and ground, the swing foot."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rabbit_description.gait import Gait, GaitLibrary
from rabbit_viewer import style

from rabbit_gait_design.orbit import Orbit
from rabbit_gait_design.specification import GaitSpecification, Stone

JOINTS = ("stance hip", "stance knee", "swing hip", "swing knee")


def save(made: Gait | GaitLibrary, specification: GaitSpecification, out: Path) -> None:
    """Write `NAME.yaml` and `NAME.png`; raises `OSError`."""
    made.save(out / f"{made.name}.yaml")
    with style.look():
        if isinstance(made, GaitLibrary):
            figure = plot_library(made)
        else:
            figure = plot_gait(made, specification.stone if specification.barriers else None)
        style.save(figure, out / f"{made.name}.png", dpi=110)


def plot_gait(gait: Gait, stone: Stone | None = None) -> Figure:
    """Joint angles, rates and torques, ground force, swing foot and barrier conditions."""
    orbit = Orbit(gait, 201)
    figure = Figure(figsize=(11, 6), layout="constrained")
    angles, rates, torques, force, foot, barriers = figure.subplots(2, 3).ravel()
    for axes, name, label in (
        (angles, "q", "joint angle (rad)"),
        (rates, "dq", "joint rate (rad/s)"),
        (torques, "torque", "torque (N m)"),
    ):
        axes.plot(orbit.times, orbit.series(name)[:, -4:], label=JOINTS)
        axes.set(xlabel="time (s)", ylabel=label)
    force.plot(orbit.times, orbit.series("force"), label=("F_T", "F_N"))
    force.set(xlabel="time (s)", ylabel="ground force (N)")
    _plot_foot(foot, orbit, stone)
    if stone is not None:
        barriers.plot(orbit.phases, orbit.ecbf_conditions(stone), label=("B1", "B2"))
    style.limit(barriers, 0.0, "limit")
    barriers.set(xlabel="phase (1)", ylabel="B'' + (p1+p2) B' + p1 p2 B (m/s²)", yscale="symlog")
    for axes in figure.axes:
        style.legend(axes, columns=2)
    figure.suptitle(f"{gait.name}: {gait.step_length:g} m, {gait.step_length / gait.step_time:.2f} m/s")
    return figure


def plot_library(library: GaitLibrary) -> Figure:
    """Swing feet and figures over the step length; of a library for slopes over the slope, at its start's length."""
    if len(library.slopes) > 1:
        gaits = [row[library.lengths.index(library.start_length)] for row in library.rows]
        places, label = library.slopes, "slope (degrees)"
    else:
        gaits, places, label = library.gaits, library.lengths, "step length (m)"
    orbits = [Orbit(gait, 201) for gait in gaits]
    figures = [orbit.figures() for orbit in orbits]
    figure = Figure(figsize=(9, 3), layout="constrained")
    feet, over = figure.subplots(1, 2)
    for orbit in orbits:
        feet.plot(*orbit.series("swing").T)
    feet.set(xlabel="from the stance foot (m)", ylabel="swing foot's height (m)")
    for name in ("speed", "eigenvalue", "friction_used"):
        over.plot(places, [getattr(gait, name) for gait in figures], marker="o", markersize=3, label=name)
    over.set(xlabel=label, ylim=(0, None))
    over.legend()
    figure.suptitle(f"{library.name}: {len(library.gaits)} gaits")
    return figure


def _plot_foot(axes: Axes, orbit: Orbit, stone: Stone | None) -> None:
    swing = orbit.series("swing")
    axes.plot(swing[:, 0], swing[:, 1], label="swing foot")
    if stone is not None:
        centre, radius = stone.l_min / 2, np.hypot(stone.l_min / 2, stone.R2)
        x = np.linspace(0.0, stone.l_min, 100)
        axes.plot(x, np.sqrt(radius**2 - (x - centre) ** 2) - stone.R2, "--", color=style.RED, label="B2 = 0")
        axes.plot([stone.l_min, stone.l_max], [0, 0], linewidth=5, color=style.STONE, label="stone")
    axes.set(xlabel="from the stance foot (m)", ylabel="height (m)", ylim=(-0.005, 1.15 * swing[:, 1].max()))

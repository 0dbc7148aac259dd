"""Pictures of a gait library: what changes with the step length."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from rabbit_description.gait import GaitLibrary

from rabbit_gait_design.orbit import GaitFigures, Orbit
from rabbit_gait_design.plots import JOINTS, LOOK, draw_stick_figures

COLOURS: Colormap = mpl.colormaps["viridis"]
JOINT_PANELS = ((0, 0), (0, 1), (0, 2), (1, 0))


@mpl.rc_context(LOOK)
def plot_library(library: GaitLibrary) -> Figure:
    """Desired joints over the phase angle, swing foot, figures over the step length, and the walk of both ends."""
    orbits = [Orbit(gait, 201) for gait in library.gaits]
    figure = Figure(figsize=(11, 9.5), layout="constrained")
    grid = figure.add_gridspec(4, 3, height_ratios=(1, 1, 0.9, 0.9))
    for joint, (row, column) in enumerate(JOINT_PANELS):
        _plot_joint(figure.add_subplot(grid[row, column]), orbits, joint)
    _plot_feet(figure.add_subplot(grid[1, 1]), orbits)
    _plot_figures(figure.add_subplot(grid[1, 2]), library.lengths, [orbit.figures() for orbit in orbits])
    for row, orbit in ((2, orbits[0]), (3, orbits[-1])):
        axes = figure.add_subplot(grid[row, :])
        draw_stick_figures(axes, orbit)
        axes.set_title(f"steps of {orbit.gait.step_length:g} m")
    lengths = mpl.cm.ScalarMappable(mpl.colors.Normalize(library.lengths[0], library.lengths[-1]), COLOURS)
    figure.colorbar(lengths, ax=figure.axes[:5], label="step length (m)", shrink=0.7, location="right")
    figure.suptitle(f"{library.name}: {len(library.gaits)} gaits")
    return figure


def _colours(orbits: Sequence[Orbit]) -> Sequence[Any]:
    lengths = np.array([orbit.gait.step_length for orbit in orbits])
    return list(COLOURS((lengths - lengths[0]) / (lengths[-1] - lengths[0])))


def _plot_joint(axes: Axes, orbits: Sequence[Orbit], joint: int) -> None:
    for orbit, colour in zip(orbits, _colours(orbits), strict=True):
        span = orbit.gait.phase_angle_end - orbit.gait.phase_angle_start
        axes.plot(orbit.gait.phase_angle_start + span * orbit.phases, orbit.series("q")[:, 3 + joint], color=colour)
    axes.set(xlabel="phase angle (rad)", ylabel=f"{JOINTS[joint]} (rad)")


def _plot_feet(axes: Axes, orbits: Sequence[Orbit]) -> None:
    for orbit, colour in zip(orbits, _colours(orbits), strict=True):
        axes.plot(*orbit.series("swing").T, color=colour)
    axes.set(xlabel="from the stance foot (m)", ylabel="swing foot's height (m)")


def _plot_figures(axes: Axes, lengths: Sequence[float], figures: Sequence[GaitFigures]) -> None:
    axes.plot(lengths, [each.speed for each in figures], marker="o", markersize=3, label="speed (m/s)")
    axes.plot(lengths, [each.eigenvalue for each in figures], marker="s", markersize=3, label="eigenvalue")
    share = [each.least_phase_rate / each.start_phase_rate for each in figures]
    axes.plot(lengths, share, marker="^", markersize=3, label="least over own phase rate")
    axes.set(xlabel="step length (m)", ylim=(0, None))
    axes.legend()

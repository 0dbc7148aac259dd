"""The end of a walk in one picture: the robot at the landings, and the swing foot's path over the stones."""

from itertools import pairwise
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from rabbit_description.state import Array, Leg
from rabbit_experiments.walk_records import WalkRecords
from rabbit_sim.plant import Span

from rabbit_viewer import style
from rabbit_viewer.geometry import ARC, area_at, legs_of, stone_spans, torso_points

STEPS = 9  # shown at most
STANCE, SWING = style.BLUE, style.ORANGE  # as in films and on the page
ROOM = (0.25, 0.45)  # m, beyond the first and the last foot
LEAST = 4.0  # m, shown of a short walk too
STONE_DEPTH = 0.06  # m
TOP = 1.5  # m
PATH_TOP = 0.14  # m


def draw_walk(walk: WalkRecords, path: Path) -> Path:
    """The last steps: the stick robot; below it the swing foot's path, enlarged in height, and the barriers' limits."""
    legs = legs_of(walk)
    rows = [*walk.step_starts.tolist(), len(walk.tick) - 1][-STEPS - 1 :]
    feet = legs[:, :, 2].swapaxes(0, 1)
    left = feet[rows, :, 0].min() - ROOM[0]
    right = max(feet[rows, :, 0].max() + ROOM[1], left + LEAST)
    tall = style.PAGE * (TOP + 0.1) / (right - left)
    figure, (robot, foot) = style.figure(2, (tall + 2.6) / 2, height_ratios=(tall, 1.6))
    spans = stone_spans(walk, feet)[: int(walk.step_index[rows[-1]]) + 2]
    for axes, depth in ((robot, STONE_DEPTH), (foot, PATH_TOP / 10)):
        for near, far, top in spans or [Span(left, right)]:
            axes.add_patch(Rectangle((near, top - depth), far - near, depth, color=style.STONE, linewidth=0))
    for first, last in pairwise(rows):
        _draw_robot(robot, walk, legs, (first + last) // 2, 0.3)
        _draw_path(foot, walk, feet, first, last)
    for row in rows:
        _draw_robot(robot, walk, legs, row, 1.0)
    for colour, label in ((STANCE, "stance leg"), (SWING, "swing leg")):
        robot.plot([], [], color=colour, label=label)
    if spans:
        foot.plot([], [], color=style.RED, linestyle="--", linewidth=1, label="B2 = 0: the foot stays above")
        foot.plot([], [], color=style.RED, linestyle=":", linewidth=1, label="B1 = 0: the foot stays before")
    for axes in (robot, foot):
        style.legend(axes)
    robot.set(xlim=(left, right), ylim=(-0.1, TOP), aspect="equal", anchor="S", ylabel="z (m)")
    foot.set(ylim=(-PATH_TOP / 10, PATH_TOP), ylabel="swing foot z (m)", xlabel="x (m)")
    figure.suptitle(str(walk.about.get("title", "")), fontsize=10)
    return style.save(figure, path)


def _draw_robot(axes: Axes, walk: WalkRecords, legs: Array, row: int, opacity: float) -> None:
    look: dict[str, Any] = {"alpha": opacity, "solid_capstyle": "round", "linewidth": 2.0 if opacity == 1 else 1.2}
    stance = Leg(walk.stance[row])
    for leg in (stance.other, stance):  # the stance leg before the other
        axes.plot(*legs[leg, row].T, color=STANCE if leg is stance else SWING, marker=".", markersize=4, **look)
    axes.plot(*torso_points(walk.q[row : row + 1])[0].T, color=style.BLACK, **look)


def _draw_path(axes: Axes, walk: WalkRecords, feet: Array, first: int, last: int) -> None:
    """One step: path of the swing foot, and where both barriers are zero."""
    stance = Leg(walk.stance[first])
    swing = stance.other
    axes.plot(*feet[first:last, swing].T, color=SWING)
    if (area := area_at(walk, first)) is not None:
        area = area + (feet[first, stance, 0], 0.0)
        axes.plot(*area[:ARC].T, color=style.RED, linestyle="--", linewidth=1)
        axes.plot(*area[ARC:-2].T, color=style.RED, linestyle=":", linewidth=1)

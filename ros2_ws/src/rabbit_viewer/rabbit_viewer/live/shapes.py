"""A moment as plain shapes in the plane of walking, by group. What they become in Foxglove and RViz is said there."""

from dataclasses import dataclass

import numpy as np
from rabbit_description.state import Array, Leg

from rabbit_viewer import colours
from rabbit_viewer.geometry import PLATFORM, allowed_area, area_triangles, force_arrow, friction_cone
from rabbit_viewer.live.snapshot import Edges, Limits, Snapshot
from rabbit_viewer.skeleton import leg_points, torso_points

GROUPS = ("robot", "stones", "area", "cone", "force", "words")
LEG_WIDTH, TORSO_WIDTH = 0.05, 0.08  # m
GROUND = 3.0  # m of flat ground drawn to either side
OVERHEAD = 0.85  # m from the hip up to the words
CONE_OPACITY = 0.25
STONE_BREADTH = 0.4  # m, across the plane of walking
SHAFT, HEAD = 0.02, 0.05  # m, diameters of an arrow
FONT = 0.07  # m


@dataclass(frozen=True)
class Line:
    """Through `points` (n, 2), m."""

    points: Array
    width: float
    colour: str


@dataclass(frozen=True)
class Box:
    """A piece of ground: its upper side from `near` to `far` at height 0, m."""

    near: float
    far: float
    colour: str


@dataclass(frozen=True)
class Sheet:
    """Triangles (m, 3, 2), m."""

    triangles: Array
    colour: str
    opacity: float = 1.0


@dataclass(frozen=True)
class Arrow:
    """From `start` (2,) to `tip` (2,), m."""

    start: Array
    tip: Array
    colour: str


@dataclass(frozen=True)
class Words:
    """A text above `at` (2,), m."""

    at: Array
    text: str


Shape = Line | Box | Sheet | Arrow | Words
Drawing = dict[str, list[Shape]]


def draw(moment: Snapshot, limits: Limits | None) -> Drawing:
    """All groups; without `limits`, which the graph has not told yet, the area and the cone are empty."""
    q, bend = moment.q[None], limits.link_bend if limits else 0.0
    legs = {leg: leg_points(q, leg, bend)[0] for leg in Leg}
    foot = legs[moment.stance][2]
    drawing: Drawing = {group: [] for group in GROUPS}
    drawing["robot"] = [
        Line(legs[moment.stance.other], LEG_WIDTH, colours.ORANGE),
        Line(legs[moment.stance], LEG_WIDTH, colours.BLUE),
        Line(torso_points(q)[0], TORSO_WIDTH, colours.BLACK),
    ]
    drawing["stones"] = _ground(moment, float(foot[0]))
    if limits is not None:
        drawing["area"] = _area(moment.stone, limits, foot)
        drawing["cone"] = [Sheet((foot + friction_cone(limits.friction_coeff))[None], colours.SKY, CONE_OPACITY)]
    if (arrow := force_arrow(moment.force)).any():
        drawing["force"] = [Arrow(foot, foot + arrow, colours.RED)]
    drawing["words"] = [Words(moment.q[:2] + (0.0, OVERHEAD), caption(moment))]
    return drawing


def caption(moment: Snapshot) -> str:
    """Where the walk stands, in one line."""
    where = f"stone {moment.touchdowns} of {moment.stones}"
    return f"episode {moment.episode}   t {moment.seconds:.2f} s   {where}   policy {moment.policy}"


def world_stones(moment: Snapshot, foot: float) -> list[Edges]:
    """World edges of the platform, if the landings reach back to it, of the stones landed on and the one ahead, m.

    They are laid out backwards from the stance foot at `foot`, so that a viewer may come late.
    """
    if moment.stone is None and not any(np.isfinite(step.stone.near) for step in moment.steps):
        return []
    behind: list[Edges] = []
    start = foot
    for step in reversed(moment.steps):
        start -= step.l
        behind.append(Edges(start + step.stone.near, start + step.stone.far))
    if len(moment.steps) == moment.touchdowns:
        width = moment.stone or moment.steps[0].stone
        behind.append(Edges(start + PLATFORM, start + (width.far - width.near) / 2))
    ahead = [Edges(foot + moment.stone.near, foot + moment.stone.far)] if moment.stone else []
    return behind[::-1] + ahead


def _ground(moment: Snapshot, foot: float) -> list[Shape]:
    stones = world_stones(moment, foot)
    if not stones:
        return [Box(foot - GROUND, foot + GROUND, colours.STONE)]
    boxes: list[Shape] = [Box(near, far, colours.STONE) for near, far in stones]
    if moment.stone:
        boxes[-1] = Box(*stones[-1], colours.GREEN)
    return boxes


def _area(stone: Edges | None, limits: Limits, foot: Array) -> list[Shape]:
    if stone is None:
        return []
    margin = limits.stone_margin
    corners = allowed_area(stone.near + margin, stone.far - margin, limits.R1, limits.R2)
    return [Sheet(area_triangles(corners) + (foot[0], 0.0), colours.AREA)]

"""What is drawn: where the robot's joints are, the area the barriers allow, the ground's force. x, z; m.

A link turned by a reaches along R(a) (0, -1) = (-sin a, -cos a), about +y.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from rabbit_description.state import Array, Leg
from rabbit_experiments.walk_records import WalkRecords
from rabbit_sim.kinematics import LINK_LENGTH, link
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import Span

TORSO = 0.63  # m
DEPTH = 0.12  # m, of a drawn stone
AREA_HEIGHT = 0.2  # m, up to which the barriers' area is shown
AREA_LEFT = -0.45  # m, from the stance foot, where it ends to the left
FORCE_SCALE = 1e-3  # m per N
LONGEST_ARROW = 0.9  # m
PLATFORM = -1.0  # m, where the first platform begins
ARC = 20  # corners of the area that lie on the inner circle

Links = tuple[float, float]  # of the legs: by which share of its length a link is bent, and how many times as long
STRAIGHT: Links = 0.0, 1.0


def links_of(about: Mapping[str, Any]) -> Links:
    """The links of the robot that these parameters are about."""
    return float(about.get("link_bend", 0.0)), float(about.get("leg_stretch", 1.0))


def leg_points(q: Array, leg: Leg, links: Links = STRAIGHT) -> Array:
    """Hip, knee and foot of a leg, world x and z, for `q` (n, 7): shape (n, 3, 2), m."""
    hip_joint, knee_joint = q[:, leg.joints].T
    thigh = q[:, 2] + hip_joint
    hip = q[:, :2]
    knee = hip + _link(thigh, links)
    return np.stack([hip, knee, knee + _link(thigh + knee_joint, links)], axis=1)


def legs_of(walk: WalkRecords) -> Array:
    """Both legs of a walk, as `leg_points`: shape (2, n, 3, 2), left, right, m."""
    return np.stack([leg_points(walk.q, leg, links_of(walk.about)) for leg in Leg])


def torso_points(q: Array) -> Array:
    """Hip and the torso's upper end: shape (n, 2, 2), m."""
    hip, pitch = q[:, :2], q[:, 2]
    return np.stack([hip, hip + TORSO * np.stack([np.sin(pitch), np.cos(pitch)], axis=1)], axis=1)


def feet(q: Array, links: Links = STRAIGHT) -> Array:
    """Both feet: shape (n, 2, 2), rows left, right, m."""
    return np.stack([leg_points(q, leg, links)[:, 2] for leg in Leg], axis=1)


def _link(angle: Array, links: Links) -> Array:
    bend, stretch = links
    return np.stack(link(angle, LINK_LENGTH * stretch, bend, np), axis=1)


def allowed_area(l_min: float, l_max: float, R1: float, R2: float) -> Array:
    """Corners (k, 2) of where both barriers are positive, above ground, from the stance foot, m.

    The first `ARC` lie on the inner circle, the next 8 on the outer one.
    """
    middle = l_min / 2
    x = np.linspace(0.0, l_min, ARC)
    inner = np.sqrt(middle**2 + R2**2 - (x - middle) ** 2) - R2
    z = np.linspace(0.0, AREA_HEIGHT, 8)
    outer = np.sqrt((R1 + l_max) ** 2 - z**2) - R1
    left = [(AREA_LEFT, AREA_HEIGHT), (AREA_LEFT, 0.0)]
    return np.concatenate([np.stack([x, inner], axis=1), np.stack([outer, z], axis=1), left])


def stands(q: Array, links: Links = STRAIGHT) -> Any:
    """Whether the robot is not falling yet, by the bounds of any evaluation, for `q` (n, 7): shape (n,)."""
    usual = SimulationParameters.model_fields
    height = q[:, 1] - feet(q, links)[:, :, 1].min(axis=1)
    return (height > usual["fall_height"].default) & (np.abs(q[:, 2]) < usual["fall_pitch"].default)


def fall_of(walk: WalkRecords) -> int | None:
    """The row from which the robot falls, if it does."""
    standing = np.flatnonzero(stands(walk.q, links_of(walk.about)))
    first = int(standing[-1]) + 1 if len(standing) else 0
    return first if first < len(walk.q) else None


def stone_spans(walk: WalkRecords) -> list[Span]:
    """World edges and top, as previewed, of the platform and each step's stone, m; empty on flat ground."""
    if not np.isfinite(walk.preview).any():
        return []
    starts = walk.step_starts
    seen = starts[np.isfinite(walk.preview[starts, 0])]
    origin = feet(walk.q[seen], links_of(walk.about))[np.arange(len(seen)), walk.stance[seen], 0]
    edges = origin[:, None] + walk.preview[seen]
    half = float(np.diff(walk.preview[seen[0]])[0]) / 2
    tops = np.cumsum(walk.stone_height[seen])
    return [Span(PLATFORM, half), *(Span(*span) for span in np.column_stack([edges, tops]).tolist())]


def spans_until(walk: WalkRecords, spans: list[Span], row: int) -> list[Span]:
    """Those of the `stone_spans` that are seen by this row of the records, which may begin with any step."""
    return spans[: int(np.searchsorted(walk.step_starts, row, side="right")) + 1]


def box(near: float, far: float, top: float = 0.0) -> list[tuple[float, float]]:
    """Corners of a stone between these edges, as it is drawn, m."""
    return [(near, top - DEPTH), (near, top), (far, top), (far, top - DEPTH)]


def area_at(walk: WalkRecords, row: int) -> Array | None:
    """The `allowed_area` in a row of the records; None without a stone in sight."""
    near, far = walk.preview[row]
    if not np.isfinite(near):
        return None
    margin, R1, R2 = (float(walk.about.get(n, d)) for n, d in (("stone_margin", 0.0), ("R1", 1.0), ("R2", 0.5)))
    return allowed_area(near + margin, far - margin, R1, R2)


def force_arrow(force: Array) -> Array:
    """The arrow (2,), m, of a force (tangential, normal), N."""
    arrow: Array = np.asarray(force) * FORCE_SCALE
    size = float(np.hypot(*arrow))
    return arrow * min(1.0, LONGEST_ARROW / size) if size > 0 else arrow

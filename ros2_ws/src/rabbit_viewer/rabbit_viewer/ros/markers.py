"""A snapshot as ROS messages, for RViz and Foxglove: markers, a namespace each group, and the frames of the links."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, Transform, TransformStamped, Vector3
from rabbit_description.state import Array, Leg
from std_msgs.msg import ColorRGBA, Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from rabbit_viewer.colours import AREA, BLACK, BLUE, GREEN, ORANGE, RED, SKY, STONE, rgb
from rabbit_viewer.geometry import DEPTH, PLATFORM, allowed_area, area_triangles, force_arrow, friction_cone
from rabbit_viewer.live.snapshot import Snapshot
from rabbit_viewer.skeleton import LEG_LINK, leg_points, torso_points

WORLD = "world"
LEG_WIDTH, TORSO_WIDTH = 0.05, 0.08  # m
GROUND = 3.0  # m of flat ground drawn to either side
OVERHEAD = 0.85  # m from the hip up to the words
CONE_OPACITY = 0.25
STONE_BREADTH = 0.4  # m, across the plane of walking
SHAFT, HEAD = 0.02, 0.05  # m, diameters of an arrow
FONT = 0.07  # m


def markers(snapshot: Snapshot) -> MarkerArray:
    """All that is drawn; without `limits` neither area nor cone. They replace all markers before."""
    q, stance, limits = snapshot.q[None], snapshot.stance, snapshot.limits
    legs = [leg_points(q, leg, limits.link_bend if limits else 0.0)[0] for leg in Leg]
    foot, arrow = legs[stance][2], force_arrow(snapshot.force)
    groups = {
        "robot": [
            _line(legs[stance.other], LEG_WIDTH, ORANGE),
            _line(legs[stance], LEG_WIDTH, BLUE),
            _line(torso_points(q)[0], TORSO_WIDTH, BLACK),
        ],
        "stones": _ground(snapshot, float(foot[0])),
        "area": _area(snapshot, float(foot[0])),
        "cone": [_sheet(foot + friction_cone(limits.friction_coeff), SKY, CONE_OPACITY)] if limits else [],
        "force": [_arrow(foot, foot + arrow, RED)] if arrow.any() else [],
        "words": [_words(q[0, :2] + (0.0, OVERHEAD), caption(snapshot))],
    }
    header = Header(stamp=snapshot.state.stamp, frame_id=WORLD)
    made = [Marker(header=header, action=Marker.DELETEALL)]
    for group, shapes in groups.items():
        for number, marker in enumerate(shapes):
            marker.header, marker.ns, marker.id = header, group, number
            made.append(marker)
    return MarkerArray(markers=made)


def caption(snapshot: Snapshot) -> str:
    """Where the walk stands, in one line."""
    state = snapshot.state
    where = f"stone {state.touchdowns} of {snapshot.stones}"
    policy = snapshot.details.policy_version
    return f"episode {state.episode}   t {snapshot.seconds:.2f} s   {where}   policy {policy}"


def world_stones(snapshot: Snapshot, foot: float) -> list[tuple[float, float]]:
    """World edges of the platform, if the landings reach back to it, of the stones landed on and the one ahead, m.

    They are laid out backwards from the stance foot at `foot`, so that a viewer may come late.
    """
    ahead, landings = snapshot.stone, snapshot.landings
    if ahead is None and not any(np.isfinite(landing.l_min) for landing in landings):
        return []
    stones = [] if ahead is None else [(foot + ahead.l_min, foot + ahead.l_max)]
    start = foot
    for landing in reversed(landings):
        start -= landing.l
        stones.insert(0, (start + landing.l_min, start + landing.l_max))
    if len(landings) == snapshot.state.touchdowns:
        first = stones[0]
        stones.insert(0, (start + PLATFORM, start + (first[1] - first[0]) / 2))
    return stones


def transforms(snapshot: Snapshot) -> TFMessage:
    """The links of the URDF, each in its parent. `slide_x` moves with the hip, forward only: a camera can follow it."""
    x, z, pitch, *joints = snapshot.q.tolist()
    at = snapshot.state.stamp
    made = [
        _frame(at, WORLD, "slide_x", x=x),
        _frame(at, "slide_x", "slide_z", z=z),
        _frame(at, "slide_z", "torso", angle=pitch),
    ]
    for side, (hip, knee) in (("left", joints[:2]), ("right", joints[2:])):
        thigh, shin = f"{side}_thigh", f"{side}_shin"
        made.append(_frame(at, "torso", thigh, angle=hip))
        made.append(_frame(at, thigh, shin, z=-LEG_LINK, angle=knee))
        made.append(_frame(at, shin, f"{side}_foot", z=-LEG_LINK))
    return TFMessage(transforms=made)


def _frame(at: Time, parent: str, child: str, x: float = 0.0, z: float = 0.0, angle: float = 0.0) -> TransformStamped:
    """`child` in `parent`: moved by x, z (m), then turned by `angle` (rad) about +y."""
    turned = Quaternion(y=np.sin(angle / 2), w=np.cos(angle / 2))
    moved = Transform(translation=Vector3(x=x, z=z), rotation=turned)
    return TransformStamped(header=Header(stamp=at, frame_id=parent), child_frame_id=child, transform=moved)


def _ground(snapshot: Snapshot, foot: float) -> list[Marker]:
    stones = world_stones(snapshot, foot)
    if not stones:
        return [_box(foot - GROUND, foot + GROUND, STONE)]
    boxes = [_box(near, far, STONE) for near, far in stones]
    if snapshot.stone:
        boxes[-1] = _box(*stones[-1], GREEN)
    return boxes


def _area(snapshot: Snapshot, foot: float) -> list[Marker]:
    stone, limits = snapshot.stone, snapshot.limits
    if stone is None or limits is None:
        return []
    margin = limits.stone_margin
    corners = allowed_area(stone.l_min + margin, stone.l_max - margin, limits.R1, limits.R2)
    return [_sheet((area_triangles(corners) + (foot, 0.0)).reshape(-1, 2), AREA)]


def _line(points: Array, width: float, colour: str) -> Marker:
    return _marker(Marker.LINE_STRIP, Vector3(x=width), colour, points)


def _sheet(corners: Array, colour: str, opacity: float = 1.0) -> Marker:
    """Triangles, three corners each."""
    return _marker(Marker.TRIANGLE_LIST, Vector3(x=1.0, y=1.0, z=1.0), colour, corners, opacity)


def _arrow(start: Array, tip: Array, colour: str) -> Marker:
    return _marker(Marker.ARROW, Vector3(x=SHAFT, y=HEAD), colour, np.stack([start, tip]))


def _box(near: float, far: float, colour: str) -> Marker:
    """A piece of ground, its upper side at height 0."""
    marker = _marker(Marker.CUBE, Vector3(x=far - near, y=STONE_BREADTH, z=DEPTH), colour)
    marker.pose.position = Point(x=(near + far) / 2, z=-DEPTH / 2)
    return marker


def _words(at: Array, text: str) -> Marker:
    marker = _marker(Marker.TEXT_VIEW_FACING, Vector3(z=FONT), BLACK)
    marker.pose.position, marker.text = Point(x=at[0], z=at[1]), text
    return marker


def _marker(kind: int, scale: Vector3, colour: str, points: Array | None = None, opacity: float = 1.0) -> Marker:
    red, green, blue = rgb(colour)
    marker = Marker(type=kind, scale=scale, color=ColorRGBA(r=red, g=green, b=blue, a=opacity))
    marker.pose.orientation.w = 1.0
    marker.points = [] if points is None else [Point(x=x, z=z) for x, z in points.tolist()]
    return marker

"""A walk for RViz and Foxglove: the robot's URDF and the frames of its links, and the stones as markers."""

from collections.abc import Sequence
from itertools import takewhile
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, Transform, TransformStamped, Vector3
from rabbit_common.ros.qos import WEIGHTS
from rabbit_description import URDF_PATH
from rabbit_description.state import Leg, StonePreview
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import ColorRGBA, Header, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from rabbit_viewer.colours import GREEN, STONE, rgb
from rabbit_viewer.geometry import DEPTH, LEG_LINK, PLATFORM, leg_points

WORLD = "world"
DEPTH_OF_TOPICS = 10
SHOWN_STEPS = 12  # stones drawn behind the robot
GROUND = 3.0  # m of flat ground drawn to either side
STONE_BREADTH = 0.4  # m, across the plane of walking


class RvizTopics:
    """Publishes a walk on standard topics. `landings` of the episode, by stone."""

    def __init__(self, node: Node) -> None:
        self.landings: dict[int, Any] = {}
        self._tf = node.create_publisher(TFMessage, "tf", DEPTH_OF_TOPICS)
        self._markers = node.create_publisher(MarkerArray, "markers", DEPTH_OF_TOPICS)
        description = node.create_publisher(String, "robot_description", WEIGHTS)
        description.publish(String(data=URDF_PATH.read_text(encoding="utf-8")))

    @property
    def is_watched(self) -> bool:
        """Somebody reads what `show` publishes."""
        return bool(self._tf.get_subscription_count() or self._markers.get_subscription_count())

    def show(self, state: Any, ahead: StonePreview | None) -> None:
        """A tick: its `RobotState`, and the next stone."""
        foot = float(leg_points(np.array(state.q)[None], Leg.standing(state.touchdowns))[0, 2, 0])
        indices = takewhile(self.landings.__contains__, range(state.touchdowns, state.touchdowns - SHOWN_STEPS, -1))
        landings = [self.landings[index] for index in indices][::-1]
        self._tf.publish(serialize_message(transforms(state)))
        self._markers.publish(serialize_message(markers(state, foot, ahead, landings)))


def markers(state: Any, foot: float, ahead: StonePreview | None, landings: Sequence[Any]) -> MarkerArray:
    """The stones, the one ahead in green, or flat ground. They replace all markers before.

    Args:
        state: with the fields of `RobotState`.
        foot: where the stance foot is, m.
        ahead: the next stone.
        landings: the last ones, the newest last, objects with the fields of `Landing`.
    """
    header = Header(stamp=state.header.stamp, frame_id=WORLD)
    made = [Marker(header=header, action=Marker.DELETEALL)]
    stones = world_stones(foot, ahead, landings, state.touchdowns)
    for number, (near, far) in enumerate(stones or [(foot - GROUND, foot + GROUND)]):
        is_next = ahead is not None and number == len(stones) - 1
        red, green, blue = rgb(GREEN if is_next else STONE)
        box = Marker(header=header, ns="stones", id=number, type=Marker.CUBE)
        box.scale, box.color = Vector3(x=far - near, y=STONE_BREADTH, z=DEPTH), ColorRGBA(r=red, g=green, b=blue, a=1.0)
        box.pose.position, box.pose.orientation.w = Point(x=(near + far) / 2, z=-DEPTH / 2), 1.0
        made.append(box)
    return MarkerArray(markers=made)


def world_stones(
    foot: float, ahead: StonePreview | None, landings: Sequence[Any], touchdowns: int
) -> list[tuple[float, float]]:
    """World edges of the platform, if the landings reach back to it, of the stones landed on and the one ahead, m.

    They are laid out backwards from the stance foot at `foot`, so that a viewer may come late.
    """
    if ahead is None and not any(np.isfinite(landing.l_min) for landing in landings):
        return []
    stones = [] if ahead is None else [(foot + ahead.l_min, foot + ahead.l_max)]
    start = foot
    for landing in reversed(landings):
        start -= landing.l
        stones.insert(0, (start + landing.l_min, start + landing.l_max))
    if len(landings) == touchdowns:
        first = stones[0]
        stones.insert(0, (start + PLATFORM, start + (first[1] - first[0]) / 2))
    return stones


def transforms(state: Any) -> TFMessage:
    """The links of the URDF, each in its parent. `slide_x` moves with the hip, forward only: a camera can follow it."""
    x, z, pitch, *joints = state.q
    at = state.header.stamp
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

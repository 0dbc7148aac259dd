"""A walk for RViz and Foxglove: the stones as markers, and the robot where the simulator does not publish its `tf`."""

from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Vector3
from rabbit_common.ros.conversions import WORLD
from rabbit_common.ros.robot_frames import RobotFrames
from rabbit_description.state import Leg, StonePreview
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from rabbit_viewer.colours import GREEN, STONE, rgb
from rabbit_viewer.geometry import DEPTH, PLATFORM, leg_points

DEPTH_OF_TOPICS = 10
SHOWN_STEPS = 12  # stones drawn behind the robot
GROUND = 3.0  # m of flat ground drawn to either side
STONE_BREADTH = 0.4  # m, across the plane of walking
Point2 = Sequence[float]


class RvizTopics:
    """Publishes a walk on standard topics. `landings` and `previews` of the episode, by stone."""

    def __init__(self, node: Node) -> None:
        self.landings: dict[int, Any] = {}
        self.previews: dict[int, StonePreview] = {}
        self._frames = RobotFrames(node)
        self._markers = node.create_publisher(MarkerArray, "markers", DEPTH_OF_TOPICS)

    @property
    def is_watched(self) -> bool:
        """Somebody reads what `show` publishes."""
        return self._frames.are_wanted or bool(self._markers.get_subscription_count())

    def show(self, state: Any, ahead: StonePreview | None) -> None:
        """A tick: its `RobotState`, and the next stone."""
        foot = leg_points(np.array(state.q)[None], Leg.standing(state.touchdowns))[0, 2].tolist()
        indices = takewhile(self.landings.__contains__, range(state.touchdowns, state.touchdowns - SHOWN_STEPS, -1))
        landings = [self.landings[index] for index in indices][::-1]
        heights = {index: stone.height for index, stone in self.previews.items()}
        if self._frames.are_wanted:
            self._frames.publish(state)
        self._markers.publish(serialize_message(markers(state, foot, ahead, landings, heights)))


def markers(
    state: Any, foot: Point2, ahead: StonePreview | None, landings: Sequence[Any], heights: Mapping[int, float]
) -> MarkerArray:
    """The stones, the one ahead in green, or flat ground. They replace all markers before.

    Args:
        state: with the fields of `RobotState`.
        foot: where the stance foot is, world x and z, m.
        ahead: the next stone.
        landings: the last ones, the newest last, objects with the fields of `Landing`.
        heights: of stones above those before, by index, m; of others 0.
    """
    header = Header(stamp=state.header.stamp, frame_id=WORLD)
    boxes = [Marker(header=header, action=Marker.DELETEALL)]
    stones = world_stones(foot, ahead, landings, heights, state.touchdowns)
    for number, (near, far, top) in enumerate(stones or [(foot[0] - GROUND, foot[0] + GROUND, foot[1])]):
        is_next = ahead is not None and number == len(stones) - 1
        red, green, blue = rgb(GREEN if is_next else STONE)
        box = Marker(header=header, ns="stones", id=number, type=Marker.CUBE)
        box.scale, box.color = Vector3(x=far - near, y=STONE_BREADTH, z=DEPTH), ColorRGBA(r=red, g=green, b=blue, a=1.0)
        box.pose.position, box.pose.orientation.w = Point(x=(near + far) / 2, z=top - DEPTH / 2), 1.0
        boxes.append(box)
    return MarkerArray(markers=boxes)


def world_stones(
    foot: Point2,
    ahead: StonePreview | None,
    landings: Sequence[Any],
    heights: Mapping[int, float],
    touchdowns: int,
) -> list[tuple[float, float, float]]:
    """Edges and top of the platform, if the landings reach back to it, of the stones landed on and the one ahead.

    In the world, m; see `markers`. They are laid out backwards from the stance foot, so that a viewer may come late.
    """
    if ahead is None and not any(np.isfinite(landing.l_min) for landing in landings):
        return []
    start, top = foot
    stones = [] if ahead is None else [(start + ahead.l_min, start + ahead.l_max, top + ahead.height)]
    for landing in reversed(landings):
        start -= landing.l
        stones.insert(0, (start + landing.l_min, start + landing.l_max, top))
        top -= heights.get(landing.index, 0.0)
    if len(landings) == touchdowns:
        first = stones[0]
        stones.insert(0, (start + PLATFORM, start + (first[1] - first[0]) / 2, top))
    return stones

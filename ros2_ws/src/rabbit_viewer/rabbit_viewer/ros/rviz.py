"""The same view as ROS topics, for RViz: `robot_description`, `tf`, `markers`."""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, Transform, TransformStamped, Vector3
from rabbit_description import URDF_PATH
from rabbit_description.state import Array
from rabbit_ros.ros.qos import WEIGHTS as LATCHED
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import ColorRGBA, Header, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from rabbit_viewer.colours import BLACK, rgb
from rabbit_viewer.geometry import DEPTH
from rabbit_viewer.live.frames import WORLD, Frame, link_frames, turn_about_y
from rabbit_viewer.live.shapes import (
    FONT,
    HEAD,
    SHAFT,
    STONE_BREADTH,
    Arrow,
    Box,
    Drawing,
    Line,
    Shape,
    Sheet,
    Words,
)
from rabbit_viewer.live.snapshot import Snapshot

NEWEST = QoSProfile(depth=10)


class RvizTopics:
    """Publishers of a node."""

    def __init__(self, node: Node) -> None:
        self._description = node.create_publisher(String, "robot_description", LATCHED)
        self._tf = node.create_publisher(TFMessage, "tf", NEWEST)
        self._markers = node.create_publisher(MarkerArray, "markers", NEWEST)
        self._description.publish(String(data=URDF_PATH.read_text(encoding="utf-8")))

    @property
    def is_watched(self) -> bool:
        """Somebody wants something that moves."""
        return bool(self._tf.get_subscription_count() or self._markers.get_subscription_count())

    def show(self, moment: Snapshot, drawing: Drawing) -> None:
        """Publish a moment."""
        seconds, nanoseconds = divmod(moment.nanoseconds, 1_000_000_000)
        at = Time(sec=seconds, nanosec=nanoseconds)
        self._tf.publish(TFMessage(transforms=[_transform(frame, at) for frame in link_frames(moment.q)]))
        self._markers.publish(markers(drawing, at))


def markers(drawing: Drawing, at: Time) -> MarkerArray:
    """A drawing as markers, a namespace each group; they replace all before."""
    header = Header(stamp=at, frame_id=WORLD)
    made = [Marker(header=header, action=Marker.DELETEALL)]
    for group, shapes in drawing.items():
        for number, shape in enumerate(shapes):
            marker = _marker(shape)
            marker.header, marker.ns, marker.id, marker.action = header, group, number, Marker.ADD
            made.append(marker)
    return MarkerArray(markers=made)


def _marker(shape: Shape) -> Marker:
    match shape:
        case Line(points, width, colour):
            return _made(Marker.LINE_STRIP, Vector3(x=width), colour, points)
        case Sheet(triangles, colour, opacity):
            return _made(Marker.TRIANGLE_LIST, Vector3(x=1.0, y=1.0, z=1.0), colour, triangles.reshape(-1, 2), opacity)
        case Arrow(start, tip, colour):
            marker = _made(Marker.ARROW, Vector3(x=SHAFT, y=HEAD), colour)
            marker.points = [_point(*start.tolist()), _point(*tip.tolist())]
        case Box(near, far, colour):
            marker = _made(Marker.CUBE, Vector3(x=far - near, y=STONE_BREADTH, z=DEPTH), colour)
            marker.pose.position = _point((near + far) / 2, -DEPTH / 2)
        case Words(at, text):
            marker = _made(Marker.TEXT_VIEW_FACING, Vector3(z=FONT), BLACK)
            marker.pose.position, marker.text = _point(*at.tolist()), text
    return marker


def _made(kind: int, scale: Vector3, colour: str, points: Array | None = None, opacity: float = 1.0) -> Marker:
    red, green, blue = rgb(colour)
    marker = Marker(type=kind, scale=scale, color=ColorRGBA(r=red, g=green, b=blue, a=opacity))
    marker.pose.orientation.w = 1.0
    marker.points = [] if points is None else [_point(x, z) for x, z in points.tolist()]
    return marker


def _point(x: float, z: float) -> Point:
    return Point(x=x, y=0.0, z=z)


def _transform(frame: Frame, at: Time) -> TransformStamped:
    x, y, z, w = turn_about_y(frame.angle)
    moved = Transform(translation=Vector3(x=frame.x, z=frame.z), rotation=Quaternion(x=x, y=y, z=z, w=w))
    return TransformStamped(header=Header(stamp=at, frame_id=frame.parent), child_frame_id=frame.child, transform=moved)

"""The robot for RViz: `robot_description`, and `tf` of its links as robot_state_publisher makes it of joint states."""

from xml.etree import ElementTree

import numpy as np
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rabbit_description import robot_description
from rabbit_description.state import COORDINATES, Array
from rabbit_msgs.msg import RobotState
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import Header, String
from tf2_msgs.msg import TFMessage

from rabbit_common.ros.qos import WEIGHTS

DEPTH = 10
JOINTS = ElementTree.fromstring(robot_description()).findall("joint")


class RobotFrames:
    """Publishes them."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._tf = node.create_publisher(TFMessage, "tf", DEPTH)
        node.create_publisher(String, "robot_description", WEIGHTS).publish(String(data=robot_description()))

    @property
    def are_read(self) -> bool:
        """Whether somebody hears `tf`."""
        return bool(self._tf.get_subscription_count())

    @property
    def are_wanted(self) -> bool:
        """Whether somebody hears `tf`, and nobody else publishes it."""
        return self.are_read and self._node.count_publishers("tf") == 1

    def publish(self, state: RobotState) -> None:
        """Publishes the frames of a tick."""
        self._tf.publish(serialize_message(transforms(state)))


def transforms(state: RobotState) -> TFMessage:
    """The links of the URDF, in their parents. `slide_x` moves with the hip, forward only: a camera can follow it."""
    q = dict(zip(COORDINATES, state.q, strict=True))
    frames = []
    for joint in JOINTS:
        value = q.get(joint.attrib["name"], 0.0)
        moved, axis = _vector(joint, "origin"), _vector(joint, "axis")
        turned = Quaternion()
        if joint.attrib["type"] == "prismatic":
            moved += axis * value
        else:
            turned.x, turned.y, turned.z = (np.sin(value / 2) * axis).tolist()
            turned.w = float(np.cos(value / 2))
        header = Header(stamp=state.header.stamp, frame_id=_attribute(joint, "parent", "link"))
        place = Transform(translation=Vector3(**dict(zip("xyz", moved.tolist(), strict=True))), rotation=turned)
        child = _attribute(joint, "child", "link")
        frames.append(TransformStamped(header=header, child_frame_id=child, transform=place))
    return TFMessage(transforms=frames)


def _vector(joint: ElementTree.Element, tag: str) -> Array:
    return np.array(_attribute(joint, tag, "xyz", "0 0 0").split(), dtype=float)


def _attribute(joint: ElementTree.Element, tag: str, name: str, default: str = "") -> str:
    element = joint.find(tag)
    return default if element is None else element.attrib[name]

"""A node's own priority: taken if permitted, complained about if not."""

from rclpy.node import Node

from rabbit_ros.priority import NotPermitted, take_priority


def take_or_warn(node: Node, priority: int) -> None:
    """`take_priority`; where it is not permitted the node says so in its log and goes on as an ordinary process."""
    try:
        take_priority(priority)
    except NotPermitted as error:
        node.get_logger().warning(str(error))

"""Publishes a recording's messages again: their bytes, at their pace, under the QoS they were offered with."""

import time
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from rabbit_common.ros.client import GraphClient
from rabbit_common.ros.namespace_check import first_published
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Connection, ConnectionExtRosbag2, QosDurability, QosReliability

from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import graph_types
from rabbit_recording.open_recording import begin_of, one_line_errors, opened

DELIVERY_SECONDS = 3.0
LEAST_DEPTH = 10  # where a recording does not say


def play(path: Path, rate: float = 1.0, namespace: str = "", delay: float = 1.0) -> int:
    """Publish what is in a recording, what was announced before its first state at once; returns how many messages.

    It goes at `rate` times the recorded pace, with `namespace` before every topic, after `delay` s in which readers
    find the player. Raises `RecordingError` if it is not readable, of other message definitions than the sourced
    workspace's, or with topics that somebody publishes already; `Refused` if the environment cannot be used.
    """
    here = graph_types([Path(get_package_share_directory("rabbit_msgs"))])
    with opened(path) as reader, closing(GraphClient("player", namespace, "/")) as client:
        publishers: dict[str, Any] = {}
        for connection in reader.connections:
            topic, kind = connection.topic, connection.msgtype
            if kind in here.fielddefs and here.hash_rihs01(kind) != reader.typestore.hash_rihs01(kind):
                raise RecordingError(f"recording {path}: {kind} is defined otherwise in the sourced workspace")
            publishers[topic] = _publisher(client.node, topic, kind, connection, namespace)
        topics = [publisher.topic_name for publisher in publishers.values()]
        if clash := first_published(client.node, topics, 1, delay):  # one is the player's
            raise RecordingError(f"recording {path}: {clash} is published already; give --namespace, or end that graph")
        began, count = time.monotonic(), 0
        with one_line_errors(path):
            begin = begin_of(reader)
            for connection, nanoseconds, data in reader.messages():
                time.sleep(max(0.0, began + (nanoseconds - begin) / 1e9 / rate - time.monotonic()))
                publishers[connection.topic].publish(data)
                count += 1
        for publisher in publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=DELIVERY_SECONDS))
        return count


def _publisher(node: Node, topic: str, kind: str, connection: Connection, namespace: str) -> Any:
    """A publisher with the QoS that was offered when the topic was recorded."""
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    profile = QoSProfile(depth=LEAST_DEPTH)
    for offered in connection.ext.offered_qos_profiles[:1]:
        profile.depth = offered.depth or LEAST_DEPTH
        if offered.reliability == QosReliability.BEST_EFFORT:
            profile.reliability = ReliabilityPolicy.BEST_EFFORT
        if offered.durability == QosDurability.TRANSIENT_LOCAL:
            profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
    package, _, name = kind.split("/")
    topic = "/" + "/".join(part.strip("/") for part in (namespace, topic) if part.strip("/"))
    return node.create_publisher(getattr(import_module(f"{package}.msg"), name), topic, profile)

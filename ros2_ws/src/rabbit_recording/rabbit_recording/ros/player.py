"""Publishes a recording's messages again: their bytes, at their pace, under the QoS they were offered with."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rabbit_common.ros.context import joined
from rabbit_common.ros.namespace_check import first_published
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, ConnectionExtRosbag2, QosDurability, QosHistory, QosReliability
from rosbags.typesys import Stores, get_typestore

from rabbit_recording.bag_writer import RecordingError, graph_types
from rabbit_recording.open_recording import begin_of, one_line_errors, opened

DELIVERY_SECONDS = 3.0
LEAST_DEPTH = 10  # where a recording does not say


@dataclass(frozen=True)
class Playing:
    """`rate` times the recording's own pace, from `start` s on, `namespace` before every topic.

    `delay`: s before the first message, in which readers find the player.
    """

    rate: float = 1.0
    start: float = 0.0
    namespace: str = ""
    delay: float = 1.0


def play(path: Path, how: Playing, show: Callable[[float, float], object]) -> int:
    """Publish what is in a recording; `show` gets the seconds played and those there are.

    Returns:
        How many messages were published.

    Raises:
        RecordingError: not readable, of other message definitions than the sourced workspace's, or with topics that
            somebody publishes already.
        Refused: the environment cannot be used.
    """
    with opened(path) as reader:
        check_definitions(path, reader)
        with joined("/") as context:
            node = rclpy.create_node("player", namespace=how.namespace, context=context)
            publishers = {c.topic: _publisher(node, c, how.namespace) for c in reader.connections}
            _refuse_clash(path, node, publishers, how.delay)
            return _publish(path, reader, publishers, how, show)


def check_definitions(path: Path, reader: AnyReader) -> None:
    """Raise `RecordingError` if a type is defined otherwise here: the bytes would mean something else."""
    standard = {name.split("/")[0] for name in get_typestore(Stores.ROS2_JAZZY).fielddefs}
    packages = {c.msgtype.split("/")[0] for c in reader.connections} - standard
    try:
        here = graph_types(Path(get_package_share_directory(package)) for package in sorted(packages))
    except PackageNotFoundError as error:
        raise RecordingError(f"recording {path}: message package not in the sourced workspace: {error}") from error
    for name in sorted({c.msgtype for c in reader.connections}):
        if name not in here.fielddefs or here.hash_rihs01(name) != reader.typestore.hash_rihs01(name):
            raise RecordingError(f"recording {path}: {name} is defined otherwise in the sourced workspace")


def quality(connection: Connection) -> QoSProfile:
    """As it was offered when it was recorded."""
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    offered = next(iter(connection.ext.offered_qos_profiles), None)
    if offered is None:
        return QoSProfile(depth=LEAST_DEPTH)
    is_best_effort = offered.reliability == QosReliability.BEST_EFFORT
    is_latched = offered.durability == QosDurability.TRANSIENT_LOCAL
    return QoSProfile(
        history=HistoryPolicy.KEEP_ALL if offered.history == QosHistory.KEEP_ALL else HistoryPolicy.KEEP_LAST,
        depth=offered.depth or LEAST_DEPTH,
        reliability=ReliabilityPolicy.BEST_EFFORT if is_best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE,
    )


def _publisher(node: Node, connection: Connection, namespace: str) -> Any:
    package, _, name = connection.msgtype.split("/")
    topic = "/" + "/".join(part.strip("/") for part in (namespace, connection.topic) if part.strip("/"))
    return node.create_publisher(getattr(import_module(f"{package}.msg"), name), topic, quality(connection))


def _refuse_clash(path: Path, node: Node, publishers: dict[str, Any], seconds: float) -> None:
    """Raise `RecordingError` as soon as somebody else publishes on these topics."""
    topics = [publisher.topic_name for publisher in publishers.values()]
    if clash := first_published(node, topics, 1, seconds):  # one is the player's own
        raise RecordingError(f"recording {path}: {clash} is published already; give --namespace, or end that graph")


def _publish(
    path: Path, reader: AnyReader, publishers: dict[str, Any], how: Playing, show: Callable[[float, float], object]
) -> int:
    with one_line_errors(path):
        first = begin_of(reader)  # what was announced before goes out at once
    seconds = (reader.end_time - first) / 1e9
    begin = first + round(how.start * 1e9)
    began, count = time.monotonic(), 0
    for connection, nanoseconds, data in _messages(path, reader, begin if how.start else None):
        at = max(0.0, (nanoseconds - begin) / 1e9 / how.rate)
        time.sleep(max(0.0, began + at - time.monotonic()))
        publishers[connection.topic].publish(data)
        count += 1
        show((nanoseconds - first) / 1e9, seconds)
    for each in publishers.values():
        each.wait_for_all_acked(Duration(seconds=DELIVERY_SECONDS))
    return count


def _messages(path: Path, reader: AnyReader, start: int | None) -> Iterator[tuple[Connection, int, bytes]]:
    with one_line_errors(path):
        yield from reader.messages(start=start)

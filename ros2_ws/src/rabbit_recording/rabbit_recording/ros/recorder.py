"""The recorder: every topic of the graph, and others that are asked for, as their bytes came, into a rosbag2 folder.

Messages are stored under the simulated time that they carry, so that a recording plays at the pace of the walk whatever
the pace of the machine was; diagnostics under that of the newest state. A full disk ends the recording, not the walk,
and so does a simulator that begins its time at 0 again. A recorder that is started again begins another recording
beside the first.
"""

import inspect
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from pydantic import Field
from rabbit_common.priority import give_way
from rabbit_common.ros.checked_node import CheckedNode
from rabbit_common.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import TICK
from rabbit_common.ros.spin import run, steady_timer
from rabbit_common.ros.topics import TOPICS, Topic, published_by
from rabbit_description.atomic_file import first_free
from rabbit_description.validation import Checked
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import FLUSH_SECONDS, BagWriter, add_types, graph_types, offered
from rabbit_recording.message_header import SimulatedTime, turn_of

IDLE_SECONDS = 0.3  # without a message, after which nothing more is on its way
EXPECTED = ("simulator", "controller")  # nodes whose topics must be there before the recorder says that it is ready
BACKLOG = 200  # messages of a topic that may wait: far more are announced at once only where somebody steps the robot
SENT = "source_timestamp"  # of a message, ns of the wall clock


class NodeParameters(Checked):
    """What to record and where."""

    path: str = Field("recording", min_length=1, description="folder to be made; if it is there, PATH-2 and so on")
    topics: tuple[str, ...] = Field((), description="further ones to record, by name, once somebody publishes them")


class RecorderNode(CheckedNode):
    """Writes what it hears."""

    def __init__(self) -> None:
        super().__init__("recorder")
        parameters = declare(self, NodeParameters)
        refuse_unknown(self)
        self._types = graph_types([Path(get_package_share_directory("rabbit_msgs"))])
        self._path = first_free(Path(parameters.path))  # a recorder may be started again
        self._writer = BagWriter(self._path, self._types)
        self._time = SimulatedTime(self._path)
        self._heard = time.monotonic()
        self._sent = self._asked = 0  # when the newest message was sent; when the node was asked to end; ns
        self._failure = ""
        self._newest_state, self._is_answered = b"", False
        self._gave_way = False  # to who must be in time
        self._readers = {topic.name: self._subscribe(topic) for topic in TOPICS}
        written = self._writer.topics
        self._awaited = [name for name in parameters.topics if self.resolve_topic_name(name) not in written]
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, FLUSH_SECONDS, self._flush)

    def busy(self) -> bool:
        """What was sent before it was asked to end may still be on its way, behind what another node sent later."""
        now = time.time_ns()
        self._asked = self._asked or now
        may_come = time.monotonic() - self._heard < IDLE_SECONDS and self._sent < self._asked
        return may_come or now - self._asked < IDLE_SECONDS * 1e9

    def close(self) -> None:
        """Finish the recording."""
        if self._ends_at_errors(self._writer.close):
            self.get_logger().info(f"{self._writer.messages} messages in {self._path}")

    def _subscribe(self, topic: Topic) -> Subscription:
        name, qos = self.resolve_topic_name(topic.name, only_expand=True), topic.qos  # under its own name if remapped
        words = (policy.name for policy in (qos.durability, qos.reliability, qos.history))
        self._writer.add(name, topic.type_name, [offered(qos.depth, *words)])
        callback = with_info(self._guarded(topic.name, partial(self._on_bytes, topic, name)))
        # with a queue in which messages wait while the disk is written
        queue = QoSProfile(depth=max(qos.depth, BACKLOG), reliability=qos.reliability, durability=qos.durability)
        return self.create_subscription(topic.type, topic.name, callback, queue, raw=True)

    def _flush(self) -> None:
        self._ends_at_errors(self._writer.flush)
        for name in [name for name in self._awaited if self.count_publishers(name)]:
            self._awaited.remove(name)
            self._ends_at_errors(partial(self._subscribe_further, name))

    def _subscribe_further(self, name: str) -> None:
        """A topic that is asked for, under the type and QoS of its publisher; its messages lie where the state is."""
        end = self.get_publishers_info_by_topic(self.resolve_topic_name(name))[0]
        package, _, kind = end.topic_type.split("/")
        if end.topic_type not in self._types.fielddefs:
            add_types(self._types, Path(get_package_share_directory(package)))
        depth = max(BACKLOG, TICK.depth)  # the publisher's is not known
        qos = QoSProfile(depth=depth, reliability=end.qos_profile.reliability, durability=end.qos_profile.durability)
        type_of = getattr(import_module(f"{package}.msg"), kind)
        self._readers[name] = self._subscribe(Topic(name, type_of, qos, "", publisher="all"))

    def _on_bytes(self, topic: Topic, name: str, data: bytes, info: dict[str, Any]) -> None:
        """What cannot be read is recorded too."""
        self._heard, self._sent = time.monotonic(), info[SENT]
        if topic.name == "state":
            self._newest_state = data
        self._is_answered |= topic.name == "torque"
        if topic.name == "timing" and not self._gave_way:  # in lock-step a recorder that falls behind would lose ticks
            self._gave_way = True
            give_way()
        if self._ends_at_errors(
            lambda: self._writer.write(name, self._time.of(topic.name, topic.publisher, data), data)
        ):
            self._message_counter.accept(name)

    def _ends_at_errors(self, write: Callable[[], None]) -> bool:
        """What ends the recording does not end the walk: the node says so and goes on hearing."""
        try:
            if not self._failure:
                write()
        except RecordingError as error:
            with suppress(RecordingError):
                self._writer.close()  # whole, unless the disk is full
            self._failure = f"{error}; recording stopped, `rabbit bag recover {self._path}` keeps what is there"
            self.get_logger().error(self._failure)
        return not self._failure

    def _status(self) -> Status:
        figures = {"path": str(self._path), "episode, tick": "{} {}".format(*turn_of(self._newest_state))}
        if self._failure:
            return ERROR, self._failure, figures
        expected = (topic.name for topic in published_by(EXPECTED))
        absent = [name for name in expected if not self._readers[name].get_publisher_count()] + self._awaited
        if absent and not self._is_answered:  # by then all are there that will be: others' nodes may publish less
            return WARN, f"waiting for {', '.join(absent)}", figures
        return OK, "recording", figures


def with_info(callback: Callable[[Any, dict[str, Any]], None]) -> Callable[..., None]:
    """Have rclpy call `callback(message, info)`: it reads from the signature that a callback wants both.

    Its EventsExecutor then hands them over as one tuple, the other executors as two arguments.
    """

    def take(*got: Any) -> None:
        callback(*(got[0] if len(got) == 1 else got))

    take.__signature__ = inspect.signature(callback)  # type: ignore[attr-defined]
    return take


def main() -> None:
    """The executable `recorder`."""
    run(RecorderNode, errors=(RecordingError,))

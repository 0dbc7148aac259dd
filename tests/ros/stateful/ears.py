"""A node among those of a graph: hears all that they say, asks them, and publishes what it likes."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rabbit_bringup.launching.processes import Processes
from rabbit_msgs.msg import Episode
from rabbit_msgs.srv import LoadPolicy, Pause, ResetEpisode
from rabbit_recording.message_header import turn_of
from rabbit_ros.ros.diagnostics import OK
from rabbit_ros.ros.topics import TOPICS
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rl_trainer.ros.messages import transition_of
from rl_trainer.transitions import Transition

PADDING = 4  # bytes: messages come filled up to a multiple of them
KNOWN_SECONDS = 0.1  # until a new publisher is known to its readers
HANG_AFTER = 120.0  # s: a guard against hangs, no bar
SERVICES = {
    "pause": Pause,
    "reset_episode": ResetEpisode,
    "load_policy": LoadPolicy,
    "set_parameters": SetParameters,
    "set_parameters_atomically": SetParametersAtomically,
    "get_parameters": GetParameters,
}
KINDS = {topic.name: topic for topic in TOPICS}

Turn = tuple[int, int]  # episode and tick


class Hang(AssertionError):
    """Something did not happen in time."""


class Ears:
    """What was heard: by topic the newest bytes, the newest word of each node, ticks, torques, swaps, transitions."""

    def __init__(self, namespace: str, processes: Processes) -> None:
        self.processes = processes  # none of which may end by itself
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("test", namespace=namespace, context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._clients: dict[str, Any] = {}
        self._liars = ExitStack()  # publishers that stay
        self.newest: dict[str, bytes] = {}
        self.false: dict[bytes, int] = {}  # what was sent from here, is not heard as true, and how often it came
        self.said: dict[str, DiagnosticStatus] = {}
        self.episode = Episode()
        self.ended: dict[int, Episode] = {}
        self.ticks: dict[Turn, float] = {}  # when each was heard
        self.turn: Turn = (0, -1)  # the newest of them
        self.torques: dict[Turn, Any] = {}
        self.swaps: list[Any] = []  # of the controller that is there
        self.recordings: dict[str, tuple[Path, float]] = {}  # of each recorder, and since when it records all
        self.acknowledged: list[Transition] = []
        self._hear()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.remove_node(self.node)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _hear(self) -> None:
        hears: dict[str, Callable[[Any], object]] = {
            "diagnostics": self._on_diagnostics,
            "episode": self._on_episode,
            "torque": lambda m: self.torques.__setitem__((m.episode, m.tick), m),
            "policy_swap": self.swaps.append,
            "transition": lambda m: self.acknowledged.append(transition_of(m)),
        }
        for topic in TOPICS:
            take = partial(self._on_bytes, topic.name, hears.get(topic.name))
            self.node.create_subscription(topic.type, topic.name, take, topic.qos, raw=True)

    def _on_bytes(self, name: str, take: Callable[[Any], object] | None, data: bytes) -> None:
        for false in self.false:
            if data.startswith(false) and len(data) - len(false) < PADDING:
                self.false[false] += 1
                return
        self.newest[name] = data
        if name == "state":
            self.turn = max(self.turn, turn_of(data))
            self.ticks.setdefault(turn_of(data), time.monotonic())
        if take is not None:
            take(deserialize_message(data, KINDS[name].type))

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            name = status.name.split("/")[-1]
            self.said[name] = status
            paths = [value.value for value in status.values if value.key == "path"]
            if paths and status.level == OK and name not in self.recordings:
                self.recordings[name] = Path(paths[0]), time.monotonic()

    def _on_episode(self, message: Episode) -> None:
        self.episode = message
        if message.phase == Episode.ENDED:
            self.ended.setdefault(message.episode, message)

    # Time

    def spin(self, seconds: float) -> None:
        """Hear what comes."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(left)

    def wait(self, what: str, until: Callable[[], bool], seconds: float = HANG_AFTER) -> None:
        """Spin until something holds; raises `Hang`, or `LaunchError` where a node ended by itself."""
        if not self.comes(until, seconds):
            lines = {name: status.message for name, status in self.said.items()}
            raise Hang(f"not within {seconds:g} s: {what}; the nodes say {lines}")

    def comes(self, until: Callable[[], bool], seconds: float) -> bool:
        """Whether something holds within so many seconds."""
        end = time.monotonic() + seconds
        while not until():
            self.processes.check()
            if time.monotonic() > end:
                return False
            self._executor.spin_once(0.02)
        return True

    # Questions

    def client(self, name: str, kind: Any) -> Any:
        """The client of a service, once its server is there."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client = self._clients[name]
        self.wait(f"service {name}", client.service_is_ready)
        return client

    def ask(self, name: str, **fields: Any) -> Any:
        """The answer of a service; a question that meets a server which does not know the asker yet is asked again."""
        kind = SERVICES[name.split("/")[-1]]
        client, request = self.client(name, kind), kind.Request(**fields)
        answers = [client.call_async(request)]
        end = time.monotonic() + HANG_AFTER
        while not self.comes(lambda: any(answer.done() for answer in answers), 3.0):
            if time.monotonic() > end:
                raise Hang(f"no answer from {name}")
            answers.append(client.call_async(request))
        return next(answer.result() for answer in answers if answer.done())

    def set_parameters(self, node: str, values: dict[str, Any], atomically: bool = False) -> bool:
        """Whether the node took all of them."""
        wanted = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        if atomically:
            return bool(self.ask(f"{node}/set_parameters_atomically", parameters=wanted).result.successful)
        return all(result.successful for result in self.ask(f"{node}/set_parameters", parameters=wanted).results)

    def parameter(self, node: str, name: str) -> Any:
        """The value that the node has in force."""
        (value,) = self.ask(f"{node}/get_parameters", names=[name]).values
        return Parameter.from_parameter_msg(ParameterMessage(name=name, value=value)).value

    def count(self, key: str) -> int:
        """What the controller counts under names that begin so."""
        values = self.said["controller"].values if "controller" in self.said else ()
        return sum(int(value.value) for value in values if value.key.startswith(key))

    @property
    def refused_policies(self) -> list[str]:
        """The reasons that the controller has told."""
        return [swap.reason for swap in self.swaps if not swap.accepted]

    # Publishing

    @contextmanager
    def publishing(self, name: str) -> Iterator[Any]:
        """A publisher on a topic."""
        publisher = self.node.create_publisher(KINDS[name].type, name, KINDS[name].qos)
        yield publisher
        self.node.destroy_publisher(publisher)

    def lie(self, name: str, data: bytes, stays: bool) -> None:
        """Send wrong bytes; where the publisher `stays`, it does until `silence`."""
        with ExitStack() as liar:
            everybody = self.node.count_subscribers(name)
            publisher = liar.enter_context(self.publishing(name))
            self.comes(lambda: publisher.get_subscription_count() >= everybody, 1.0)
            self.spin(KNOWN_SECONDS)
            self.false[data] = 0
            publisher.publish(data)
            self.comes(lambda: self.false[data] > 0, 1.0)
            if stays:
                self._liars.push(liar.pop_all())

    def silence(self) -> None:
        """Nobody lies any more."""
        self._liars.close()
        self.false.clear()

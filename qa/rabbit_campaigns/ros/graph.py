"""A graph that campaigns act on: its nodes can be killed, stopped, misled and started again; all they say is heard."""

import time
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from resource import RLIM_INFINITY, RLIMIT_FSIZE, prlimit
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rabbit_bringup.launching.processes import PATIENCE, Processes, write_parameters
from rabbit_common.ros.client import TOPIC, GraphClient
from rabbit_common.ros.diagnostics import OK
from rabbit_msgs.msg import Episode
from rabbit_recording.episode_inventory import BY_TICK
from rabbit_recording.message_header import turn_of
from rclpy.serialization import deserialize_message
from rl_cbf_clf_controller.kinds import find_problem
from rl_trainer.ros.messages import ARRAYS, NUMBERS
from rl_trainer.transitions import Doubt, Transition

PADDING = 4  # bytes: messages come filled up to a multiple of them

Turn = tuple[int, int]  # episode and tick


class Hang(AssertionError):
    """Something did not happen in time."""


class CampaignGraph(GraphClient):
    """The nodes as processes, and a node among them that hears all they say.

    newest: bytes by topic; said: the newest status of each node; heard: when each turn was heard first, by topic;
    ended: episodes, and when their end was heard; recordings: of each recorder, and since when it records all.
    """

    def __init__(self, folder: Path, namespace: str, processes: Processes, hang_after: float) -> None:
        """`hang_after`: s in which everything happens."""
        super().__init__("witness", namespace, "/", processes.check)
        self.folder, self.namespace, self.hang_after = folder, namespace, hang_after
        self.training = folder / "training"
        self.processes = processes  # none of which may end by itself
        self.false: dict[bytes, int] = {}  # what was sent from here, is not heard as true, and how often it came
        self.newest: dict[str, bytes] = {}
        self.said: dict[str, DiagnosticStatus] = {}
        self.warnings: deque[tuple[float, str]] = deque(maxlen=1000)
        self.episode = Episode()
        self.turn: Turn = (0, -1)  # the newest
        self.heard: dict[str, dict[Turn, float]] = {name: {} for name in BY_TICK}
        self.ended: dict[int, tuple[Episode, float]] = {}
        self.recordings: dict[str, tuple[Path, float]] = {}
        self.acknowledged: list[Transition] = []
        takes: dict[str, Callable[[Any], object]] = {
            "diagnostics": self._on_diagnostics,
            "episode": self._on_episode,
            "transition": lambda message: self.acknowledged.append(transition_of(message)),
            **self.further_topics(),
        }
        for name in TOPIC:
            self.hear(name, partial(self._on_bytes, name, takes.get(name)), raw=True)

    def further_topics(self) -> dict[str, Callable[[Any], object]]:
        """What else takes a topic's messages."""
        return {}

    def parameters(self, name: str) -> dict[str, Any]:
        """Parameters of a node."""
        raise NotImplementedError

    # Nodes

    def start(self, name: str, **changes: Any) -> None:
        """Start a node, again or for the first time; a second one of its kind has a 2 behind its name."""
        path, kind = self.folder / f"{name}.yaml", name.removesuffix("2")
        write_parameters(path, {name: {**self.parameters(name), **changes}})
        self.said.pop(name, None)
        self.recordings.pop(name, None)
        self.processes.start(name, ros_arguments(name, path, self.namespace), kind)

    def terminate(self, name: str) -> None:
        """SIGTERM, and wait; raises `Hang` if it has to be killed."""
        began = time.monotonic()
        self.processes.stop((name,))
        if time.monotonic() - began > PATIENCE:
            raise Hang(f"the {name} does not end within {PATIENCE:g} s of a SIGTERM")

    def limit_files(self, name: str, size: int) -> None:
        """No file of the node may grow beyond `size`; RLIM_INFINITY frees the disk again."""
        prlimit(self.processes.pid(name), RLIMIT_FSIZE, (size, RLIM_INFINITY))

    def wait(self, what: str, until: Callable[[], bool]) -> None:
        """Hear until something holds; raises `Hang`, or `LaunchError` where a node ended by itself."""
        if not self.comes(until, self.hang_after):
            lines = {name: status.message for name, status in self.said.items()}
            raise Hang(f"not within {self.hang_after:g} s: {what}; the nodes say {lines}")

    # What is heard

    def answered(self, since: float, before: float) -> frozenset[Turn]:
        """The ticks of which state, torque and controller state were heard, all from `since` on, before a moment."""
        whole = set.intersection(*(set(times) for times in self.heard.values()))
        return frozenset(t for t in whole if all(since <= times[t] < before for times in self.heard.values()))

    def told_by(self, name: str) -> str:
        """The message of a node's newest status."""
        return str(self.said[name].message) if name in self.said else ""

    def counted(self, name: str, key: str) -> int:
        """What a node counts under names that begin so."""
        values = self.said[name].values if name in self.said else ()
        return sum(int(value.value) for value in values if value.key.startswith(key))

    def _on_bytes(self, name: str, take: Callable[[Any], object] | None, data: bytes) -> None:
        for false in self.false:
            if data.startswith(false) and len(data) - len(false) < PADDING:
                self.false[false] += 1
                return
        self.newest[name] = data
        if name in self.heard:
            self.heard[name].setdefault(turn_of(data), time.monotonic())
        if name == "state":
            self.turn = max(self.turn, turn_of(data))
        if take is not None:
            take(deserialize_message(data, TOPIC[name].type))

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            name = status.name.split("/")[-1]
            self.said[name] = status
            if status.level != OK:
                self.warnings.append((time.monotonic(), f"{name}: {status.message}"))
            paths = [value.value for value in status.values if value.key == "path"]
            if paths and status.level == OK:
                self.recordings.setdefault(name, (Path(paths[0]), time.monotonic()))

    def _on_episode(self, message: Episode) -> None:
        self.episode = message
        if message.phase == Episode.ENDED:
            self.ended.setdefault(message.episode, (message, time.monotonic()))

    # Lies

    def publish_false(self, publisher: Any, data: bytes) -> None:
        """Publish what is not heard as true here, until `silence`."""
        self.false[data] = 0
        publisher.publish(data)

    def silence(self) -> None:
        """Nobody lies any more."""
        self.false.clear()


def ros_arguments(name: str, parameters: Path, namespace: str) -> list[str]:
    """Of a node under a name of its own."""
    remaps = (f"__ns:=/{namespace}", f"{name.removesuffix('2')}:__node:={name}", "/clock:=clock")
    return ["--ros-args", "--params-file", str(parameters), *(word for each in remaps for word in ("-r", each))]


def transition_of(message: Any) -> Transition:
    """A transition from its message."""
    values: dict[str, Any] = {name: np.array(getattr(message, name.lower())) for name in ARRAYS}
    values["alpha"] = values["alpha"].reshape(len(message.beta), -1)
    values |= {name: getattr(message, name) for name in NUMBERS}
    return Transition(problem=find_problem(message.problem), doubt=Doubt(message.doubt), **values)

"""Tests that start nodes: on this machine only, each worker on a ROS domain of its own."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rabbit_bringup.launching.processes import PATIENCE, Processes, write_parameters
from rabbit_common.ros.diagnostics import OK, reader_counts
from rabbit_common.ros.network import choose_network
from rabbit_common.ros.qos import TICK
from rabbit_common.ros.services import call_service
from rabbit_common.ros.topics import TOPICS, missing_readers
from rabbit_msgs.msg import Episode
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool

DOMAINS = 100  # domain ids above 101 may meet the ephemeral ports
SHORT = {"motor_lag": 0.004, "stones": 3}  # a plant for tests that need a walk, not a result

os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % DOMAINS)
choose_network()
os.environ.setdefault("OMP_NUM_THREADS", "1")


def make_package(prefix: Path, name: str, programs: dict[str, str]) -> dict[str, str]:
    """Put a package with these executables into a prefix; the environment in which it is sourced."""
    (folder := prefix / "lib" / name).mkdir(parents=True)
    (index := prefix / "share" / "ament_index" / "resource_index" / "packages").mkdir(parents=True)
    (index / name).touch()
    for executable, text in programs.items():
        (folder / executable).write_text(f"#!{sys.executable}\n{text}")
        (folder / executable).chmod(0o755)
    return {"AMENT_PREFIX_PATH": f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}"}


class NodeProcesses(Processes):
    """Those of a test, which it may kill and stop."""

    def kill(self, names: Sequence[str]) -> None:
        """End the named nodes at once."""
        for name in names:
            self.send(name, signal.SIGKILL)
            self.wait(name, PATIENCE)

    def send(self, name: str, number: signal.Signals) -> None:
        """Send a node a signal."""
        self.running[name].send_signal(number)

    def pid(self, name: str) -> int:
        """Process of a running node."""
        return self.running[name].pid

    def wait(self, name: str, timeout: float) -> int:
        """Exit code of a node that ends; raises `subprocess.TimeoutExpired`."""
        code = self.running[name].wait(timeout)
        del self.running[name]
        return code


class World:
    """Nodes as processes in one namespace, and a node of the test's own that hears and says what it likes there."""

    def __init__(self, folder: Path, namespace: str) -> None:
        self.folder, self.namespace = folder, namespace
        self.processes = NodeProcesses(folder / "log")
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("test", namespace=namespace, context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}
        self._heard: dict[str, list[Any]] = {}
        self._nodes: list[str] = []
        self.hear("diagnostics")
        self.hear("episode")

    def start(self, name: str, arguments: tuple[str, ...] = (), **parameters: Any) -> None:
        """Start a node under these parameters, and further ROS arguments.

        The simulator is paused until `go`; then it walks one episode, whoever plans another.
        """
        usual = {"start_paused": True, "episodes": 1, "trainer": "ignore"} if name == "simulator" else {}
        self._nodes.append(name)
        path = self.folder / f"{name}.yaml"
        write_parameters(path, {name: {**usual, **parameters}})
        options = (*self.space, "--params-file", str(path), "-r", "/clock:=clock")
        self.processes.start(name, (*options, *arguments))

    def walk(self, controller: dict[str, Any] | None = None, records: bool = False, **simulator: Any) -> None:
        """Start a simulator and a controller under these parameters, and a recorder if it `records`; let them begin."""
        self.start("simulator", **simulator)
        self.start("controller", **controller or {})
        if records:
            self.start("recorder", path=str(self.folder / "recording"))
        self.go()

    @property
    def space(self) -> tuple[str, ...]:
        """ROS arguments that put a node into the namespace."""
        return "--ros-args", "-r", f"__ns:=/{self.namespace}"

    def start_task(self, node: str, task: object, executable: str = "", **parameters: Any) -> None:
        """Start one of the graph's nodes, of a task."""
        package = {"simulator": "rabbit_sim", "trainer": "rl_trainer"}.get(node, "rl_cbf_clf_controller")
        words = [word for name, value in ({"task": task} | parameters).items() for word in ("-p", f"{name}:={value}")]
        self.processes.start(node, (*self.space, *words), executable or node, package)

    def ends(self, number: int = 0) -> list[Any]:
        """The announcements of episodes' ends that were heard, of all or of this number."""
        return [e for e in self.hear("episode") if e.phase == Episode.ENDED and number in (0, e.episode)]

    def ended(self, number: int = 0) -> Any:
        """The newest of them, once it is there."""
        self.wait(lambda: bool(self.ends(number)))
        return self.ends(number)[-1]

    def statuses(self, node: str) -> list[Any]:
        """What a node has said of itself."""
        return [s for m in self.hear("diagnostics") for s in m.status if s.name.endswith(f"/{node}")]

    def figures(self, node: str) -> dict[str, str]:
        """The newest figures in a node's diagnostics, by name; none before the first."""
        return {figure.key: str(figure.value) for said in self.statuses(node)[-1:] for figure in said.values}

    def refused(self, node: str) -> dict[str, int]:
        """How many messages a node says that it has refused, by the reason."""
        return {key: int(value) for key, value in self.figures(node).items() if key.startswith("refused")}

    def log(self, name: str) -> str:
        """What a node has logged so far."""
        return (self.folder / "log" / f"{name}.log").read_text(encoding="utf-8")

    def hear(self, name: str) -> list[Any]:
        """All messages of a topic from now on, and those that are latched; as a recorder, with a deep queue."""
        if name not in self._heard:
            (topic,) = (topic for topic in TOPICS if topic.name == name)
            self._heard[name] = []
            qos = topic.qos
            deep = QoSProfile(depth=TICK.depth, reliability=qos.reliability, durability=qos.durability)
            self.node.create_subscription(topic.type, name, self._heard[name].append, deep)
        return self._heard[name]

    def go(self) -> None:
        """Let the simulator begin, once all hear each other and the test hears what it wants to."""
        self.wait(lambda: not self._not_ready())
        assert self.ask(SetBool, "pause", data=False).success

    def _not_ready(self) -> list[str]:
        said = {s.name.split("/")[-1]: s for m in self.hear("diagnostics") for s in m.status}
        told = {name: n for s in said.values() for name, n in reader_counts(s).items() if name != "diagnostics"}
        published = {t.name for t in TOPICS if t.publisher in self._nodes}
        told = {name: n - (name in self._heard) for name, n in told.items()}  # the test is a reader too
        deaf = [name for name in self._heard if name in published and told.get(name, -1) < 0]
        loud = [name for name in self._nodes if name not in said or said[name].level != OK]
        return deaf + loud + missing_readers(self._nodes, told)

    def say(self, name: str, message: Any) -> None:
        """Publish on a topic, once somebody listens."""
        if name not in self._publishers:
            (topic,) = (topic for topic in TOPICS if topic.name == name)
            publisher = self.node.create_publisher(topic.type, name, topic.qos)
            self._publishers[name] = publisher
            self.wait(lambda: publisher.get_subscription_count() > 0)
            self.spin(0.3)  # the reader may know the writer a little later
        self._publishers[name].publish(message)

    def ask(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service."""
        client = self.node.create_client(kind, name)
        answer = call_service(client, kind.Request(**fields), self.spin, 180.0)
        self.node.destroy_client(client)
        assert answer is not None, f"no answer from {name}"
        return answer

    def wait(self, until: Callable[[], bool], seconds: float = 180.0) -> None:
        """Spin until something holds; a node that ends by itself is an error."""
        end = time.monotonic() + seconds
        while not until():
            assert time.monotonic() < end, f"not within {seconds} s"
            self.processes.check()
            self._executor.spin_once(0.05)

    def spin(self, seconds: float) -> None:
        """Hear what comes."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.processes.check()
            self._executor.spin_once(0.02)

    def close(self) -> None:
        """End all."""
        self.processes.stop()
        self._executor.remove_node(self.node)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)


@contextmanager
def closing_node(node: Any) -> Iterator[Any]:
    """The node, which is gone from the graph afterwards, also after a failed test."""
    try:
        yield node
    finally:
        if hasattr(node, "close"):
            node.close()
        node.destroy_node()


@contextmanager
def in_process(make: Callable[[], Any], *words: str) -> Iterator[Any]:
    """A node of this process under these ROS arguments; it is gone afterwards, also after a failed test."""
    rclpy.init(args=["--ros-args", *words, "--log-level", "fatal"], signal_handler_options=SignalHandlerOptions.NO)
    try:
        with closing_node(make()) as node:
            yield node
    finally:
        rclpy.try_shutdown()


@pytest.fixture
def make_world(tmp_path: Path) -> Iterator[Callable[[str], World]]:
    """Worlds, each in a namespace that no other test has, closed at the end."""
    worlds: list[World] = []

    def make(name: str) -> World:
        folder = tmp_path / name
        folder.mkdir()
        worlds.append(World(folder, f"{name}_{time.monotonic_ns()}"))
        return worlds[-1]

    yield make
    for world in worlds:
        world.close()


@pytest.fixture
def world(make_world: Callable[[str], World]) -> World:
    """One world."""
    return make_world("world")


@pytest.fixture
def root_world(tmp_path: Path) -> Iterator[World]:
    """One in the namespace / itself."""
    world = World(tmp_path, "")
    yield world
    world.close()

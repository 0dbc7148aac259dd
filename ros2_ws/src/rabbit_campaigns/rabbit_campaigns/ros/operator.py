"""An operator at a walking graph: asks for this and that, good and bad, and judges what comes of it."""

import os
import random
import signal
import time
from array import array
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rabbit_bringup.launching.processes import NodeSpec, Processes
from rabbit_msgs.msg import Episode, PolicySwap, PolicyWeights, RabbitState, TorqueCommand
from rabbit_msgs.srv import LoadPolicy, Pause, ResetEpisode
from rabbit_recording.message_header import turn_of
from rabbit_ros.ros.network import choose_network
from rabbit_ros.ros.qos import DIAGNOSTICS, EVENT, WEIGHTS
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rl_cbf_clf_controller.weights import PolicyFile

from rabbit_campaigns.soak_operations import near_policy

PATIENCE = 180.0  # s for an answer: the walk may be waiting for the trainer, on a busy machine
PAUSED_SECONDS = (0.5, 1.0)  # until all that was under way has come; in which nothing may come
GLANCE = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
SIGMAS = (0.0, 0.5, 1.0)  # rad/s^2: of no harm to the walk
PACES = (0.8, 1.0, 1.25)
REFUSED = (  # out of its range, of another type, read-only, unknown
    ("controller", "sigma", -1.0),
    ("controller", "sigma", "loud"),
    ("controller", "eps", 0.05),
    ("controller", "policy", "zero"),
    ("simulator", "pace", 1000.0),
    ("simulator", "stones", 3),
    ("simulator", "no_such_parameter", 1),
)
RECORDER = "recorder"

Answer = tuple[str, str, bool]  # what was asked, what came back, whether that was expected


class Operator:
    """Its operations by name; each waits for what comes of it. `newest`: where the walk is."""

    def __init__(self, namespace: str, folder: Path, policies: tuple[Path, Path], pace: float, seed: int) -> None:
        """`policies`: one that fits the controller and one that does not; `folder` gets the second recordings."""
        choose_network()
        self._namespace, self._folder, self._pace = namespace, folder, pace
        self._good, self._unfit = policies
        self._rng = random.Random(seed)
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("operator", namespace=namespace, context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.newest, self.patience = (0, -1), PATIENCE
        self._episode = Episode()
        self._versions: deque[str] = deque(maxlen=100)  # in force, by the newest torques
        self._accepted: set[str] = set()
        self._published: set[str] = set()  # versions, since something was asked for last
        self._refusals: deque[PolicySwap] = deque(maxlen=20)
        self._said: dict[str, str] = {}
        self._hear()
        self._clients = {
            name: self._node.create_client(kind, name)
            for name, kind in (("load_policy", LoadPolicy), ("reset_episode", ResetEpisode), ("pause", Pause))
        }
        for node in ("controller", "simulator"):
            for what, kind in (("set_parameters", SetParameters), ("get_parameters", GetParameters)):
                self._clients[f"{node}/{what}"] = self._node.create_client(kind, f"{node}/{what}")
        self._processes = Processes(folder / "log")

    def _hear(self) -> None:
        subscribe = self._node.create_subscription
        subscribe(RabbitState, "state", self._on_state, GLANCE, raw=True)
        subscribe(TorqueCommand, "torque", self._on_torque, GLANCE, raw=True)
        subscribe(Episode, "episode", self._on_episode, EVENT)
        subscribe(PolicySwap, "policy_swap", self._on_swap, EVENT)
        subscribe(PolicyWeights, "policy", self._on_policy, WEIGHTS)
        subscribe(DiagnosticArray, "diagnostics", self._on_diagnostics, DIAGNOSTICS)

    def close(self) -> None:
        """Leave the graph; a second recorder ends."""
        self._processes.stop()
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    @property
    def records(self) -> bool:
        """Whether the second recorder runs."""
        return self._processes.runs(RECORDER)

    def spin(self, seconds: float) -> None:
        """Hear what has come, and what comes for so long."""
        end = time.monotonic() + seconds
        self._executor.spin_once(0.0)
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(left)

    def do(self, kind: str) -> Answer:
        """One operation, by its name."""
        doing: dict[str, Callable[[], Answer]] = {
            "good policy": self._load_good,
            "published policy": self._publish_good,
            "unfit policy": lambda: self._load_bad(self._unfit),
            "junk file": self._load_junk,
            "junk message": self._publish_junk,
            "good parameter": self._set_good,
            "refused parameter": self._set_refused,
            "pause": self._pause_and_go_on,
            "reset": self._reset,
            "recorder started": self._start_recorder,
            "recorder ended": self._end_recorder,
        }
        try:
            return doing[kind]()
        except TimeoutError as error:
            return "", str(error), False

    # Policies

    def _load_good(self) -> Answer:
        policy = self._near()
        path = self._folder / f"{policy.version}.safetensors"
        path.write_bytes(policy.encode())
        self._published.clear()
        answer = self._ask("load_policy", LoadPolicy.Request(path=str(path)))
        path.unlink()
        return (policy.version, *self._comes_in_force(policy.version, answer.message))

    def _publish_good(self) -> Answer:
        policy = self._near()
        publisher = self._node.create_publisher(PolicyWeights, "policy", WEIGHTS)
        message = PolicyWeights(version=policy.version, source="operator", data=array("B", policy.encode()))
        self._published.clear()
        publisher.publish(message)
        answer = (policy.version, *self._comes_in_force(policy.version))
        self._node.destroy_publisher(publisher)
        return answer

    def _near(self) -> PolicyFile:
        return near_policy(self._good, self._rng.getrandbits(31))

    def _comes_in_force(self, version: str, reason: str = "") -> tuple[str, bool]:
        """In force, or replaced before the next tick by a newer one, as by a trainer between two episodes."""
        self._versions.clear()
        if reason or not self._wait(lambda: version in self._versions or self._is_replaced()):
            return reason or "not in force", False
        return "in force" if version in self._versions else "replaced before the next tick", True

    def _is_replaced(self) -> bool:
        """Whether torques come of a policy that was published after what was asked last."""
        return not self._published.isdisjoint(self._versions)

    def _load_bad(self, path: Path) -> Answer:
        self._refusals.clear()
        answer = self._ask("load_policy", LoadPolicy.Request(path=str(path)))
        is_refused = not answer.accepted and bool(answer.message) and self._is_told(path.name)
        return path.name, answer.message, is_refused and self._walks_with_accepted()

    def _is_told(self, source: str) -> bool:
        """Whether the controller says that it has refused this, and why."""
        return self._wait(lambda: any(source in swap.source and swap.reason for swap in self._refusals))

    def _walks_with_accepted(self) -> bool:
        """Whether torques come, all of them of policies that were put in force."""
        self._versions.clear()
        return self._wait(lambda: bool(self._versions) and self._accepted.issuperset(self._versions))

    def _load_junk(self) -> Answer:
        path = self._folder / f"junk-{self._rng.getrandbits(32):08x}"
        path.write_bytes(self._junk())
        try:
            return self._load_bad(path)
        finally:
            path.unlink()

    def _publish_junk(self) -> Answer:
        """As a stranger with `ros2 topic pub --once` does."""
        self._refusals.clear()
        source = f"stranger-{self._rng.getrandbits(32):08x}"
        publisher = self._node.create_publisher(PolicyWeights, "policy", WEIGHTS)
        publisher.publish(PolicyWeights(version="x", source=source, data=array("B", self._junk())))
        is_refused = self._is_told(source)
        self._node.destroy_publisher(publisher)
        reasons = [swap.reason for swap in self._refusals if swap.source == source]
        return source, reasons[0] if reasons else "nothing", is_refused and self._walks_with_accepted()

    def _junk(self) -> bytes:
        """Nothing, some random bytes, or a good file with one other byte or without its end."""
        good = self._good.read_bytes()
        at = self._rng.randrange(len(good))
        other = bytes([good[at] ^ self._rng.randint(1, 255)])
        return self._rng.choice((b"", self._rng.randbytes(1000), good[:at] + other + good[at + 1 :], good[:at]))

    # Parameters

    def _set_good(self) -> Answer:
        node, name, value = "controller", "sigma", self._rng.choice(SIGMAS)
        if self._pace and self._rng.random() < 0.5:
            node, name, value = "simulator", "pace", self._pace * self._rng.choice(PACES)
        accepted, reason = self._set(node, name, value)
        now = self._get(node, name)
        answer = f"{'accepted' if accepted else reason}; is {now}"
        return f"{node} {name} = {value:g}", answer, accepted and now == value

    def _set_refused(self) -> Answer:
        node, name, value = self._rng.choice(REFUSED)
        before = self._get(node, name)
        accepted, reason = self._set(node, name, value)
        now = self._get(node, name)
        right = not accepted and bool(reason) and now == before
        return f"{node} {name} = {value}", f"{'accepted' if accepted else reason}; is {now}", right

    def _set(self, node: str, name: str, value: Any) -> tuple[bool, str]:
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        (result,) = self._ask(f"{node}/set_parameters", request).results
        return result.successful, result.reason

    def _get(self, node: str, name: str) -> Any:
        values = self._ask(f"{node}/get_parameters", GetParameters.Request(names=[name])).values
        return parameter_value_to_python(values[0]) if values else None

    # The walk

    def _pause_and_go_on(self) -> Answer:
        until_still, still = PAUSED_SECONDS
        accepted = self._ask("pause", Pause.Request(paused=True)).accepted
        self.spin(until_still)
        before = self.newest
        self.spin(still)
        stood = self.newest == before
        accepted &= self._ask("pause", Pause.Request(paused=False)).accepted
        goes_on = self._wait(lambda: self.newest != before)
        told = f"{'stood' if stood else 'walked on'}, {'goes on' if goes_on else 'does not go on'}"
        return f"{still:g} s", told, accepted and stood and goes_on

    def _reset(self) -> Answer:
        seed = self._rng.getrandbits(32)
        before = self.newest[0]
        answer = self._ask("reset_episode", ResetEpisode.Request(seed=seed))
        begins = answer.accepted and self._wait(lambda: self.newest[0] == answer.episode)
        begins = begins and self._wait(lambda: self._episode.episode == answer.episode)
        right = begins and answer.episode > before and self._episode.seed == seed
        return f"seed {seed}", answer.message or f"episode {answer.episode}", right

    # A second recorder

    def _start_recorder(self) -> Answer:
        path = self._folder / "recording"
        remaps = (f"__ns:=/{self._namespace.strip('/')}", "__node:=second_recorder", "/clock:=clock")
        words = ("-p", f"path:={path}", *(word for each in remaps for word in ("-r", each)), "--log-level", "warn")
        self._said.pop("second_recorder", None)
        self._processes.start(NodeSpec("rabbit_recording", RECORDER, ("--ros-args", *words)))
        records = self._wait(lambda: self._said.get("second_recorder") == "recording")
        return path.name, self._said.get("second_recorder", "not heard of"), records

    def _end_recorder(self) -> Answer:
        os.kill(self._processes.pid(RECORDER), signal.SIGTERM)
        code = self._processes.wait(RECORDER, PATIENCE)
        return "SIGTERM", f"exit code {code}", code == 0

    # Questions and what is heard

    def _ask(self, name: str, request: Any) -> Any:
        """Asked once: a reset must not be asked for twice. Raises `TimeoutError`."""
        client = self._clients[name]
        if not client.wait_for_service(timeout_sec=self.patience):
            raise TimeoutError(f"no service {name}")
        answer = client.call_async(request)
        if not self._wait(answer.done):
            raise TimeoutError(f"no answer from {name} in {self.patience:g} s")
        return answer.result()

    def _wait(self, until: Callable[[], bool]) -> bool:
        """Hear until something holds; False if it does not within `patience`."""
        end = time.monotonic() + self.patience
        while not until():
            if time.monotonic() > end:
                return False
            self.spin(0.02)
        return True

    def _on_state(self, data: bytes) -> None:
        self.newest = turn_of(data)

    def _on_torque(self, data: bytes) -> None:
        self._versions.append(deserialize_message(data, TorqueCommand).policy_version)

    def _on_episode(self, message: Episode) -> None:
        self._episode = message

    def _on_policy(self, message: PolicyWeights) -> None:
        self._published.add(message.version)

    def _on_swap(self, message: PolicySwap) -> None:
        if message.accepted:
            self._accepted.add(message.version)
        else:
            self._refusals.append(message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._said[status.name.split("/")[-1]] = status.message

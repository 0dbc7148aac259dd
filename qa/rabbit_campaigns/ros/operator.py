"""An operator at a walking graph: asks for this and that, good and bad, and judges what comes of it."""

import random
import time
from array import array
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from rabbit_common.ros.client import SERVICE_TYPES, TOPIC, GraphClient
from rabbit_common.ros.services import AGAIN_SECONDS
from rabbit_msgs.msg import Episode, PolicySwap, PolicyWeights, TorqueCommand
from rabbit_recording.message_header import turn_of
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

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

Answer = tuple[str, str, bool]  # what was asked, what came back, whether that was expected


class Operator(GraphClient):
    """A method for each kind of operation; each waits for what comes of it. `newest`: where the walk is."""

    service_types: ClassVar = {**SERVICE_TYPES, "get_parameters": GetParameters, "set_parameters": SetParameters}

    def __init__(
        self,
        namespace: str,
        folder: Path,
        policies: tuple[Path, Path],
        pace: float,
        seed: int,
        check: Callable[[], object] = lambda: None,
    ) -> None:
        """`policies`: one that fits the controller and one that does not; `folder`: for files that are loaded."""
        super().__init__("operator", namespace, "/", check)
        self._folder, self._pace = folder, pace
        self._good, self._unfit = policies
        self._rng = random.Random(seed)
        self.newest, self.patience = (0, -1), PATIENCE
        self._episode = Episode()
        self._versions: deque[str] = deque(maxlen=100)  # in force, by the newest torques
        self._accepted: set[str] = set()
        self._published: set[str] = set()  # versions, since something was asked for last
        self._refusals: deque[PolicySwap] = deque(maxlen=20)
        self.hear("state", self._on_state, GLANCE, raw=True)
        self.hear("torque", self._on_torque, GLANCE, raw=True)
        self.hear("episode", self._on_episode)
        self.hear("policy_swap", self._on_swap)
        self.hear("policy", self._on_policy)

    def do(self, kind: str) -> Answer:
        """One operation, by the name of its method: `good policy` is `good_policy`."""
        try:
            answer: Answer = getattr(self, kind.replace(" ", "_"))()
        except TimeoutError as error:
            return "", str(error), False
        return answer

    # Policies

    def good_policy(self) -> Answer:
        """Load one that acts as the first."""
        policy = near_policy(self._good, self._rng.getrandbits(31))
        path = self._folder / f"{policy.version}.safetensors"
        path.write_bytes(policy.encode())
        self._published.clear()
        answer = self._asked_once("load_policy", policy=str(path))
        path.unlink()
        return (policy.version, *self._comes_in_force(policy.version, answer.message))

    def published_policy(self) -> Answer:
        """Publish one that acts as the first."""
        policy = near_policy(self._good, self._rng.getrandbits(31))
        self._published.clear()
        publisher = self.node.create_publisher(PolicyWeights, "policy", TOPIC["policy"].qos)
        publisher.publish(PolicyWeights(version=policy.version, source="operator", data=array("B", policy.encode())))
        comes = self._comes_in_force(policy.version)
        self.node.destroy_publisher(publisher)
        return (policy.version, *comes)

    def _comes_in_force(self, version: str, reason: str = "") -> tuple[str, bool]:
        """Whether it comes in force, or a newer one replaces it before the next tick, as a trainer's does."""
        self._versions.clear()

        def is_replaced() -> bool:  # torques come of a policy that was published after what was asked last
            return not self._published.isdisjoint(self._versions)

        if reason or not self._wait(lambda: version in self._versions or is_replaced()):
            return reason or "not in force", False
        return "in force" if version in self._versions else "replaced before the next tick", True

    def unfit_policy(self) -> Answer:
        """Load one that the controller must refuse."""
        self._refusals.clear()
        answer = self._asked_once("load_policy", policy=str(self._unfit))
        name = self._unfit.name
        is_refused = not answer.success and bool(answer.message)
        if is_refused and self._wait(lambda: any(name in swap.source and swap.reason for swap in self._refusals)):
            self._versions.clear()  # torques come, all of them of policies that were put in force
            walks = self._wait(lambda: bool(self._versions) and self._accepted.issuperset(self._versions))
            return name, answer.message, walks
        return name, answer.message, False

    # Parameters

    def good_parameter(self) -> Answer:
        """Set the noise, or the pace."""
        node, name, value = "controller", "sigma", self._rng.choice(SIGMAS)
        if self._pace and self._rng.random() < 0.5:
            node, name, value = "simulator", "pace", self._pace * self._rng.choice(PACES)
        what, reason, now = self._set(node, name, value)
        return what, f"{reason or 'accepted'}; is {now}", not reason and now == value

    def refused_parameter(self) -> Answer:
        """Set what must be refused."""
        node, name, value = self._rng.choice(REFUSED)
        before = self._parameter(node, name)
        what, reason, now = self._set(node, name, value)
        return what, f"{reason or 'accepted'}; is {now}", bool(reason) and now == before

    def _set(self, node: str, name: str, value: Any) -> tuple[str, str, Any]:
        """What is set, why it is refused, if it is, and what is in force afterwards."""
        wanted = [Parameter(name, value=value).to_parameter_msg()]
        (result,) = self._asked(f"{node}/set_parameters", parameters=wanted).results
        reason = "" if result.successful else result.reason or "no reason"
        return f"{node} {name} = {value}", reason, self._parameter(node, name)

    def _parameter(self, node: str, name: str) -> Any:
        """The value that a node has in force, None of an unknown parameter."""
        values = self._asked(f"{node}/get_parameters", names=[name]).values
        return parameter_value_to_python(values[0]) if values else None

    # The walk

    def pause(self) -> Answer:
        """Hold the robot for a while."""
        until_still, still = PAUSED_SECONDS
        accepted = self._asked_once("pause", data=True).success
        self.spin(until_still)
        before = self.newest
        self.spin(still)
        stood = self.newest == before
        accepted &= self._asked_once("pause", data=False).success
        goes_on = self._wait(lambda: self.newest != before)
        told = f"{'stood' if stood else 'walked on'}, {'goes on' if goes_on else 'does not go on'}"
        return f"{still:g} s", told, accepted and stood and goes_on

    def reset(self) -> Answer:
        """Begin another episode."""
        seed, before = self._rng.getrandbits(32), self.newest[0]
        answer = self._asked_once("reset_episode", seed=seed)
        begins = answer.success and self._wait(lambda: self.newest[0] == answer.episode)
        begins = begins and self._wait(lambda: self._episode.episode == answer.episode)
        right = begins and answer.episode > before and self._episode.seed == seed
        return f"seed {seed}", answer.message or f"episode {answer.episode}", right

    # Questions and what is heard

    def _asked_once(self, name: str, **fields: Any) -> Any:
        """Asked once: a reset must not be asked for twice. Raises `TimeoutError`."""
        return self._asked(name, self.patience, **fields)

    def _asked(self, name: str, again: float = AGAIN_SECONDS, **fields: Any) -> Any:
        if (answer := self.ask(name, self.patience, again, **fields)) is None:
            raise TimeoutError(f"no answer from {name} in {self.patience:g} s")
        return answer

    def _wait(self, until: Callable[[], bool]) -> bool:
        end = time.monotonic() + self.patience
        while not (holds := until()) and time.monotonic() <= end:
            self.check()
            self.spin(0.02)
        return holds

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

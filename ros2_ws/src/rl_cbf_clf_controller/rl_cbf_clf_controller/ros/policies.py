"""The controller's policies: which is in force, which ones wait until they are due, why others were refused.

They come in by the topic `policy`, if it is heard, or by service, by name. The node's thread only takes the bytes or
the name. Another thread decodes and checks them, and what is due is put in force between two ticks. The service is
answered when the check is done.
"""

import queue
import threading
from array import array
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

from pydantic import Field
from rabbit_common.guard import guarded, reason_of
from rabbit_common.message_checks import Refused
from rabbit_common.priority import step_back
from rabbit_common.ros.checked_node import bounds, check_size, decoded
from rabbit_common.ros.qos import EVENT
from rabbit_common.ros.services import create_async_service
from rabbit_description.bounded_file import FileError, read_bytes
from rabbit_description.validation import Checked, one_line
from rabbit_msgs.msg import PolicySwap, PolicyWeights
from rabbit_msgs.srv import LoadPolicy
from rclpy.node import Node
from rclpy.task import Future

from rl_cbf_clf_controller.weights import SIZE_LIMIT, PolicyFile, PolicyFileError, decode, policy_path

ZERO = "zero"
UNCHECKED = 20  # policies that wait for their check
LONGEST_NAME = 500  # characters, in what is told of a policy
WAITING = 4  # policies kept until they are due; an episode may name an older one than the newest
REFUSED = 20  # refusals of policies kept: an episode may name one of them
LIMITS = bounds(PolicyWeights)
Fit = Callable[[PolicyFile], Any]  # the policy of a file, for this controller; raises PolicyFileError


class NodeParameters(Checked):
    """Which policies the node walks with, and its priority."""

    policy: str = Field(
        ZERO,
        description="policy to begin with: zero, the name of a shipped one, or a file; "
        "of a task also nominal, oracle, one of its own controllers, or KIND:FILE",
    )
    swap_at: Literal["tick", "episode", "never"] = Field(
        "tick",
        description="when published policies take effect; with never they are not heard; "
        "one loaded by service always does at the next tick",
    )
    priority: int = Field(0, ge=0, le=99, description="SCHED_FIFO priority, where permitted; 0: an ordinary process")


@dataclass(frozen=True)
class CheckedPolicy:
    """The word on what came in: a policy ready to use, or the reason it is refused.

    `version` is computed from the bytes, whatever a message says; empty when they are no policy. `policy`: what the
    controller makes of them, None of a refused one.
    """

    version: str
    source: str
    policy: Any = None
    reason: str = ""
    data: bytes = b""
    by_operator: bool = False


class Policies:
    """`in_force`: the policy of the ticks that come. Each change is announced, with its bytes, and each refusal."""

    def __init__(
        self,
        node: Node,
        parameters: NodeParameters,
        built_in: Mapping[str, CheckedPolicy],
        fit: Fit,
        sender: str,
        on_checked: Callable[[], object],
    ) -> None:
        """Begin with one that is built in, the shipped policy of this name, or the file; raises `PolicyFileError`.

        `built_in`: by name, those that no file holds; an operator may ask for them too. `on_checked` is called in the
        executor once there is something to `take`.
        """
        self._node, self._sender, self._on_checked = node, sender, on_checked
        self._swap_at, self.hears_published = parameters.swap_at, parameters.swap_at != "never"
        self._fit, self._built_in = fit, built_in
        self.in_force = self._named(parameters.policy)
        if self.in_force.policy is None:
            raise PolicyFileError(f"policy {parameters.policy}: {self.in_force.reason}")
        self._checked: deque[CheckedPolicy] = deque()  # from the other thread
        self._waiting: deque[CheckedPolicy] = deque(maxlen=WAITING)  # the newest last
        self._refused: deque[CheckedPolicy] = deque(maxlen=REFUSED)
        self._swaps = node.create_publisher(PolicySwap, "policy_swap", EVENT)
        self._tell(self.in_force, (0, 0))
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="policies", daemon=True)
        self._thread.start()
        if self.hears_published:  # deeper than a writer's history: with several, one must not push out another's
            node.create_subscription(PolicyWeights, "policy", self._on_bytes, EVENT, raw=True)
        create_async_service(node, LoadPolicy, "load_policy", self._on_load)

    def close(self) -> None:
        """End the thread that checks."""
        self._jobs.put(None)
        self._thread.join(timeout=2.0)

    @property
    def newest(self) -> str:
        """Version of the newest that waits; empty: none does."""
        return self._waiting[-1].version if self._waiting else ""

    # In the node's thread

    def _on_bytes(self, data: bytes) -> None:
        try:
            check_size(data)
        except Refused as error:
            self._keep(CheckedPolicy("", "policy", reason=str(error)))
            return
        self._check("policy", partial(self._published, data), self._keep)

    def _on_load(self, request: LoadPolicy.Request, response: LoadPolicy.Response) -> Future:
        answer = Future(executor=self._node.executor)

        def tell(checked: CheckedPolicy) -> None:
            self._keep(replace(checked, by_operator=True))
            response.success, response.message = checked.policy is not None, checked.reason
            response.version = checked.version
            answer.set_result(response)

        self._check(one_line(request.policy, LONGEST_NAME), partial(self._named, request.policy), tell)
        return answer

    def _check(self, source: str, check: Callable[[], CheckedPolicy], tell: Callable[[CheckedPolicy], None]) -> None:
        """Have the other thread `check`, and `tell` the result: a refusal, whatever `check` raised."""

        def refuse(reason: str) -> CheckedPolicy:
            return CheckedPolicy("", source, reason=reason)

        if self._jobs.qsize() >= UNCHECKED:
            tell(refuse(f"too many: {UNCHECKED} policies wait for their check already"))
        else:
            self._jobs.put(lambda: tell(guarded(check, refuse)()))

    def take(
        self, turn: tuple[int, int], accept: Callable[[str], None], refuse: Callable[[str, Refused], None]
    ) -> None:
        """Keep those that came in and were checked."""
        while self._checked:
            checked = self._checked.popleft()
            if checked.policy is not None:
                accept("policy")
                self._waiting.append(checked)
                continue
            if checked.version:
                self._refused.append(checked)
            refuse("policy", Refused("not fit", f"{checked.source}: {checked.reason}"))
            self._tell(checked, turn)

    def missing(self, named: str) -> str:
        """The policy that an episode names, where it is not here."""
        return f"policy {named}" if named and not self._here(named) else ""

    def refusal(self, named: str) -> str:
        """Why the policy that an episode names cannot come; empty when it may."""
        refused = [policy.reason for policy in self._refused if policy.version == named]
        return f"policy {named} was refused: {refused[-1]}" if refused else ""

    def swap(self, turn: tuple[int, int], named: str) -> Any:
        """Put in force what is due at this tick; what came before it is due no more. Returns it, None: no change."""
        episode, tick = turn
        due = [policy for policy in self._waiting if policy.by_operator or self._swap_at == "tick" or tick == 0]
        new = self._here(named) if named else due[-1] if due else None
        while new in self._waiting:
            self._waiting.popleft()
        if new is None or new.version == self.in_force.version:
            return None
        self.in_force = new
        self._tell(new, turn)
        since = f"from tick {tick} of episode {episode} on"
        self._node.get_logger().info(f"policy {new.version} of {new.source} in force {since}")
        return new.policy

    def _here(self, version: str) -> CheckedPolicy | None:
        here = (self.in_force, *self._waiting)
        return self._built_in.get(version) or next((policy for policy in here if policy.version == version), None)

    def _tell(self, checked: CheckedPolicy, turn: tuple[int, int]) -> None:
        """A policy is in force since `turn`, episode and tick, or was refused then."""
        message = PolicySwap(
            episode=max(turn[0], 0),
            tick=max(turn[1], 0),
            version=checked.version,
            source=checked.source[-128:],
            accepted=checked.policy is not None,
            reason=checked.reason,
            data=array("B", checked.data),
            sender=self._sender,
        )
        self._swaps.publish(message)

    # In the thread that checks

    def _work(self) -> None:
        step_back()  # a tick goes before a check
        while job := self._jobs.get():
            guarded(job, self._node.get_logger().error)()

    def _published(self, data: bytes) -> CheckedPolicy:
        """What a message brings; raises `Refused`."""
        message = decoded(data, PolicyWeights, LIMITS)
        checked = self._decode(bytes(message.data), message.source)
        if checked.policy is not None and checked.version != message.version:
            text = f"the message says version {message.version}; its content has {checked.version}"
            return CheckedPolicy("", message.source, reason=text)
        return checked

    def _named(self, name: str) -> CheckedPolicy:
        """One that is built in, the shipped policy of this name, or the file."""
        if name in self._built_in:
            return self._built_in[name]
        source = one_line(name, LONGEST_NAME)
        try:
            data = read_bytes(policy_path(name), SIZE_LIMIT)
        except FileError as error:
            reason = f"cannot read it, none of {', '.join(self._built_in)}, no shipped one, no file: {error}"
            return CheckedPolicy("", source, reason=reason)
        return self._decode(data, source)

    def _decode(self, data: bytes, source: str) -> CheckedPolicy:
        version = ""
        try:
            file = decode(data)
            version = file.version
            return CheckedPolicy(version, source, self._fit(file), data=data)
        except Exception as error:  # `fit` may be another package's: those bytes are refused under their version
            return CheckedPolicy(version, source, reason=reason_of(error))

    def _keep(self, checked: CheckedPolicy) -> None:
        self._checked.append(checked)
        if self._node.executor is not None:
            self._node.executor.create_task(self._on_checked)

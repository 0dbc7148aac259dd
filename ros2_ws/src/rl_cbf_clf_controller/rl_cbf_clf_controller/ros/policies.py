"""The controller's policies: which is in force, which ones wait until they are due, why others were refused.

They are checked in another thread (`policy_loader.py`) and put in force between two ticks.
"""

from collections import deque
from collections.abc import Callable

from rabbit_common.message_checks import Refused
from rabbit_common.ros.qos import EVENT
from rabbit_description.bounded_file import FileError, read_bytes
from rabbit_description.gait import Gaits
from rabbit_msgs.msg import PolicySwap
from rclpy.node import Node

from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy, ZeroPolicy
from rl_cbf_clf_controller.ros.messages import swap_message
from rl_cbf_clf_controller.ros.node_parameters import ZERO, NodeParameters
from rl_cbf_clf_controller.ros.policy_loader import CheckedPolicy, PolicyLoader, check
from rl_cbf_clf_controller.weights import SIZE_LIMIT, PolicyFileError, policy_path

WAITING = 4  # policies kept until they are due; an episode may name an older one than the newest
REFUSED = 20  # refusals of policies kept: an episode may name one of them


class Policies:
    """`in_force`: the policy of the ticks that come. Each change is announced, with its bytes, and each refusal."""

    def __init__(
        self,
        node: Node,
        own: NodeParameters,
        parameters: ControllerParameters,
        gaits: Gaits,
        sender: str,
        on_checked: Callable[[], object],
    ) -> None:
        """Begin with zero, the shipped policy of this name, or the file; raises `PolicyFileError`.

        `on_checked` is called in the executor once there is something to `take`.
        """
        self._zero = CheckedPolicy(ZERO, "built in", False, ZeroPolicy(parameters.problem))
        self.in_force = self._zero if own.policy == ZERO else first_policy(own.policy, parameters, gaits)
        self._node, self._swap_at, self._sender, self._on_checked = node, own.swap_at, sender, on_checked
        self._checked: deque[CheckedPolicy] = deque()  # from the other thread
        self._waiting: deque[CheckedPolicy] = deque(maxlen=WAITING)  # the newest last
        self._refused: deque[CheckedPolicy] = deque(maxlen=REFUSED)
        self._swaps = node.create_publisher(PolicySwap, "policy_swap", EVENT)
        self._tell(self.in_force, (0, 0))
        self._loader = PolicyLoader(node, parameters, gaits, self._keep, own.swap_at != "never")

    def close(self) -> None:
        """End the thread that checks."""
        self._loader.close()

    @property
    def newest(self) -> str:
        """Version of the newest that waits; empty: none does."""
        return self._waiting[-1].version if self._waiting else ""

    def take(
        self, turn: tuple[int, int], accept: Callable[[str], None], refuse: Callable[[str, Refused], None]
    ) -> None:
        """Keep what was found of those that came in."""
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
        return "" if self._swap_at == "never" or not named or self._here(named) else f"policy {named}"

    def refusal(self, named: str) -> str:
        """Why the policy that an episode names cannot come; empty when it may."""
        refused = [d.reason for d in self._refused if d.version == named and self._swap_at != "never"]
        return f"policy {named} was refused: {refused[-1]}" if refused else ""

    def swap(self, turn: tuple[int, int], named: str) -> Policy | None:
        """Put in force what is due at this tick; what came before it is due no more. Returns it, None: no change."""
        episode, tick = turn
        wanted = "" if self._swap_at == "never" else named
        due = [d for d in self._waiting if d.by_operator or self._swap_at == "tick" or tick == 0]
        new = self._here(wanted) if wanted else due[-1] if due else None
        while new in self._waiting:
            self._waiting.popleft()
        if new is None or new.version == self.in_force.version:
            return None
        self.in_force = new
        self._tell(new, turn)
        since = f"from tick {tick} of episode {episode} on"
        self._node.get_logger().info(f"policy {new.version} of {new.source} in force {since}")
        return new.policy

    def _tell(self, checked: CheckedPolicy, turn: tuple[int, int]) -> None:
        self._swaps.publish(swap_message(checked, turn, self._sender))

    def _keep(self, checked: CheckedPolicy) -> None:
        """Called in the other thread."""
        self._checked.append(checked)
        if self._node.executor is not None:
            self._node.executor.create_task(self._on_checked)

    def _here(self, version: str) -> CheckedPolicy | None:
        return next((d for d in (self._zero, self.in_force, *self._waiting) if d.version == version), None)


def first_policy(name: str, parameters: ControllerParameters, gaits: Gaits) -> CheckedPolicy:
    """The shipped policy of this name, or the file; raises `PolicyFileError`."""
    try:
        checked = check(read_bytes(policy_path(name), SIZE_LIMIT), name, parameters, gaits)
    except FileError as error:
        raise PolicyFileError(f"policy {name}: neither a shipped one nor a file: {error}") from error
    if checked.policy is None:
        raise PolicyFileError(f"policy {name}: {checked.reason}")
    return checked

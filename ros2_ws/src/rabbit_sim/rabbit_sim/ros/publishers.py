"""What the simulator tells: the messages of a tick, and where the episode stands."""

from collections.abc import Sequence

from builtin_interfaces.msg import Time
from rabbit_description.state import RobotState, StonePreview
from rabbit_msgs.msg import Episode, RabbitState
from rabbit_msgs.msg import Landing as LandingMessage
from rabbit_msgs.msg import StonePreview as PreviewMessage
from rabbit_ros.ros.conversions import joint_state, preview_message, state_message
from rabbit_ros.ros.qos import EVENT, TICK
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from rabbit_sim.simulation import Landing


class SimulatorPublishers:
    """The simulator's publishers."""

    def __init__(self, node: Node) -> None:
        self._states = node.create_publisher(RabbitState, "state", TICK)
        self._joints = node.create_publisher(JointState, "joint_states", TICK)
        self._clock = node.create_publisher(Clock, "clock", TICK)
        self._previews = node.create_publisher(PreviewMessage, "preview", EVENT)
        self._landings = node.create_publisher(LandingMessage, "landing", EVENT)
        self._episodes = node.create_publisher(Episode, "episode", EVENT)
        self.begin()

    @property
    def readers(self) -> int:
        """Nodes that hear the state."""
        return int(self._states.get_subscription_count())

    def begin(self) -> None:
        """Another episode begins."""
        self._preview: StonePreview | None = None
        self._landings_told = 0

    def episode(self, message: Episode) -> None:
        """Where the episode stands."""
        self._episodes.publish(message)

    def tick(self, state: RobotState, episode: int, at: Time, landings: Sequence[Landing]) -> None:
        """A tick; what the controller needs with the state goes before it. `landings`: all of the episode."""
        if state.preview is not None and state.preview != self._preview:
            self._previews.publish(preview_message(state.preview, episode, at))
        self._preview = state.preview
        self._states.publish(state_message(state, episode, at))
        self._clock.publish(Clock(clock=at))  # while the controller works
        self._joints.publish(joint_state(state, at))
        for landing in landings[self._landings_told :]:
            fields = {name: getattr(landing, name) for name in ("tick", "index", "l", "l_min", "l_max", "on_stone")}
            self._landings.publish(LandingMessage(stamp=at, episode=episode, **fields))
        self._landings_told = len(landings)

    def again(self, state: RobotState, episode: int, at: Time) -> None:
        """What the answer to a tick needs: its reader may just have come, or have heard something else."""
        if state.preview is not None:
            self._previews.publish(preview_message(state.preview, episode, at))
        self._states.publish(state_message(state, episode, at))


def beginning(e: Episode) -> str:
    """The log's line, as in `episode 2 begins: seed 8, 20 stones, policy 1f2e3d4c5b6a`."""
    policy = f", policy {e.policy_version}" if e.policy_version else ""
    return f"episode {e.episode} begins: seed {e.seed}, {e.stones} stones{policy}"


def ending(e: Episode) -> str:
    """The log's line, as in `episode 2 ends, fall: 7 of 20 stones, 341 ticks`; a reason goes last."""
    walked = e.touchdowns - (e.outcome == "miss")
    reason = f": {e.reason}" if e.reason else ""
    return f"episode {e.episode} ends, {e.outcome}: {walked} of {e.stones} stones, {e.tick} ticks{reason}"

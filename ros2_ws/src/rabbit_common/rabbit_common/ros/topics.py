"""The graph's topics in one table: what the recorder records and docs/topics.md lists. Names are relative."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rabbit_msgs import msg
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState

from rabbit_common.ros.qos import DIAGNOSTICS, EVENT, TICK, WEIGHTS


@dataclass(frozen=True)
class Topic:
    """A topic's type and QoS, the node that publishes it and those that need it. The recorder reads them all.

    `beside`: the node without which nobody publishes it.
    """

    name: str
    type: Any
    qos: QoSProfile
    publisher: str
    readers: tuple[str, ...] = ()
    beside: str = ""

    @property
    def type_name(self) -> str:
        """As in `rabbit_msgs/msg/RabbitState`."""
        package, kind, *_ = self.type.__module__.split(".")
        return f"{package}/{kind}/{self.type.__name__}"


TOPICS = (
    # the state: of the simulator, or of the estimator where there is one
    Topic("state", msg.RabbitState, TICK, "simulator", ("controller", "trainer", "launcher", "viewer")),
    Topic("joint_states", JointState, TICK, "simulator", ("estimator",)),
    Topic("imu", Imu, TICK, "simulator", ("estimator",), beside="estimator"),
    Topic("measured", msg.RabbitState, TICK, "simulator", ("estimator",), beside="estimator"),
    Topic("true_state", msg.RabbitState, TICK, "simulator", beside="estimator"),
    Topic("clock", Clock, TICK, "simulator"),
    Topic("timing", msg.Timing, TICK, "simulator"),
    Topic("preview", msg.StonePreview, EVENT, "simulator", ("controller", "viewer")),
    Topic("landing", msg.Landing, EVENT, "simulator", ("launcher", "viewer")),
    Topic("episode", msg.Episode, EVENT, "simulator", ("estimator", "controller", "trainer", "launcher", "viewer")),
    Topic("torque", msg.TorqueCommand, TICK, "controller", ("simulator", "trainer")),
    Topic("controller_state", msg.ControllerState, TICK, "controller", ("trainer", "launcher", "viewer")),
    Topic("policy_swap", msg.PolicySwap, EVENT, "controller", ("trainer",)),
    Topic("controller_settings", msg.ControllerSettings, EVENT, "controller", ("viewer",)),
    Topic("transition", msg.Transition, TICK, "trainer"),
    Topic("policy", msg.PolicyWeights, WEIGHTS, "trainer"),  # read by a controller unless its swap_at is never
    Topic("episode_plan", msg.EpisodePlan, EVENT, "trainer", ("simulator", "launcher")),
    Topic("diagnostics", DiagnosticArray, DIAGNOSTICS, "all", ("launcher",)),
)


def published_by(nodes: Collection[str]) -> list[Topic]:
    """The topics that a graph of these nodes has."""
    return [topic for topic in TOPICS if topic.publisher in nodes and (not topic.beside or topic.beside in nodes)]


def missing_readers(
    nodes: Collection[str], counted: Mapping[str, int], others: Mapping[str, int] | None = None
) -> list[str]:
    """Topics of `nodes` that have fewer readers matched than those nodes need; `counted`, by topic.

    `others`: readers that are none of `nodes`, by topic: they must not stand in for one of them.
    """

    def wanted(topic: Topic) -> int:
        return len({*topic.readers, "recorder"} & set(nodes)) + (others or {}).get(topic.name, 0)

    return [topic.name for topic in published_by(nodes) if counted.get(topic.name, 0) < wanted(topic)]

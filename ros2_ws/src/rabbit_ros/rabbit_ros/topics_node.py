"""The graph's topics in one table: what the recorder records and docs/topics.md lists. Names are relative."""

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rabbit_msgs import msg
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from rabbit_ros.qos_node import DIAGNOSTICS, EVENT, TICK, WEIGHTS


@dataclass(frozen=True)
class Topic:
    """A topic's type, QoS and the node that publishes it."""

    name: str
    type: Any
    qos: QoSProfile
    publisher: str

    @property
    def type_name(self) -> str:
        """As in `rabbit_msgs/msg/RabbitState`."""
        package, kind, *_ = self.type.__module__.split(".")
        return f"{package}/{kind}/{self.type.__name__}"


TOPICS = (
    Topic("state", msg.RabbitState, TICK, "simulator"),
    Topic("joint_states", JointState, TICK, "simulator"),
    Topic("clock", Clock, TICK, "simulator"),
    Topic("preview", msg.StonePreview, EVENT, "simulator"),
    Topic("landing", msg.Landing, EVENT, "simulator"),
    Topic("episode", msg.Episode, EVENT, "simulator"),
    Topic("torque", msg.TorqueCommand, TICK, "controller"),
    Topic("controller_state", msg.ControllerState, TICK, "controller"),
    Topic("policy_swap", msg.PolicySwap, EVENT, "controller"),
    Topic("transition", msg.Transition, TICK, "trainer"),
    Topic("policy", msg.PolicyWeights, WEIGHTS, "trainer"),
    Topic("episode_plan", msg.EpisodePlan, EVENT, "trainer"),
    Topic("diagnostics", DiagnosticArray, DIAGNOSTICS, "all"),
)

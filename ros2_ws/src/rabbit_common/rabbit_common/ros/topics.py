"""The graph's topics and services in two tables: what the recorder records and docs/topics.md lists.

Names are relative.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rabbit_msgs import msg, srv
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_srvs.srv import SetBool

from rabbit_common.ros.qos import DIAGNOSTICS, EVENT, TICK, WEIGHTS

A_TICK, IN_LAB = "1 a tick", "1 a tick, lab"


def type_name(kind: Any) -> str:
    """The type's name, as in `rabbit_msgs/msg/RobotState`."""
    return "/".join((*kind.__module__.split(".")[:2], kind.__name__))


@dataclass(frozen=True)
class Topic:
    """A topic's type and QoS, the node that publishes it and those that need it. The recorder reads them all.

    `rate`: when it is published; lab: with `sensors: lab` alone, read: while a node reads it. `carries`: for the page;
    empty: what the message's definition says. `beside`: the node without which nobody publishes it.
    """

    name: str
    type: Any
    qos: QoSProfile
    rate: str
    publisher: str
    readers: tuple[str, ...] = ()
    carries: str = ""
    beside: str = ""

    @property
    def type_name(self) -> str:
        """The name of its type."""
        return type_name(self.type)


@dataclass(frozen=True)
class Service:
    """A service's type and the node that answers. `does`: for the page, as `carries` of a topic."""

    name: str
    type: Any
    node: str
    does: str = ""


TOPICS = (
    Topic("state", msg.RobotState, TICK, A_TICK, "simulator", ("controller", "trainer", "viewer"),
          "what is measured of the robot; in a lab from the estimator"),
    Topic("joint_states", JointState, TICK, A_TICK, "simulator", ("estimator",),
          "the same q, dq by the URDF's joint names, and torques; in a lab what the encoders say"),
    Topic("imu", Imu, TICK, IN_LAB, "simulator", ("estimator",),
          "in the torso at the hip: attitude, pitch rate, mean specific force over the tick", "estimator"),
    Topic("measured", msg.RobotState, TICK, IN_LAB, "simulator", ("estimator",),
          "all that `state` will have but q and dq, which are NaN", "estimator"),
    Topic("true_state", msg.RobotState, TICK, f"{IN_LAB}, read", "simulator", (),
          "the true q, dq and foot forces, for judges; no node acts on it", "estimator"),
    Topic("clock", Clock, TICK, f"{A_TICK}, read", "simulator", (),
          "simulated time, continuous over episodes"),
    Topic("timing", msg.Timing, TICK, "1 a tick in real time", "simulator"),
    Topic("preview", msg.StonePreview, EVENT, "1 a stone", "simulator", ("controller", "viewer")),
    Topic("landing", msg.Landing, EVENT, "1 a stone", "simulator", ("launcher", "viewer")),
    Topic("episode", msg.Episode, EVENT, "3 an episode", "simulator",
          ("simulator", "estimator", "controller", "trainer", "launcher", "viewer")),
    Topic("torque", msg.TorqueCommand, TICK, A_TICK, "controller", ("simulator", "trainer")),
    Topic("controller_state", msg.ControllerState, TICK, f"{A_TICK}, read", "controller",
          ("trainer", "viewer")),
    Topic("learner_terms", msg.LearnerTerms, TICK, f"{A_TICK}, read", "controller",
          ("trainer", "viewer")),
    Topic("policy_swap", msg.PolicySwap, EVENT, "1 a policy", "controller"),
    Topic("controller_settings", msg.ControllerSettings, EVENT, "at start and at a change", "controller", ("viewer",)),
    Topic("transition", msg.Transition, TICK, f"{A_TICK}, read", "trainer"),
    Topic("policy", msg.PolicyWeights, WEIGHTS, "1 an episode planned", "trainer", (),
          "a policy file's bytes, about 0.5 MB; the controller reads it unless `swap_at` is `never`"),
    Topic("episode_plan", msg.EpisodePlan, EVENT, "1 an episode", "trainer", ("simulator", "launcher")),
    Topic("diagnostics", DiagnosticArray, DIAGNOSTICS, "1 Hz and at a change", "all", ("launcher",),
          "the node's health, what it waits for, what it accepted and refused"),
)  # fmt: skip
SERVICES = (
    Service("reset_episode", srv.ResetEpisode, "simulator"),
    Service("pause", SetBool, "simulator", "Holds the robot between two ticks (`data: true`), or lets it go on."),
    Service("load_policy", srv.LoadPolicy, "controller"),
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
    wanted = {t.name: len({*t.readers, "recorder"} & set(nodes)) for t in published_by(nodes)}
    return [name for name, least in wanted.items() if counted.get(name, 0) < least + (others or {}).get(name, 0)]

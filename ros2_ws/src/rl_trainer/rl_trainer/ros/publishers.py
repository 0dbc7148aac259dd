"""What the trainer publishes and logs of what was learned: plans, transitions, weights."""

from rabbit_common.ros.qos import EVENT, TICK, WEIGHTS
from rabbit_msgs import msg
from rclpy.node import Node
from rl_cbf_clf_controller.policy import ActorPolicy
from std_msgs.msg import Header

from rl_trainer.parameters import TrainingParameters
from rl_trainer.ros.messages import plan_message, transition_message, weights_message
from rl_trainer.training import EpisodePlan, EpisodeReport
from rl_trainer.transitions import Transition


class Publishers:
    """The learning thread's listener. `figures`: of what was learned last, for diagnostics."""

    def __init__(self, node: Node, training: TrainingParameters, plans_policies: bool) -> None:
        self._node, self._training, self._plans_policies = node, training, plans_policies
        self._transitions = node.create_publisher(msg.Transition, "transition", TICK)
        self._weights = node.create_publisher(msg.PolicyWeights, "policy", WEIGHTS)
        self._plan = node.create_publisher(msg.EpisodePlan, "episode_plan", EVENT)
        self._planned: tuple[EpisodePlan, int] | None = None  # the newest plan, and after which episode
        self.figures: dict[str, object] = {}

    def on_plan(self, plan: EpisodePlan, after: int, report: EpisodeReport | None) -> None:
        """Announce the next episode, its policy first."""
        if report:
            text = f"episode {after} learned: {report.kept} of {report.ticks} ticks kept"
            self._node.get_logger().info(text)
            self.figures = {"episode": report.episode, **report.reward, **report.losses}
        if self._plans_policies and isinstance(plan.policy, ActorPolicy):
            self._weights.publish(weights_message(plan.policy.file, self._node.get_fully_qualified_name(), Header()))
            self._node.get_logger().info(f"policy {plan.policy.version} published")
        self._planned = plan, after
        self.plan_again(after)

    def plan_again(self, after: int) -> None:
        """Announce the newest plan, if it is for what follows this episode."""
        if self._planned and self._planned[1] == after:
            self._plan.publish(plan_message(*self._planned, Header()))

    def on_transition(self, transition: Transition, tag: tuple[int, Header]) -> None:
        """A transition was taken in."""
        if self._transitions.get_subscription_count():
            self._transitions.publish(transition_message(transition, self._training, *tag))

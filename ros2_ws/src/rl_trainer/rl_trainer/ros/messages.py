"""Who publishes the trainer's messages, from its dataclasses; and what the trainer hears, checked."""

from array import array
from dataclasses import fields
from typing import Any

from cbf_clf_qp.quantity import LONGEST_NAME
from rabbit_common.message_checks import Refused, doubles
from rabbit_common.ros.conversions import state_of, torque_of
from rabbit_common.ros.qos import EVENT, TICK, WEIGHTS
from rabbit_description.state import JOINTS, LAYOUT, RobotLayout
from rabbit_msgs import msg
from rclpy.node import Node
from rl_cbf_clf_controller.message_fields import state_values, terms_values
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.problem import Problem
from std_msgs.msg import Header

from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import reward, reward_terms
from rl_trainer.training import EpisodePlan, EpisodeReport
from rl_trainer.transitions import Transition

NUMBERS = ("tick", "step_index", "failed")
ARRAYS = tuple(field.name for field in fields(Transition) if field.name not in (*NUMBERS, "problem", "doubt"))


def checked_part(part: str, message: Any, problem: Problem, layout: RobotLayout) -> Any:
    """A tick's `state` with its header, or the controller's parts with its sender; raises `Refused`.

    Of `torque`, `controller_state` and `learner_terms` that is what they tell of the `ControllerOutput`.
    """
    if part == "state":
        return message.header, state_of(message, None, message.running, layout)
    if part == "torque":
        return message.sender, {"torque": torque_of(message, len(layout.joints))}
    if part == "controller_state":
        eta = 2 * JOINTS if layout is LAYOUT else len(message.eta)  # nobody needs a task's
        return message.sender, state_values(message, problem.inputs, eta)
    values = terms_values(message, problem.inputs)
    sizes = tuple(len(names) for names in problem.observations if len(names) >= len(problem.observation))
    if values["quantities"] != problem.quantities or len(values["observation"]) not in sizes:
        got = f"quantities {values['quantities']}, {len(values['observation'])} observations"
        raise Refused("not fit", f"{got}; this problem has {problem.quantities}, {' or '.join(map(str, sizes))}")
    return message.sender, values


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
            self._node.get_logger().info(f"episode {after} learned: {report.kept} of {report.ticks} ticks kept")
            self.figures = {"episode": report.episode, **report.reward, **report.losses}
        if self._plans_policies and isinstance(plan.policy, ActorPolicy):
            source, data = self._node.get_fully_qualified_name(), array("B", plan.policy.file.encode())
            self._weights.publish(msg.PolicyWeights(version=plan.policy.version, source=source, data=data))
            self._node.get_logger().info(f"policy {plan.policy.version} published")
        self._planned = plan, after
        self.plan_again(after)

    def plan_again(self, after: int) -> None:
        """Announce the newest plan, if it is for what follows this episode."""
        if self._planned and self._planned[1] == after:
            plan, _ = self._planned
            about = {"seed": plan.seed, "sigma": plan.sigma, "policy_version": plan.policy.version}
            self._plan.publish(msg.EpisodePlan(after_episode=after, **about))

    def on_transition(self, transition: Transition, tag: tuple[int, Header]) -> None:
        """A transition was taken in: it goes out with its reward, term by term."""
        if not self._transitions.get_subscription_count():
            return
        episode, at = tag
        self._transitions.publish(
            msg.Transition(
                header=at,
                episode=episode,
                problem=str(transition.problem)[:LONGEST_NAME],
                reward_terms=doubles(reward_terms(transition, self._training)[0]),
                reward=reward(transition, self._training),
                doubt=int(transition.doubt),
                **{name: getattr(transition, name) for name in NUMBERS},
                **{name.lower(): doubles(getattr(transition, name)) for name in ARRAYS},
            )
        )

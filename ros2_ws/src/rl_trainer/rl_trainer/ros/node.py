"""The trainer's node: puts ticks together from state, torque and controller state, for the learning thread.

It publishes the transitions, weights that are no worse than those in force, and, where the simulator waits for it, how
each episode is to be walked. It never holds up a tick: what it cannot learn from at once waits in a queue.
"""

import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Time
from rabbit_common.message_checks import MessageCounter, Refused
from rabbit_common.ros.checked_subscription import create_checked_subscription
from rabbit_common.ros.conversions import check_episode, is_new_simulator
from rabbit_common.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import EVENT, TICK, WEIGHTS
from rabbit_common.ros.spin import run, steady_timer
from rabbit_msgs.msg import ControllerState, Episode, EpisodePlan, PolicySwap, PolicyWeights, RabbitState, TorqueCommand
from rabbit_msgs.msg import Transition as TransitionMessage
from rclpy.node import Node
from rl_cbf_clf_controller.policy import LearnedPolicy
from rl_cbf_clf_controller.weights import PolicyFile, PolicyFileError

from rl_trainer.learning_thread import LearningThread
from rl_trainer.parameters import TrainingParameters
from rl_trainer.publication_gate import Verdict
from rl_trainer.ros.messages import checked_part, plan_message, policy_of, transition_message, weights_message
from rl_trainer.ros.trainer_setup import NodeParameters, make_trainer
from rl_trainer.session import CheckpointError
from rl_trainer.tick_synchronizer import Event, Tick, Walk
from rl_trainer.training import EpisodePlan as Plan
from rl_trainer.training import EpisodeReport
from rl_trainer.transitions import Transition

PARTS = ("state", "torque", "controller_state")
GIVE_UP_SECONDS = 2.0  # after an episode's end, for ticks that have not come
MOST_CONTROLLERS = 20  # whose policies are remembered
ACTED = ("fault",)  # outcomes after which the last state has an answer too


class TrainerNode(Node):
    """Hears a walk and learns from it."""

    failure_code = 1  # it could be used, and cannot go on

    def __init__(self) -> None:
        super().__init__("trainer")
        own = declare(self, NodeParameters)
        training = declare(self, TrainingParameters)
        refuse_unknown(self)
        self._training = training
        trainer = make_trainer(training, own)
        beside = 0 if own.plan_episodes else own.learn_beside
        self._plans_policies = own.plan_episodes
        self._learning = LearningThread(trainer, self, beside, Path(own.folder) if own.folder else None)
        self._message_counter = MessageCounter()
        self._walk = Walk(PARTS)
        self._held_up_since: float | None = None
        self._started = self._is_joining = False
        self._newest: Episode | None = None  # where the simulator stands
        self._planned: tuple[Plan, int] | None = None  # the newest plan, and after which episode
        self._policies: dict[str, LearnedPolicy] = {}  # in force, by controller
        self._report: EpisodeReport | None = None
        self._verdict: Verdict | None = None
        self._kept_back = 0
        self._connect()
        self.get_logger().info(f"ready: learns {training.problem}, begins with policy {own.policy}")

    @property
    def failure(self) -> str:
        """Why the node ends by itself: its learning did. Nobody then waits for a plan that never comes."""
        return self._learning.error

    def close(self) -> None:
        """End the learning thread."""
        self._learning.close()

    def _connect(self) -> None:
        self._transitions = self.create_publisher(TransitionMessage, "transition", TICK)
        self._weights = self.create_publisher(PolicyWeights, "policy", WEIGHTS)
        self._plan = self.create_publisher(EpisodePlan, "episode_plan", EVENT)
        kinds = (RabbitState, TorqueCommand, ControllerState)
        self._inputs = [
            create_checked_subscription(self, kind, part, partial(self._on_part, part), TICK, self._refuse)
            for part, kind in zip(PARTS, kinds, strict=True)
        ]
        create_checked_subscription(self, Episode, "episode", self._on_episode, EVENT, self._refuse)
        create_checked_subscription(self, PolicySwap, "policy_swap", self._on_swap, EVENT, self._refuse)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, 0.5, self._look)

    # What comes in

    def _on_part(self, part: str, message: Any) -> None:
        if not self._started:
            return
        if part != "state" and not self._walks(message.sender, message.episode):
            self._refuse(part, Refused("another controller", f"{message.sender}, episode {message.episode}"))
            return
        judged = self._walk.judge(part, message.episode, message.tick)
        if judged == "again":
            self._message_counter.accept(f"{part} again")
            return
        if judged != "good":
            self._refuse(part, Refused(judged, f"episode {message.episode}, tick {message.tick}"))
            return
        checked = None
        try:
            checked = checked_part(part, message, self._training.problem)
            self._message_counter.accept(part)
        except Refused as error:
            self._refuse(part, error)
        if self._is_joining:
            self._is_joining = False
            self._walk.join(message.episode, message.tick)
        self._hand_on(self._walk.add(part, message.episode, message.tick, checked))

    def _on_episode(self, message: Episode) -> None:
        if self._started and message.episode <= self._walk.done and message.phase != Episode.WAITING:
            self._on_known_episode(message)
        try:
            check_episode(message, self._walk.done if self._started else 0)
        except Refused as error:
            self._refuse("episode", error)
            return
        self._message_counter.accept("episode")
        self._newest = message
        if policy := self._policies.get(message.controller):
            self._learning.in_force(policy)
        if not self._started:
            return
        if is_new_simulator(message) and self._walk.announced:
            self._hand_on(self._walk.restart())
            self._learning.end(None, 0)
        self._walk.announced = message.episode
        if message.phase == Episode.ENDED:
            self._hand_on(self._walk.end(message.episode, message.tick, message.outcome in ACTED))

    def _on_known_episode(self, message: Episode) -> None:
        """An episode that is over here is announced.

        If it is the newest, and over there too, the simulator may have missed the plan. Else we are ahead: somebody
        announced what never was. We go back to where the simulator stands; it waits for our plan.
        """
        if message.episode < self._walk.done or message.phase != Episode.ENDED:
            self.get_logger().warning(f"goes back from episode {self._walk.done} to {message.episode}")
            self._hand_on(self._walk.restart())
            self._walk.done = message.episode - 1
        elif self._planned is not None and self._planned[1] == message.episode:
            self._plan.publish(plan_message(*self._planned, Time()))

    def _on_swap(self, message: PolicySwap) -> None:
        try:
            policy = policy_of(message, self._training.problem)
        except PolicyFileError as error:
            self._refuse("policy_swap", Refused("not fit", str(error)))
            return
        self._message_counter.accept("policy_swap")
        if policy is None:
            return
        self._policies[message.sender] = policy
        if len(self._policies) > MOST_CONTROLLERS:
            del self._policies[next(iter(self._policies))]
        if self._newest is None or self._walks(message.sender, self._newest.episode):
            self._learning.in_force(policy)

    def _walks(self, controller: str, episode: int) -> bool:
        """Whether its torques act in an episode, as far as that was announced."""
        newest = self._newest
        return newest is None or newest.episode != episode or newest.controller in ("", controller)

    def _refuse(self, topic: str, error: Refused) -> None:
        self.get_logger().warning(self._message_counter.refuse(topic, error), throttle_duration_sec=1.0)

    # What goes on

    def _start(self, newest: Episode) -> None:
        """Begin to learn with the next episode, or in the middle of this one."""
        is_idle = newest.phase in (Episode.WAITING, Episode.ENDED)
        self._started, self._is_joining = True, not is_idle
        self._walk.done, self._walk.announced = newest.episode - (not is_idle), newest.episode
        self._learning.start(self._walk.done)

    def _hand_on(self, events: list[tuple[int, Event]]) -> None:
        for episode, event in events:
            if isinstance(event, Tick):
                (stamp, state), (controller, torque), (author, output) = event.messages
                if author == controller:
                    self._learning.tick(state, replace(output, torque=torque), (episode, stamp))
                else:
                    self._walk.lost += 1
            else:
                stamp, state = event.last or (Time(), None)
                self._learning.end(state, episode, (episode, stamp))

    def _look(self) -> None:
        """Begin, when the latched episodes are heard; give up what an ended one still owes; log a full disk."""
        if not self._started and self._newest:
            self._start(self._newest)
        if self._learning.kept.error:
            self.get_logger().error(self._learning.kept.error, once=True)
        now = time.monotonic()
        if not self._walk.is_held_up:
            self._held_up_since = None
        elif self._held_up_since is None:
            self._held_up_since = now
        elif now - self._held_up_since > GIVE_UP_SECONDS:
            self._held_up_since = None
            self._hand_on(self._walk.give_up())

    # What was learned, called in the learning thread

    def on_plan(self, plan: Plan, after: int) -> None:
        """Announce the next episode, its policy first."""
        if self._report:
            self.get_logger().info(f"episode {after} learned: {self._report.kept} of {self._report.ticks} ticks kept")
        if self._plans_policies and plan.policy is not None:
            self.on_policy(plan.policy)
        self._planned = plan, after
        self._plan.publish(plan_message(plan, after, Time()))

    def on_transition(self, transition: Transition, tag: tuple[int, Time]) -> None:
        """A transition was taken in."""
        if self._transitions.get_subscription_count():
            self._transitions.publish(transition_message(transition, self._training, *tag))

    def on_policy(self, policy: PolicyFile) -> None:
        """New weights."""
        self._weights.publish(weights_message(policy, self.get_fully_qualified_name(), Time()))
        self.get_logger().info(f"policy {policy.version} published")

    def on_verdict(self, verdict: Verdict) -> None:
        """Weights were judged; those that are worse than the ones in force are not published."""
        self._verdict = verdict
        if not verdict.passes:
            self._kept_back += 1
            self.get_logger().warning(str(verdict))

    def on_report(self, report: EpisodeReport) -> None:
        """An episode was digested."""
        self._report = report

    def _status(self) -> Status:
        figures: dict[str, object] = {
            "ticks waiting": self._learning.waiting,
            "ticks lost": self._walk.lost,
            "transitions": self._learning.kept.taken,
            "policies kept back": self._kept_back,
        }
        if self._verdict:
            figures |= {"held-out error": self._verdict.error, "in force": self._verdict.error_in_force}
        if self._report:
            figures |= {"episode": self._report.episode, **self._report.reward, **self._report.losses}
        if error := self._learning.kept.error:
            return ERROR, error, figures
        if not self._started or not all(reader.get_publisher_count() for reader in self._inputs):
            return WARN, "waiting for simulator and controller", figures
        return OK, "learning", figures


def main() -> None:
    """The executable `trainer`."""
    run(TrainerNode, errors=(CheckpointError, PolicyFileError))


if __name__ == "__main__":
    main()

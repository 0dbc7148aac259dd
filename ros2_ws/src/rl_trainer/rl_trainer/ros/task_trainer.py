"""Learns on a task while its simulator and controller run: it plans episodes, and publishes what it has learned.

It hears `state` and `parameters` and makes the controller's ticks again, so its transitions, and the policy after all
episodes, have the bits of those of `task_training.train`. A tick with an impact, or after which another input
was applied, counts for nothing. It learns once an episode has ended, in a thread, so that services are answered; the
simulator, which follows it, waits meanwhile.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
from cbf_clf_qp.functions import Array
from pydantic import BaseModel, ConfigDict, Field
from rabbit_common.guard import guarded, reason_of
from rabbit_common.message_checks import Refused, array_of
from rabbit_common.ros.diagnostics import OK, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import EVENT, TICK, WEIGHTS
from rabbit_common.ros.simulator_follower import SimulatorFollower
from rabbit_common.task_messages import parameters_of, state_of
from rabbit_description import ABOUT_TASK
from rabbit_description.task_source import load_task
from rabbit_msgs import msg
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.task_controller import NOMINAL

from rl_trainer.task_episode import Rider
from rl_trainer.task_training import training_parameters
from rl_trainer.training import Stopped, Trainer


class NodeParameters(BaseModel):
    """Which task, how long, and where the policy goes."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    task: str = Field("", description=ABOUT_TASK)
    seed: int = Field(1, ge=0, le=2**32 - 1, description="seed of the training")
    episodes: int = Field(4, ge=1, le=10_000, description="to learn from")
    path: str = Field("policy.safetensors", min_length=1, description="the policy's file after all episodes")


class TaskTrainerNode(SimulatorFollower):
    """Plans, hears, learns."""

    failure_code = 1  # it could be used, and cannot go on

    def __init__(self) -> None:
        super().__init__("trainer")
        self.failure = ""  # what ends the node
        self._own = declare(self, NodeParameters)
        refuse_unknown(self)
        self.task = load_task(self._own.task)
        asked = training_parameters(self.task, self._own.seed, episodes=self._own.episodes)
        self._trainer, self._rider = Trainer(asked), Rider(self.task, asked.problem)
        self._policies = self.create_publisher(msg.PolicyWeights, "policy", WEIGHTS)
        self._plans = self.create_publisher(msg.EpisodePlan, "episode_plan", EVENT)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        self._learning: Thread | None = None  # after an episode
        self._after = 0  # the simulator's episode before the planned one
        self._over_at = -1  # the next tick as its end was last announced
        self._states = dict[int, tuple[Array, Array, int]]()  # of ticks to come
        self._tick = 0
        self._begin()
        self._hear_simulator(msg.RobotState, "state", self._on_state, TICK)
        self._hear_simulator(msg.TaskParameters, "parameters", self._on_parameters, TICK)
        self._hear_simulator(msg.Episode, "episode", self._on_episode, EVENT)
        self.get_logger().info(f"ready: task {self.task.name}, {self._own.episodes} episodes")

    # What comes in

    def _on_fault(self, reason: str) -> None:
        """Learning failed: nobody shall wait for a plan that never comes."""
        self.failure = reason

    def _on_state(self, message: msg.RobotState) -> None:
        if self._is_done:
            return
        self._check(message)
        if message.running:
            applied = array_of(message, "applied", len(self.task.names_of_u))
            self._states[message.tick] = state_of(self.task, message), applied, message.touchdowns
        else:
            self._end = message.tick
        self._message_counter.accept("state")
        self._go_on()

    def _on_parameters(self, message: msg.TaskParameters) -> None:
        if self._is_done:
            return
        self._check(message)
        self._p[message.tick] = parameters_of(self.task, message)
        self._message_counter.accept("parameters")
        self._go_on()

    def _on_episode(self, message: msg.Episode) -> None:
        """What no tick says: an episode broke off, or ticks of it are lost, or the simulator stands elsewhere.

        It announces itself again where a plan is for an episode that is far ahead.
        """
        is_over = message.phase in (msg.Episode.ENDED, msg.Episode.WAITING)
        if self._learning:
            self._after = message.episode if is_over else self._after
        elif self._is_done:
            pass
        elif message.phase == msg.Episode.ENDED and message.episode == self._after + 1:
            is_broken, nothing_came = message.outcome not in ("done", "failed"), self._over_at == self._tick
            self._over_at = self._tick
            if nothing_came and not self._tick and not is_broken:  # it ended as this node came in
                self._after = message.episode
                self._listen()
            elif nothing_came or is_broken:
                self._learn()
        elif is_over and (message.episode != self._after or not (self._tick or self._states)):
            if message.episode != self._after:
                self.get_logger().warning(f"expects episode {message.episode + 1} in place of {self._after + 1}")
            self._after = message.episode
            self._listen()
        self._message_counter.accept("episode")

    def _check(self, message: Any) -> None:
        if self._learning:
            raise Refused("wrong episode", f"episode {message.episode}; expected none")
        if message.episode != self._after + 1:
            raise Refused("wrong episode", f"episode {message.episode}; expected {self._after + 1}")

    @property
    def _is_done(self) -> bool:
        return self._trainer.episode >= self._own.episodes

    # The episode

    def _begin(self) -> None:
        """Plan the next one."""
        self._plan = self._trainer.begin_episode()
        if isinstance(self._plan.policy, ActorPolicy):
            self._publish(self._plan.policy)
        self._listen()

    def _listen(self) -> None:
        """Publish the plan, and expect its first tick."""
        self._over_at = -1
        self._states, self._p, self._tick = {}, dict[int, Array](), 0
        self._u, self._impacts = np.zeros(0), 0  # the newest input; impacts before it
        self._end = -1  # how many ticks the episode had, once that is known
        self._exploring = self.task.beginning(self._plan.seed)[2]
        self._rider.begin(self._plan.policy)
        version = self._plan.policy.version if isinstance(self._plan.policy, ActorPolicy) else NOMINAL
        how = {"seed": self._plan.seed, "sigma": self._plan.sigma, "policy_version": version}
        self._plans.publish(msg.EpisodePlan(after_episode=self._after, **how))

    def _publish(self, policy: ActorPolicy) -> None:
        weights = msg.PolicyWeights(version=policy.version, source="trainer", data=policy.file.encode())
        self._policies.publish(weights)

    def _go_on(self) -> None:
        """The ticks of which both messages are here, in their order."""
        while self._tick in self._states and self._tick in self._p:
            (x, applied, impacts), p = self._states.pop(self._tick), self._p.pop(self._tick)
            if self._tick and not (np.array_equal(applied, self._u) and impacts == self._impacts):
                self._rider.ticks.interrupt()
            self._impacts = impacts
            noise = self._plan.sigma * self._exploring.standard_normal(self._rider.problem.inputs)
            moment = self._rider.moment(self._plan.policy, self._tick * self.task.seconds, x, p, noise)
            self._u, self._tick = moment.u, self._tick + 1
        if self._tick == self._end:
            self._learn()

    def _learn(self) -> None:
        self._after += 1
        for transition in self._rider.ticks.transitions:
            self._trainer.take(transition)
        self._learning = Thread(target=self._learn_in_thread, name="learning", daemon=True)
        self._learning.start()

    def _learn_in_thread(self) -> None:
        then: Callable[[], None] = guarded(self._go_to_next, self._on_fault)
        try:
            self._trainer.learn_episode()
        except Stopped:
            return
        except BaseException as error:  # a learner may be another package's
            then = partial(self._on_fault, reason_of(error))
        if self.executor is not None:
            self.executor.create_task(then)

    def _go_to_next(self) -> None:
        self._learning = None
        self.get_logger().info(f"episode {self._trainer.episode}: {len(self._rider.ticks.transitions)} transitions")
        if not self._is_done:
            self._begin()
            return
        self.destroy_publisher(self._plans)  # a simulator that follows whoever plans goes on by itself
        policy = ActorPolicy(self._trainer.policy_file())
        policy.file.write(Path(self._own.path))
        self._publish(policy)
        self.get_logger().info(f"policy {policy.version} in {self._own.path}")

    def close(self) -> None:
        """Learn no more."""
        self._trainer.stop.set()
        if self._learning:
            self._learning.join(timeout=5.0)

    def _status(self) -> Status:
        return OK, f"episode {self._trainer.episode + 1}", {"transitions": self._trainer.transitions}

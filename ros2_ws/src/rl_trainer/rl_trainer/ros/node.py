"""The trainer's node: puts ticks together from the state and the controller's three messages, for the learning thread.

It publishes the transitions and, where the simulator waits for it, how an episode is to be walked, with which policy.
It never holds up a tick: what it cannot learn from at once waits in a queue.
"""

import json
import time
from functools import partial
from pathlib import Path
from socket import socket
from typing import Any

from pydantic import Field, create_model
from rabbit_common.message_checks import Refused
from rabbit_common.ros.conversions import check_episode, is_new_simulator, other_tick
from rabbit_common.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Status
from rabbit_common.ros.namespace_check import hold_name
from rabbit_common.ros.network import StartError, domain
from rabbit_common.ros.parameters import ParameterError, declare, refuse_unknown
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_common.ros.simulator_follower import SimulatorFollower
from rabbit_common.ros.spin import run, steady_timer
from rabbit_description import ABOUT_TASK
from rabbit_description.state import LAYOUT
from rabbit_description.task import TaskError
from rabbit_description.task_source import load_task
from rabbit_description.task_state import layout_of
from rabbit_description.validation import Checked
from rabbit_msgs import msg
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.weights import PolicyFileError, policy_path, read
from std_msgs.msg import Header

from rl_trainer.checkpoint import CheckpointError
from rl_trainer.learning_thread import LearningThread
from rl_trainer.parameters import TrainingParameters
from rl_trainer.ros.messages import Publishers, checked_part
from rl_trainer.task_training import training_parameters
from rl_trainer.tick_synchronizer import Event, Tick, TickSynchronizer
from rl_trainer.training import Provenance, Trainer

PARTS = {
    "state": msg.RobotState,
    "torque": msg.TorqueCommand,
    "controller_state": msg.ControllerState,
    "learner_terms": msg.LearnerTerms,
}
GIVE_UP_SECONDS = 2.0  # after an episode's end, for ticks that have not come
ACTED = ("fault",)  # outcomes after which the last state has an answer too


class NodeParameters(Checked):
    """Parameters of the node besides the training's."""

    plan_episodes: bool = Field(True, description="publish the policy of each plan, for simulator and controller")
    policy: str = Field(
        ZeroPolicy.version, description="to learn on from: zero (from scratch), the name of a shipped one, or a file"
    )
    folder: str = Field(
        "", description="folder for checkpoint and policies after each episode; it goes on from there, before `policy`"
    )
    task: str = Field("", description=f"what is learned on; empty: RABBIT; else {ABOUT_TASK}")
    plant: str = Field("{}", description="what the policy file says of the plant, JSON")


class TrainerNode(SimulatorFollower):
    """Hears a walk and learns from it."""

    failure_code = 1  # it could be used, and cannot go on

    def __init__(self) -> None:
        super().__init__("trainer")
        self._plans_alone = self._hold_plans()
        parameters = declare(self, NodeParameters)
        task = load_task(parameters.task) if parameters.task else None
        default = training_parameters(task, self._seed()) if task else None
        self._training = declare(self, TrainingParameters, default=default)
        self._layout = layout_of(task) if task else LAYOUT
        self._tick_seconds = task.seconds if task else self._training.tick_seconds
        refuse_unknown(self)
        folder = Path(parameters.folder) if parameters.folder else None
        self._published = Publishers(self, self._training, parameters.plan_episodes)
        self._learning = LearningThread(make_trainer(self._training, parameters), self._published, folder)
        self._ticks = TickSynchronizer(tuple(PARTS))
        self._held_up_since: float | None = None
        self._started = self._is_joining = False
        self._newest: msg.Episode | None = None  # where the simulator stands
        self._inputs = [
            (self._hear_simulator if part == "state" else self._hear)(of, part, partial(self._on_part, part), TICK)
            for part, of in PARTS.items()
        ]
        self._hear_simulator(msg.Episode, "episode", self._on_episode, EVENT)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, 0.5, self._look)
        self.get_logger().info(f"ready: learns {self._training.problem}, begins with policy {parameters.policy}")

    def _hold_plans(self) -> socket:
        """Holds the topic of the plans: the simulator would mix two trainers'. Raises `StartError`."""
        topic = self.resolve_topic_name("episode_plan")
        try:
            return hold_name(topic)
        except OSError as error:
            where = f"another trainer of this machine publishes {topic} of ROS domain {domain()}"
            raise StartError(f"{where}; end it, or take another namespace or ROS_DOMAIN_ID") from error

    def _seed(self) -> int:
        """What the units of a task are measured with, before the other parameters' defaults are known."""
        model = create_model("Seed", seed=(int, TrainingParameters.model_fields["seed"]))
        seed = declare(self, model, dynamic=("seed",)).model_dump()["seed"]
        self.undeclare_parameter("seed")
        return seed

    @property
    def failure(self) -> str:
        """Why the node ends by itself: its learning did. Nobody then waits for a plan that never comes."""
        return self._learning.error

    def close(self) -> None:
        """End the learning thread; another trainer may come."""
        self._learning.close()
        self._plans_alone.close()

    # What comes in

    def _on_part(self, part: str, message: Any) -> None:
        if not self._started:
            return
        turn = message.episode, message.tick
        judged: str = self._ticks.judge(part, *turn)
        if part != "state" and not self._walks(message.sender, message.episode):
            judged = "another controller"
        if judged == "again":
            self._message_counter.accept(f"{part} again")
            return
        if judged != "good":
            raise Refused(judged, f"episode {message.episode}, tick {message.tick}")
        checked = None  # what is refused is lost
        try:
            checked = checked_part(part, message, self._training.problem, self._layout)
            self._message_counter.accept(part)
        finally:
            if self._is_joining:
                self._is_joining = False
                self._ticks.join(*turn)
            self._hand_on(self._ticks.add(part, *turn, checked))

    def _on_episode(self, message: msg.Episode) -> None:
        if fault := other_tick(message, self._tick_seconds):
            raise Refused("another tick", fault)
        if self._started and message.episode <= self._ticks.done and message.phase != msg.Episode.WAITING:
            self._on_known_episode(message)
        check_episode(message, self._ticks.done if self._started else 0, self._layout)
        self._message_counter.accept("episode")
        self._newest = message
        if not self._started:
            return
        if is_new_simulator(message) and self._ticks.announced:
            self._hand_on(self._ticks.restart())
            self._learning.end(None, 0)
        self._ticks.announced = message.episode
        if message.phase == msg.Episode.ENDED:
            self._hand_on(self._ticks.end(message.episode, message.tick, message.outcome in ACTED))

    def _on_known_episode(self, message: msg.Episode) -> None:
        """An episode that is over here is announced.

        If it is the newest, and over there too, the simulator may have missed the plan. Else we are ahead: somebody
        announced what never was. We go back to where the simulator stands; it waits for our plan.
        """
        if message.episode < self._ticks.done or message.phase != msg.Episode.ENDED:
            self.get_logger().warning(f"goes back from episode {self._ticks.done} to {message.episode}")
            self._hand_on(self._ticks.restart())
            self._ticks.done = message.episode - 1
        else:
            self._published.plan_again(message.episode)

    def _walks(self, controller: str, episode: int) -> bool:
        """Whether its torques act in an episode, as far as that was announced."""
        newest = self._newest
        return newest is None or newest.episode != episode or newest.controller in ("", controller)

    # What goes on

    def _hand_on(self, events: list[Event]) -> None:
        for episode, event in events:
            if isinstance(event, Tick):
                (at, state), *parts = event.messages
                if len({controller for controller, _ in parts}) == 1:
                    output = ControllerOutput(**{name: value for _, told in parts for name, value in told.items()})
                    self._learning.tick(state, output, (episode, at))
                else:
                    self._ticks.lost += 1
            else:
                at, state = event.last or (Header(), None)
                self._learning.end(state, episode, (episode, at))

    def _look(self) -> None:
        """Begin, when the latched episodes are heard; give up what an ended one still owes; log a full disk."""
        if not self._started and (newest := self._newest):  # with the next episode, or in the middle of this one
            is_idle = newest.phase in (msg.Episode.WAITING, msg.Episode.ENDED)
            self._started, self._is_joining = True, not is_idle
            self._ticks.done, self._ticks.announced = newest.episode - (not is_idle), newest.episode
            self._learning.start(self._ticks.done)
        if self._learning.disk_error:
            self.get_logger().error(self._learning.disk_error, once=True)
        now = time.monotonic()
        self._held_up_since = (self._held_up_since or now) if self._ticks.is_held_up else None
        if self._held_up_since and now - self._held_up_since > GIVE_UP_SECONDS:
            self._held_up_since = None
            self._hand_on(self._ticks.give_up())

    def _status(self) -> Status:
        figures: dict[str, object] = {
            "ticks waiting": self._learning.waiting,
            "ticks lost": self._ticks.lost,
            "transitions": self._learning.trainer.taken,
            **self._published.figures,
        }
        if error := self._learning.disk_error:
            return ERROR, error, figures
        if not self._started or not all(reader.get_publisher_count() for reader in self._inputs):
            return WARN, "waiting for simulator and controller", figures
        return OK, "learning", figures


def make_trainer(training: TrainingParameters, parameters: NodeParameters) -> Trainer:
    """Makes a trainer from scratch or from a policy; raises `ParameterError`, `PolicyFileError`."""
    try:
        plant = json.loads(parameters.plant)
    except ValueError as error:
        raise ParameterError(f"parameter plant = {parameters.plant!r}: not JSON: {error}") from error
    if not isinstance(plant, dict):
        raise ParameterError(f"parameter plant = {parameters.plant!r}: expected a JSON object")
    if parameters.policy == ZeroPolicy.version:
        return Trainer(training, Provenance(plant, command="trainer node"))
    policy = read(policy_path(parameters.policy))
    trainer = Trainer(training, Provenance(plant, command=f"trainer node, from {policy.version}"))
    trainer.start_from(policy)
    return trainer


def main() -> None:
    """The executable `trainer`."""
    run(TrainerNode, errors=(CheckpointError, PolicyFileError, TaskError), gives_way=True)

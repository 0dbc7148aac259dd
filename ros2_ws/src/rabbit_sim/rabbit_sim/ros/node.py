"""The simulator's node: publishes the state of a tick, waits for its torque, steps. It owns the clock and the episodes.

In lock-step (the default) nothing moves before the torque of the very tick has come. In real time a tick lasts 10 ms by
the wall clock, and `real_time` says what acts in place of a torque that comes late.
"""

from rabbit_common.message_checks import Refused
from rabbit_common.priority import scheduling, take_priority
from rabbit_common.ros.checked_node import CheckedNode
from rabbit_common.ros.conversions import check_plan
from rabbit_common.ros.diagnostics import OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import declare, follow, refuse_unknown
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_common.ros.spin import run, steady_timer
from rabbit_description.gait import GaitError, load_gaits
from rabbit_description.state import RobotState
from rabbit_description.task import TaskError
from rabbit_description.task_simulation import TaskSimulation
from rabbit_description.task_source import load_task
from rabbit_msgs.msg import Episode, EpisodePlan, TorqueCommand
from rabbit_msgs.srv import ResetEpisode
from std_srvs.srv import SetBool

from rabbit_sim.parameters import NodeParameters, PlayerParameters, SimulationParameters
from rabbit_sim.restart_file import RestartFileError
from rabbit_sim.ros.episode_player import BY_SERVICE, EpisodePlayer, Played
from rabbit_sim.ros.live_controllers import LOOK_SECONDS, LiveControllers
from rabbit_sim.ros.other_simulators import OtherSimulators
from rabbit_sim.ros.publishers import Publishers, RabbitPublishers, TaskPublishers
from rabbit_sim.simulation import Simulation
from rabbit_sim.stones import CourseError

# of the constructor, when a file or value cannot be used
ERRORS = (GaitError, CourseError, RestartFileError, TaskError)


class SimulatorNode(CheckedNode):
    """Plays episodes with whoever answers its states."""

    NAME = "simulator"
    PARAMETERS: type[PlayerParameters] = NodeParameters

    def __init__(self) -> None:
        super().__init__(self.NAME)
        self._p = declare(self, self.PARAMETERS, dynamic=("pace",))
        task = getattr(self._p, "task", "")
        plant = None if task else declare(self, SimulationParameters)
        refuse_unknown(self)
        take_priority(self._p.priority, self.get_logger().warning)
        self._plan: EpisodePlan | None = None
        self._paused = self._p.start_paused
        self._others = OtherSimulators(self, self._announce, lambda reason: self._player.end("reset", reason))
        sender = self._others.sender
        simulation: Played
        topics: Publishers
        if plant is None:
            played = TaskSimulation(load_task(task))
            simulation, topics = played, TaskPublishers(self, played.task, sender)
            what = f"of {played.task.name}"
        else:
            self.rabbit = simulation = Simulation(plant, load_gaits(self._p.gait))
            topics, what = RabbitPublishers(self, self.rabbit, self._p, sender), f"of {plant.stones} stones"
        self._player = EpisodePlayer(self, self._p, simulation, topics, self._on_due)
        torques = self._hear(TorqueCommand, "torque", self._on_torque, TICK)
        self._live_controllers = LiveControllers(self, torques)
        self._plans = self._hear(EpisodePlan, "episode_plan", self._on_plan, EVENT)
        self.create_service(ResetEpisode, "reset_episode", self._on_reset)
        self.create_service(SetBool, "pause", self._on_pause)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, LOOK_SECONDS, self._look)
        self._announce()
        self._set_pace(self._p)
        follow(self, self._p, self._set_pace)
        episodes = f"{self._p.episodes} episodes from seed {self._p.seed}"
        self.get_logger().info(f"ready: {episodes}, {what}")
        if (done := self._player.episode.episode) >= self._p.episodes > 0:
            self.get_logger().warning(f"memory {self._p.memory}: all {done} episodes are done, and none begins")

    def close(self) -> None:
        """End the episode, give back the plant."""
        self._player.end("reset", "the simulator was told to end")
        self._player.simulation.close()

    # What comes in

    def _on_fault(self, reason: str) -> None:
        """Nobody knows how far the tick came: the episode is over."""
        self._player.end("fault", reason)

    def _on_torque(self, message: TorqueCommand) -> None:
        self._live_controllers.spoke()
        try:
            torque = self._player.checked(message)
        except Refused as error:
            self._refuse("torque", error)
            self._player.name_controllers()
            return
        self._message_counter.accept("torque")
        if fault := self._player.admission.admit(message):
            self._player.end("fault", fault)
            return
        self._player.name_controllers()
        self._player.take(message.tick, torque)
        self._go_on()

    def _on_plan(self, message: EpisodePlan) -> None:
        now = self._player.episode.episode
        try:
            check_plan(message, (now,) if self._player.state is None else (now - 1, now))
        except Refused:
            if message.after_episode > now:  # the trainer was led astray: it hears where the simulator stands
                self._announce()
            raise
        self._message_counter.accept("episode_plan")
        self._plan = message

    def _on_reset(self, request: ResetEpisode.Request, response: ResetEpisode.Response) -> ResetEpisode.Response:
        if not self._answered_by_someone():
            response.message = self._others.refusal or "there is no controller"
            return response
        self._player.end("reset", BY_SERVICE)
        self._player.begin(request.seed)
        if self._paused:
            self._player.announce(Episode.PAUSED)
        response.success, response.episode = True, self._player.episode.episode
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if self._others.refusal and not request.data:
            response.message = self._others.refusal
            return response
        self._paused = request.data
        self._player.wait.begin()
        if self._player.state is not None:
            self._player.ticks.sent(self._player.state.tick)  # a pause makes nothing older
            self._player.announce(Episode.PAUSED if self._paused else Episode.RUNNING)
        self._go_on()
        response.success = True
        return response

    # The episode

    def _go_on(self) -> None:
        """Step, if the torque is there, nobody paused and the pace allows it."""
        if self._player.torque is not None and self._player.ticks.due and not self._paused:
            self._player.step(self._player.torque)

    def _look(self) -> None:
        """Begin what can begin; end what nobody answers."""
        self._player.wait.look()
        self._others.look()
        if self._paused:
            return
        if self._player.state is None:
            self._begin_next()
        elif self._player.torque is None:
            self._remind(self._player.state)

    def _remind(self, state: RobotState) -> None:
        """Ask for a torque again, or end the episode."""
        if self._player.wait.seconds > self._p.answer_timeout:
            self._live_controllers.said_nothing()
            self._player.end("silent", f"no torque for tick {state.tick} came in {self._p.answer_timeout:g} s")
        elif self._player.wait.is_reminder_due():
            self._live_controllers.asked_again()
            if self._player.wait.reminders == 1:
                self.get_logger().warning(f"waits for {self._missing()}")
            self._player.ask_again(state)

    @property
    def _next_plan(self) -> EpisodePlan | None:
        """The trainer's for the next episode, once it is there."""
        plan = self._plan
        return plan if plan is not None and plan.after_episode == self._player.episode.episode else None

    def _is_planned(self) -> bool:
        """Whether the trainer has planned the next episode, where that matters."""
        there = self._p.trainer in ("wait", "follow") or (
            self._p.trainer == "auto" and self._plans.get_publisher_count() > 0
        )
        return self._next_plan is not None or not there

    def _begin_next(self) -> None:
        done = self._player.episode.episode
        if done >= self._p.episodes or not self._answered_by_someone():
            return
        if not self._is_planned():
            if self._player.wait.seconds > self._p.trainer_timeout:
                self._player.give_up(f"the trainer has planned nothing in {self._p.trainer_timeout:g} s")
            elif self._player.wait.is_reminder_due():  # it may not have heard the end
                self._announce()
        elif self._p.trainer in ("follow", "auto") and (plan := self._next_plan) is not None:
            self._player.begin(plan.seed, plan.sigma, plan.policy_version)
        else:
            self._player.begin(self._p.seed + done)

    def _answered_by_someone(self) -> bool:
        is_heard = self._player.topics.readers >= self._p.readers
        return is_heard and self._live_controllers.any and self._others.may_play

    def _announce(self) -> None:
        self._player.announce(self._player.episode.phase)

    def _set_pace(self, parameters: PlayerParameters) -> None:
        """Follow a new pace between two ticks."""
        self._p = parameters
        self._player.ticks.set_pace(parameters.pace or float(parameters.real_time))
        self._go_on()  # with the torque that waited for its time

    def _on_due(self) -> None:
        self._go_on()
        if self._player.ticks.due and self._p.real_time and self.executor is not None:
            self.executor.create_task(self._do_without)  # behind what has come in already

    def _do_without(self) -> None:
        """Real time does not wait for a torque, but for an episode's first."""
        can_step = self._player.state is not None and self._player.ticks.due and not self._paused
        if can_step and self._player.step_without_answer():
            self._live_controllers.said_nothing()  # until one speaks again, be it too late

    def _missing(self) -> str:
        """What the simulator waits for; empty when it goes on."""
        if self._player.state is not None:
            return "" if self._paused else self._player.missing
        if self._others.refusal:
            return f"the end of {self._others.first}, another simulator, which began first"
        missing = [] if self._answered_by_someone() else ["a controller, or more readers"]
        if not self._is_planned():
            missing.append(f"the trainer: no plan after episode {self._player.episode.episode}")
        return " and ".join(missing)

    def _status(self) -> Status:
        e, punctuality = self._player.episode, self._player.ticks.punctuality
        figures = {"episode": e.episode, "outcome": e.outcome, "paused": self._paused, "scheduling": scheduling()}
        figures |= {"ticks": self._player.clock_ticks, **self._player.topics.figures}
        if self._p.real_time:
            figures |= punctuality.figures
        if missing := self._missing():
            return WARN, f"waiting for {missing}", figures
        if not punctuality.is_fit:
            return WARN, f"this machine is not fit for real time: {punctuality}", figures
        return OK, f"episode {e.episode}" if self._player.state is not None else "between episodes", figures


def main() -> None:
    """The executable `simulator`."""
    run(SimulatorNode, errors=ERRORS)

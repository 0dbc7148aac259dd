"""The simulator's node: publishes the state of a tick, waits for its torque, steps. It owns the clock and the episodes.

In lock-step (the default) nothing moves before the torque of the very tick has come. In real time a tick lasts 10 ms by
the wall clock, and `real_time` says what acts in place of a torque that comes late.
"""

import math
from pathlib import Path

from rabbit_common.message_checks import MessageCounter, Refused, check_turn
from rabbit_common.priority import scheduling, take_priority
from rabbit_common.ros.checked_subscription import create_checked_subscription
from rabbit_common.ros.conversions import check_plan, stamp, torque_of
from rabbit_common.ros.diagnostics import OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import declare, follow, refuse_unknown
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_common.ros.spin import run, steady_timer
from rabbit_description.gait import GaitError, load_gaits
from rabbit_description.state import Array, RobotState
from rabbit_msgs.msg import Episode, EpisodePlan, TorqueCommand
from rabbit_msgs.srv import Pause, ResetEpisode
from rclpy.node import Node

from rabbit_sim.node_parameters import NodeParameters
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.real_time import Source, StandIn
from rabbit_sim.restart_file import RestartFile, RestartFileError
from rabbit_sim.ros.controller_admission import ControllerAdmission
from rabbit_sim.ros.live_controllers import LOOK_SECONDS, REPEAT_SECONDS, LiveControllers, Wait
from rabbit_sim.ros.publishers import SimulatorPublishers, episode_of, restart_point
from rabbit_sim.ros.tick_clock import TickClock
from rabbit_sim.simulation import Simulation
from rabbit_sim.stones import CourseError

ERRORS = (GaitError, CourseError, RestartFileError)  # of the constructor, when a file or value cannot be used
BY_SERVICE = "by service"  # reason of a reset after which another episode begins at once


class SimulatorNode(Node):
    """Plays episodes with whoever answers its states."""

    def __init__(self) -> None:
        super().__init__("simulator")
        self._own = declare(self, NodeParameters, dynamic=("pace",))
        plant = declare(self, SimulationParameters)
        refuse_unknown(self)
        take_priority(self._own.priority, self.get_logger().warning)
        self._simulation = Simulation(plant, load_gaits(self._own.gait))
        self._message_counter = MessageCounter()
        self._memory = RestartFile(Path(self._own.memory) if self._own.memory else None)
        before = self._memory.stand  # of a simulator that was killed
        self._clock_ticks = before.clock_ticks
        self._episode = episode_of(before, plant.stones)
        self._state: RobotState | None = None  # the one whose torque is awaited; None between episodes
        self._torque: Array | None = None
        self._plan: EpisodePlan | None = None
        self._paused = self._own.start_paused
        self._stand_in = StandIn(self._own.held_ticks, self._own.damped_ticks, self._own.damping)
        self._admission = ControllerAdmission()
        self._wait = Wait()
        self._connect()
        if before.running:
            self.get_logger().warning(f"episode {before.episode}, tick {before.tick}: {self._episode.reason}")
        self._announce(self._episode.phase)
        self._set_pace(self._own)
        follow(self, self._own, self._set_pace)
        self.get_logger().info(
            f"ready: {self._own.episodes} episodes from seed {self._own.seed}, of {plant.stones} stones"
        )

    def close(self) -> None:
        """End the episode, give back the plant."""
        self._end("reset", "the simulator was told to end")
        self._simulation.close()

    def _connect(self) -> None:
        self._topics = SimulatorPublishers(self, self._simulation.parameters)
        torques = create_checked_subscription(self, TorqueCommand, "torque", self._on_torque, TICK, self._refuse)
        self._live_controllers = LiveControllers(self, torques)
        create_checked_subscription(self, EpisodePlan, "episode_plan", self._on_plan, EVENT, self._refuse)
        self.create_service(ResetEpisode, "reset_episode", self._on_reset)
        self.create_service(Pause, "pause", self._on_pause)
        self._ticks = TickClock(self, self._own.late_limit, self._on_due)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, LOOK_SECONDS, self._look)

    # What comes in

    def _on_torque(self, message: TorqueCommand) -> None:
        self._live_controllers.spoke()
        try:
            if self._state is not None and message.episode == self._episode.episode:
                if fault := self._admission.mixed(message):
                    self._end("fault", fault)
                    return
                self._admission.check(message.sender, is_asked_again=self._wait.reminders > 0)
            if self._state is None or self._torque is not None:
                raise Refused("not awaited", f"episode {message.episode}, tick {message.tick}")
            check_turn((message.episode, message.tick), (self._episode.episode, self._state.tick))
            if self._stand_in.gave_up:
                raise Refused("too late", f"the joints are damped since tick {self._state.tick}")
            torque = torque_of(message)
        except Refused as error:
            self._refuse("torque", error)
            self._name_controllers()
            return
        self._message_counter.accept("torque")
        if fault := self._admission.admit(message):
            self._end("fault", fault)
            return
        self._name_controllers()
        self._torque = torque
        self._ticks.answered()
        self._go_on()

    def _name_controllers(self) -> None:
        """Announce whose torques act and whose are refused, where that is new."""
        e, now = self._episode, (self._admission.controller or "", self._admission.refused)
        if now == (e.controller, e.refused_controller):
            return
        if now[1] != e.refused_controller:
            self.get_logger().error(f"two controllers answer: torques of {now[1]} are refused, those of {now[0]} act")
        e.controller, e.refused_controller = now
        self._announce(e.phase)

    def _on_plan(self, message: EpisodePlan) -> None:
        now = self._episode.episode
        try:
            check_plan(message, (now,) if self._state is None else (now - 1, now))
        except Refused as error:
            self._refuse("episode_plan", error)
            return
        self._message_counter.accept("episode_plan")
        self._plan = message

    def _refuse(self, topic: str, error: Refused) -> None:
        self.get_logger().warning(self._message_counter.refuse(topic, error), throttle_duration_sec=1.0)

    def _on_reset(self, request: ResetEpisode.Request, response: ResetEpisode.Response) -> ResetEpisode.Response:
        if not self._answered_by_someone():
            response.message = "there is no controller"
            return response
        self._end("reset", BY_SERVICE)
        self._begin(request.seed)
        response.accepted, response.episode = True, self._episode.episode
        return response

    def _on_pause(self, request: Pause.Request, response: Pause.Response) -> Pause.Response:
        self._paused = request.paused
        self._wait.begin()
        self._ticks.sent()  # a pause makes nothing older
        if self._state is not None:
            self._announce(Episode.PAUSED if self._paused else Episode.RUNNING)
        self._go_on()
        response.accepted = True
        return response

    # The episode

    def _begin(self, seed: int, sigma: float = math.nan, policy: str = "") -> None:
        """Reset the plant; tick 0 goes out at once."""
        if self._simulation.parameters.sensors == "lab":
            self._clock_ticks += 1  # what the sensors say is matched by its stamp: each tick has one of its own
        self._torque = None
        self._stand_in.begin()
        self._admission.begin()
        self._state = state = self._simulation.reset(seed)
        number = self._episode.episode + 1
        self._episode = Episode(
            episode=number, seed=seed, sigma=sigma, policy_version=policy, stones=self._simulation.parameters.stones
        )
        self._topics.begin(self._episode)
        self._announce(Episode.RUNNING)
        self._publish(state)

    def _go_on(self) -> None:
        """Step, if the torque is there, nobody paused and the pace allows it."""
        if self._torque is not None and self._ticks.due and not self._paused:
            self._stand_in.answered(self._torque)
            self._step(self._torque, Source.ANSWER)

    def _step(self, torque: Array, source: Source) -> None:
        before = stamp(self._clock_ticks), self._episode.episode, self._episode.tick
        self._state, self._torque = self._simulation.step(torque), None
        self._episode.tick, self._episode.touchdowns = self._state.tick, self._state.touchdowns
        self._clock_ticks += 1
        self._ticks.wait()
        if self._own.real_time:
            self._ticks.simulated(*before, source)
        self._publish(self._state)
        if not self._state.running or self._stand_in.is_over:
            self._end(*self._stand_in.verdict(self._simulation.outcome.value))

    def _end(self, outcome: str, reason: str = "") -> None:
        if self._state is None:
            return
        self._episode.outcome, self._episode.reason = outcome, reason[:128]
        self._announce(Episode.ENDED)
        self._topics.end(self._episode)
        if 0 < self._own.episodes <= self._episode.episode and reason != BY_SERVICE:
            self.get_logger().info("all episodes are done")
        self._state = self._torque = None
        self._wait.begin()

    def _publish(self, state: RobotState) -> None:
        """A tick's messages."""
        self._memory.note(restart_point(self._episode, self._clock_ticks))
        now, truth = stamp(self._clock_ticks), self._simulation.reading
        self._topics.tick(state, self._episode.episode, now, self._simulation.landings, truth)
        self._ticks.sent()
        if self._wait.reminders:
            self.get_logger().warning(f"goes on with tick {state.tick} of episode {self._episode.episode}")
        self._wait.begin()

    def _announce(self, phase: int) -> None:
        """Publish where the episode stands."""
        self._episode.phase, self._episode.stamp = phase, stamp(self._clock_ticks)
        self._memory.note(restart_point(self._episode, self._clock_ticks))
        self._topics.episode(self._episode)

    def _look(self) -> None:
        """Begin what can begin; end what nobody answers."""
        self._wait.look()
        if self._paused:
            return
        if self._state is None:
            self._begin_next()
        elif self._torque is None:
            self._remind(self._state)

    def _remind(self, state: RobotState) -> None:
        """Ask for a torque again, or end the episode."""
        if self._wait.seconds > self._own.answer_timeout:
            self._live_controllers.said_nothing()
            self._end("silent", f"no torque for tick {state.tick} came in {self._own.answer_timeout:g} s")
        elif self._wait.is_reminder_due():
            self._live_controllers.asked_again()
            if self._wait.reminders == 1:
                self.get_logger().warning(f"waits for {self._missing()}")
            self._announce(Episode.RUNNING)
            self._topics.again(state, self._episode.episode, stamp(self._clock_ticks))

    def _is_planned(self) -> bool:
        """Whether the trainer has planned the next episode, where that matters."""
        if self._own.trainer == "ignore":
            return True
        return self._plan is not None and self._plan.after_episode == self._episode.episode

    def _begin_next(self) -> None:
        done, plan = self._episode.episode, self._plan
        if done >= self._own.episodes or not self._answered_by_someone():
            return
        if not self._is_planned():
            self._wait_for_trainer()
        elif self._own.trainer == "follow" and plan is not None:
            self._begin(plan.seed, plan.sigma, plan.policy_version)
        else:
            self._begin(self._own.seed + done)

    def _wait_for_trainer(self) -> None:
        if self._wait.seconds > self._own.trainer_timeout:
            self._episode.outcome = "silent"
            self._episode.reason = f"the trainer has planned nothing in {self._own.trainer_timeout:g} s"
            self.get_logger().warning(self._episode.reason)
            self._announce(Episode.ENDED)
            self._wait.give_up()  # said once

    def _answered_by_someone(self) -> bool:
        return self._topics.readers >= self._own.readers and self._live_controllers.any

    def _set_pace(self, own: NodeParameters) -> None:
        """Follow a new pace between two ticks."""
        self._own = own
        self._ticks.set_pace(own.pace or float(own.real_time))
        self._go_on()  # with the torque that waited for its time

    def _on_due(self) -> None:
        self._go_on()
        if self._ticks.due and self._own.real_time and self.executor is not None:
            self.executor.create_task(self._do_without)  # behind what has come in already

    def _do_without(self) -> None:
        """Real time does not wait for a torque, but for an episode's first."""
        if self._state is None or not self._ticks.due or self._paused:
            return
        if self._state.tick == 0:
            self._ticks.due = False  # the first tick begins at the next pace after its torque
            return
        torque, source = self._stand_in.missed(self._state.joint_rates)
        if source is Source.HELD and self._stand_in.gave_up:
            self._live_controllers.said_nothing()  # until one speaks again, be it too late
        self._step(torque, source)

    def _missing(self) -> str:
        """What the simulator waits for; empty when it goes on."""
        if self._state is not None:
            if self._paused or self._torque is not None or self._wait.seconds <= REPEAT_SECONDS:
                return ""
            who = "the controller" if self._state.sensors is None else "estimator or controller"
            return f"{who}: no torque for tick {self._state.tick} of episode {self._episode.episode}"
        missing = [] if self._answered_by_someone() else ["a controller, or more readers"]
        if not self._is_planned():
            missing.append(f"the trainer: no plan after episode {self._episode.episode}")
        return " and ".join(missing)

    def _status(self) -> Status:
        e, punctuality = self._episode, self._ticks.punctuality
        figures = {"episode": e.episode, "outcome": e.outcome, "paused": self._paused, "scheduling": scheduling()}
        if self._own.real_time:
            figures |= punctuality.figures
        if missing := self._missing():
            return WARN, f"waiting for {missing}", figures
        if not punctuality.is_fit:
            return WARN, f"this machine is not fit for real time: {punctuality}", figures
        return OK, f"episode {e.episode}" if self._state is not None else "between episodes", figures


def main() -> None:
    """The executable `simulator`."""
    run(SimulatorNode, errors=ERRORS)


if __name__ == "__main__":
    main()

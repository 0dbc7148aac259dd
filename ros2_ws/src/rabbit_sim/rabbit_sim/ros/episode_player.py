"""Plays the simulator's episodes: begins, steps, ends and announces them, and publishes every tick."""

import math
from collections.abc import Callable
from pathlib import Path

from rabbit_common.message_checks import Refused, check_turn
from rabbit_common.ros.conversions import header, set_time, torque_of
from rabbit_description.state import Array, RobotState
from rabbit_description.task_simulation import TaskSimulation
from rabbit_msgs.msg import Episode, TorqueCommand
from rclpy.node import Node

from rabbit_sim.parameters import PlayerParameters
from rabbit_sim.real_time import Source, StandIn
from rabbit_sim.restart_file import RestartFile
from rabbit_sim.ros.live_controllers import REPEAT_SECONDS, ControllerAdmission, Wait
from rabbit_sim.ros.publishers import KEPT, Publishers, episode_of
from rabbit_sim.ros.tick_clock import TickClock
from rabbit_sim.simulation import Simulation

BY_SERVICE = "by service"  # reason of a reset after which another episode begins at once
Played = Simulation | TaskSimulation


class EpisodePlayer:
    """`episode`: where it stands; `state`: whose torque is awaited, None between episodes; `torque`: its answer.

    `clock_ticks`: since the clock began; `wait`: for that, or for what the next episode needs; `ticks`: their pace;
    `topics`: what it publishes; `admission`: who may answer; `stand_in`: what acts in real time where nobody does.
    """

    def __init__(
        self, node: Node, p: PlayerParameters, simulation: Played, topics: Publishers, on_due: Callable[[], None]
    ) -> None:
        """`on_due` is called when a tick is due; raises `RestartFileError`."""
        self._log, self._p = node.get_logger(), p
        self.simulation, self.topics = simulation, topics
        self._memory = RestartFile(Path(p.memory) if p.memory else None)
        before = self._memory.stand  # of a simulator that was killed
        self.clock_ticks, self._now = before.clock_ticks, header(0)
        self._tick_seconds = simulation.tick_seconds
        self._same = {"sender": topics.sender, "stones": topics.stones, "tick_seconds": self._tick_seconds}
        self._same |= simulation.layout.names  # of all episodes
        self.episode = episode_of(before, **self._same)
        self.state: RobotState | None = None
        self.torque: Array | None = None
        self.stand_in = StandIn(p.held_ticks, p.damped_ticks, p.damping)
        self.admission, self.wait = ControllerAdmission(), Wait()
        self.ticks = TickClock(node, self._tick_seconds, p.late_limit, on_due)
        if before.running:
            self._log.warning(f"episode {before.episode}, tick {before.tick}: {self.episode.reason}")

    def begin(self, seed: int, sigma: float = math.nan, policy: str = "") -> None:
        """Reset the plant; tick 0 goes out at once."""
        if self.topics.is_lab:
            self.clock_ticks += 1  # what the sensors say is matched by its stamp, which no two ticks share
        self.torque = None
        self.wait.begin()
        self.stand_in.begin()
        self.admission.begin()
        self.state = state = self.simulation.reset(seed)
        number = self.episode.episode + 1
        self.episode = Episode(episode=number, seed=seed, sigma=sigma, policy_version=policy, **self._same)
        self.topics.begin(self.episode)
        self.announce(Episode.RUNNING)
        self._publish(state)

    def take(self, tick: int, torque: Array) -> None:
        """The answer to this tick's state, (4,) N m; one to an earlier tick stands in for this one's until it comes."""
        assert self.state is not None
        self.stand_in.answer(tick, torque)
        self.ticks.answered(tick)
        if tick == self.state.tick:
            self.torque = torque

    def step_without_answer(self) -> bool:
        """Simulate a tick under what stands in, but no first one. Returns whether no answer counts from now on."""
        if self.state is None or self.state.tick == 0:
            self.ticks.due = False  # the first tick begins at the next pace after its torque
            return False
        gave_up = self.stand_in.gave_up
        torque, source = self.stand_in.missed(self.state.tick, self.simulation.joint_rates(self.state))
        self.step(torque, source)
        return self.stand_in.gave_up and not gave_up

    def step(self, torque: Array, source: Source = Source.ANSWER) -> None:
        """Simulate a tick under `torque` (4,), N m; ends the episode if it is over."""
        before = self.clock_ticks, self.episode.episode, self.episode.tick
        self.state, self.torque = self.simulation.step(torque), None
        self.episode.tick, self.episode.touchdowns = self.state.tick, self.state.touchdowns
        self.clock_ticks += 1
        self.ticks.wait()
        if self._p.real_time:
            self.ticks.simulated(header(before[0], self._tick_seconds), *before[1:], source)
        self._publish(self.state)
        if not self.state.running or self.stand_in.is_over:
            self.end(*self.stand_in.verdict(*self.simulation.verdict))

    def end(self, outcome: str, reason: str = "") -> None:
        """End the episode, if one runs."""
        if self.state is None:
            return
        self.episode.outcome, self.episode.reason = outcome, reason[:128]
        self.announce(Episode.ENDED)
        self.topics.end(self.episode)
        if 0 < self._p.episodes <= self.episode.episode and reason != BY_SERVICE:
            self._log.info("all episodes are done")
        self.state = self.torque = None
        self.wait.begin()

    def announce(self, phase: int) -> None:
        """Publish where the episode stands."""
        self.episode.phase, self.episode.header = phase, header(self.clock_ticks, self._tick_seconds)
        kept = {name: getattr(self.episode, name) for name in KEPT}
        self._memory.note(clock_ticks=self.clock_ticks, running=phase in (Episode.RUNNING, Episode.PAUSED), **kept)
        self.topics.episodes.publish(self.episode)

    def give_up(self, reason: str) -> None:
        """The next episode cannot begin: say so once."""
        self.episode.outcome, self.episode.reason = "silent", reason
        self._log.warning(reason)
        self.announce(Episode.ENDED)
        self.wait.give_up()

    def checked(self, message: TorqueCommand) -> Array:
        """The torque (4,) of a message, N m; raises `Refused` if it does not answer the state.

        In real time one that answers an earlier state is of use if it is newer than what acts.

        Two controllers that cannot be told apart end the episode.
        """
        if self.state is not None and message.episode == self.episode.episode:
            if fault := self.admission.mixed(message):
                self.end("fault", fault)
                raise Refused("two without a name", fault)
            self.admission.check(message.sender, is_asked_again=self.wait.reminders > 0)
        if self.state is None or self.torque is not None:
            raise Refused("not awaited", f"episode {message.episode}, tick {message.tick}")
        turn = self.episode.episode, self.state.tick
        is_late = self._p.real_time and self.stand_in.answered < message.tick < self.state.tick
        check_turn((message.episode, message.tick), (turn[0], message.tick) if is_late else turn)
        if self.stand_in.gave_up:
            raise Refused("too late", f"the joints are damped since tick {self.state.tick}")
        return torque_of(message, len(self.simulation.layout.joints))

    @property
    def missing(self) -> str:
        """The torque that is late; empty: none is."""
        if self.state is None or self.torque is not None or self.wait.seconds <= REPEAT_SECONDS:
            return ""
        who = "the controller" if self.state.sensors is None else "estimator or controller"
        return f"{who}: no torque for tick {self.state.tick} of episode {self.episode.episode}"

    def name_controllers(self) -> None:
        """Announce whose torques act and whose are refused, where that is new."""
        e, now = self.episode, (self.admission.controller or "", self.admission.refused)
        if now == (e.controller, e.refused_controller):
            return
        if now[1] != e.refused_controller:
            self._log.error(f"two controllers answer: torques of {now[1]} are refused, those of {now[0]} act")
        e.controller, e.refused_controller = now
        self.announce(e.phase)

    def ask_again(self, state: RobotState) -> None:
        """Announce the episode and publish the state once more."""
        self.announce(Episode.RUNNING)
        self.topics.again(state, self.episode.episode, header(self.clock_ticks, self._tick_seconds))

    def _publish(self, state: RobotState) -> None:
        """A tick's messages."""
        self._memory.note(clock_ticks=self.clock_ticks, tick=state.tick, touchdowns=state.touchdowns)
        set_time(self._now, self.clock_ticks, self._tick_seconds)
        self.topics.tick(state, self.episode.episode, self._now)
        self.ticks.sent(state.tick)
        if self.wait.reminders:
            self._log.warning(f"goes on with tick {state.tick} of episode {self.episode.episode}")
        self.wait.begin()

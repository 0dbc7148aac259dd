"""The state estimator's node: what a lab's sensors say of a tick comes in on three topics, the state goes out.

`measured` says which tick it is and which foot touches the ground; `joint_states` and `imu` of the same stamp say the
rest. A tick that is asked for again is answered again. An estimator that comes in the middle of an episode knows
neither where the robot began nor which leg stands since when: it answers with a state whose q and dq are NaN, and the
controller ends the episode.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from rabbit_common.message_checks import Refused, check_finite, check_lengths, check_turn, doubles
from rabbit_common.priority import scheduling, take_priority
from rabbit_common.ros.conversions import LENGTHS, Announcements, imu_of, joints_of, nanoseconds, other_tick
from rabbit_common.ros.diagnostics import OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_common.ros.simulator_follower import SimulatorFollower
from rabbit_common.ros.spin import run
from rabbit_description.state import DOF, BodySensors, RobotState
from rabbit_msgs.msg import Episode
from rabbit_msgs.msg import RobotState as StateMessage
from sensor_msgs.msg import Imu, JointState

from rabbit_estimator.contact_aided_filter import ContactAidedFilter, EstimatorError, LostError
from rabbit_estimator.parameters import EstimatorParameters, NodeParameters

SENSORS: dict[str, tuple[Any, Callable[[Any], tuple[Any, ...]]]] = {  # by topic; the fields of `BodySensors` in turn
    "joint_states": (JointState, joints_of),
    "imu": (Imu, imu_of),
}
UNKNOWN = np.full(DOF, np.nan)
NEWEST = 100  # messages of a sensor that are kept for their tick
LONG = 0.5  # s that a tick may wait for its sensors


class EstimatorNode(SimulatorFollower):
    """Answers what is measured with states."""

    def __init__(self) -> None:
        super().__init__("estimator")
        node_parameters = declare(self, NodeParameters)
        parameters = declare(self, EstimatorParameters)
        refuse_unknown(self)
        take_priority(node_parameters.priority, self.get_logger().warning)
        self._estimator, self._tick_seconds = ContactAidedFilter(parameters), parameters.tick_seconds
        self._episode, self._announcements = Episode(), Announcements()
        self._forget()
        self._states = self.create_publisher(StateMessage, "state", TICK)
        self._inputs = self._hear_simulator(StateMessage, "measured", self._on_measured, TICK)
        for topic, (kind, _) in SENSORS.items():
            self._hear(kind, topic, partial(self._on_sensor, topic), TICK)
        self._hear_simulator(Episode, "episode", self._on_episode, EVENT)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        self.get_logger().info("ready")

    def _forget(self) -> None:
        """A simulator that nobody has heard of yet."""
        self._turn = (0, -1)  # episode and tick of the newest measurement
        self._early: StateMessage | None = None  # of an episode that is not announced yet
        self._open: deque[StateMessage] = deque()  # measurements that wait for their sensors
        self._said: dict[str, dict[int, tuple[Any, ...]]] = {topic: {} for topic in SENSORS}  # by stamp, ns
        self._used = -1  # stamp of the newest that was used
        self._answer: StateMessage | None = None  # to the newest measurement
        self._lost = 0  # the episode of which nothing is known any more

    # What comes in

    def _on_measured(self, message: StateMessage) -> None:
        turn = (message.episode, message.tick)
        check_lengths(message, LENGTHS)
        if message.running:
            check_finite("foot_force", message.foot_force)
        if turn == self._turn:
            self._repeat(message)
            return
        if message.episode > self._episode.episode:
            self._early = message
            return
        begins = self._turn[0] < message.episode == self._episode.episode
        if not begins or not message.running:
            check_turn(turn, (self._turn[0], self._turn[1] + 1))
        self._message_counter.accept("measured")
        self._announcements.went_on()
        self._turn, self._early, self._answer = turn, None, None
        if begins:
            self._open.clear()
            self._used = nanoseconds(message.header.stamp) - 1  # wherever the clock stood before
        self._open.append(message)
        self._since = time.monotonic()
        if begins and message.tick > 0:
            self._give_up(message, f"the estimator came in at tick {message.tick}, in the middle of the episode")
        elif begins and (fault := other_tick(self._episode, self._tick_seconds)):
            self._give_up(message, fault)
        self._go_on()

    def _repeat(self, message: StateMessage) -> None:
        """The simulator has not heard the answer: say it again, if there is one. Else its last word counts."""
        self._message_counter.accept("measured again")
        if self._answer is not None:
            self._states.publish(self._answer)
        elif self._open:
            self._open[-1] = message
            self._go_on()

    def _on_sensor(self, topic: str, message: Any) -> None:
        """Keep what it says for its tick; of two with the same stamp the later one counts."""
        at, said = nanoseconds(message.header.stamp), self._said[topic]
        if at < self._used:
            raise Refused("late", f"stamp {at} ns; expected {self._used} or a later one")
        reading = SENSORS[topic][1](message)
        if at == self._used:
            self._message_counter.accept(f"{topic} again")
            return
        self._message_counter.accept(topic)
        said[at] = reading
        if len(said) > NEWEST:
            del said[next(iter(said))]
        self._go_on()

    def _on_episode(self, message: Episode) -> None:
        if self._announcements.check(message, self._turn[0]):
            self._forget()
        self._message_counter.accept("episode")
        self._episode = message
        if self._early is not None and self._early.episode == message.episode:
            try:
                self._on_measured(self._early)
            except Refused as error:
                self._refuse("measured", error)

    # The tick

    def _go_on(self) -> None:
        """Answer the measurements in their order, as far as their sensors are there."""
        while self._open and self._is_estimated(self._open[0]):
            message = self._answer = self._open.popleft()
            self._used = nanoseconds(message.header.stamp)
            self._said = {
                topic: {at: reading for at, reading in said.items() if at > self._used}
                for topic, said in self._said.items()
            }
            self._states.publish(message)

    def _is_estimated(self, message: StateMessage) -> bool:
        """Fill in q and dq, NaN where they cannot be known; False: the sensors have not been heard."""
        message.q, message.dq = doubles(UNKNOWN), doubles(UNKNOWN)
        if message.episode == self._lost:
            return True
        at = nanoseconds(message.header.stamp)
        if not all(at in said for said in self._said.values()):
            return False
        sensors = BodySensors(*(field for said in self._said.values() for field in said[at]))
        try:
            state = self._estimator.update(replace(RobotState.of_message(message, None), sensors=sensors))
        except LostError as error:
            self._give_up(message, str(error))
            return True
        except EstimatorError as error:
            if not message.running:  # the robot diverged
                return True
            self._refuse("sensors", Refused("not fit", str(error)))
            for said in self._said.values():
                del said[at]
            return False
        message.q, message.dq = doubles(state.q), doubles(state.dq)
        return True

    def _give_up(self, message: StateMessage, reason: str) -> None:
        """Gives the state up: nothing is known of it until the next episode begins."""
        self.get_logger().error(reason)
        self._lost = message.episode

    def _status(self) -> Status:
        belief = self._estimator.belief
        figures = {
            "normalised innovation": belief.nis.item() / belief.measured.item() if belief.measured > 0 else "",
            "scheduling": scheduling(),
        }
        episode, tick = self._turn
        if not self._inputs.get_publisher_count():
            return WARN, "waiting for a simulator with sensors lab", figures
        if self._early:
            return WARN, f"waits for the announcement of episode {self._early.episode}", figures
        if self._open and time.monotonic() - self._since > LONG:
            at = nanoseconds(self._open[0].header.stamp)
            missing = [topic for topic, said in self._said.items() if at not in said]
            return WARN, f"tick {tick} of episode {episode} waits for {' and '.join(missing)}", figures
        if 0 < self._lost == episode:
            return WARN, f"of episode {episode} nothing is known any more", figures
        return OK, f"episode {episode}", figures


def main() -> None:
    """The executable `estimator`."""
    run(EstimatorNode)

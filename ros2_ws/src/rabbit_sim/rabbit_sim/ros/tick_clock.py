"""The clock of real time: when ticks are due and were simulated, how long torques took; told on `timing`."""

import math

from builtin_interfaces.msg import Time
from rabbit_description.state import TICK_SECONDS
from rabbit_msgs.msg import Timing
from rabbit_ros.ros.qos import TICK
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from rabbit_sim.real_time import LATE_SECONDS, Punctuality, Source

NANOSECOND = 1e-9


class TickClock:
    """Times by the clock that the node's timers go by."""

    def __init__(self, node: Node, late_limit: float) -> None:
        self.punctuality = Punctuality(late_limit)
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._publisher = node.create_publisher(Timing, "timing", TICK)
        self._sent = self._acting_sent = self._response = math.nan
        self.start(TICK_SECONDS)

    def start(self, period: float) -> None:
        """Ticks are due every `period` s from now on; call it beside the timer's start."""
        self._period, self._due, self._late = period, self._now(), 0.0

    def due(self) -> bool:
        """A tick is due: the timer says so. True: that late that the timer is to begin anew, for a whole next tick."""
        now = self._now()
        self._late = max(0.0, now - self._due - self._period)
        is_late = self._late > LATE_SECONDS
        self._due = now if is_late else self._due + self._period
        return is_late

    def sent(self) -> None:
        """A state went out."""
        self._sent, self._response = self._now(), math.nan

    def answered(self) -> None:
        """Its torque came in."""
        self._response = self._now() - self._sent

    def simulated(self, at: Time, episode: int, tick: int, source: Source) -> None:
        """A tick that began `at` this simulated time was simulated under what `source` says."""
        if source is Source.ANSWER:
            self._acting_sent = self._sent
        self.punctuality.add(self._late, source)
        age = math.nan if source is Source.DAMPING else self._now() - self._acting_sent
        told = {"source": int(source), "late": self._late, "response": self._response, "age": age}
        self._publisher.publish(Timing(stamp=at, episode=episode, tick=tick, **told))

    def _now(self) -> float:
        return float(self._clock.now().nanoseconds) * NANOSECOND

"""The pace of ticks: says when one is due, measures how punctual it was and how long torques took (topic `timing`)."""

import math
from collections.abc import Callable

from rabbit_common.ros.qos import TICK
from rabbit_common.ros.spin import steady_timer
from rabbit_description.state import TICK_SECONDS
from rabbit_msgs.msg import Timing
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer
from std_msgs.msg import Header

from rabbit_sim.real_time import LATE_SECONDS, Punctuality, Source

NANOSECOND = 1e-9


class TickClock:
    """Times by the clock that the node's timers go by. `due`: the next tick may be simulated."""

    def __init__(self, node: Node, tick_seconds: float, late_limit: float, on_due: Callable[[], None]) -> None:
        self.punctuality, self.due = Punctuality(late_limit), True
        self._node, self._on_due = node, on_due
        self._tick_seconds, self._late_seconds = tick_seconds, LATE_SECONDS * tick_seconds / TICK_SECONDS
        self._timer: Timer | None = None
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._publisher = node.create_publisher(Timing, "timing", TICK)
        self._late = 0.0
        self._sent: dict[int, float] = {}  # when the state of each of an episode's ticks went out
        self._tick, self._acting, self._response = 0, math.nan, math.nan

    def set_pace(self, pace: float) -> None:
        """Ticks are due `pace` times as often as in real time, from now on; 0: at any time."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None
        if pace > 0:
            self._period = self._tick_seconds / pace
            self._timer = steady_timer(self._node, self._period, self._tick_is_due)
            self._due_at, self._late = self._now(), 0.0
        self.due = self._timer is None

    def _tick_is_due(self) -> None:
        """One that comes too late is followed by a whole next one."""
        now, self.due = self._now(), True
        self._late = max(0.0, now - self._due_at - self._period)
        self._due_at += self._period
        if self._late > self._late_seconds and self._timer is not None:
            self._due_at = now
            self._timer.reset()
        self._on_due()

    def sent(self, tick: int) -> None:
        """A tick's state went out."""
        if tick == 0:
            self._sent.clear()
        self._sent[tick], self._tick, self._response = self._now(), tick, math.nan

    def answered(self, tick: int) -> None:
        """A tick's torque came in; it acts from now on."""
        self._acting = self._sent[tick]
        if tick == self._tick:
            self._response = self._now() - self._acting

    def simulated(self, at: Header, episode: int, tick: int, source: Source) -> None:
        """A tick of real time that began `at` this time was simulated under what `source` says."""
        self.punctuality.add(self._late, source)
        age = math.nan if source is Source.DAMPING else self._now() - self._acting
        measured = {"source": int(source), "late": self._late, "response": self._response, "age": age}
        self._publisher.publish(Timing(header=at, episode=episode, tick=tick, **measured))

    def wait(self) -> None:
        """A tick was simulated: the next one is due in its time."""
        self.due = self._timer is None

    def _now(self) -> float:
        return float(self._clock.now().nanoseconds) * NANOSECOND

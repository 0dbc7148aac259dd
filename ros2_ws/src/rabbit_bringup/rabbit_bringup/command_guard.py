"""Who holds the motors asks for news: a command acts while it and the sensors that it answers are new.

The bridge and the controller may die, or stand still and go on: then there is no torque, and none again until the
bridge has commanded zero, as it does before it enables the robot.
"""

from typing import Any

import numpy as np
from pydantic import Field
from rabbit_description.state import ACTUATED, Array
from rabbit_description.validation import Checked

SECOND = 1_000_000_000  # ns
REST = np.zeros(len(ACTUATED))


class GuardParameters(Checked):
    """How old a command may be."""

    timeout: float = Field(0.05, gt=0, le=60, description="without a command, or joint_states, for so long: zeros, s")
    largest_age: float = Field(
        0.05, gt=0, le=1, description="older sensors than joint_states by so much, and a command is void, s"
    )
    command_limit: float = Field(200.0, gt=0, le=200, description="largest torque of each joint that acts, N m")
    priority: int = Field(0, ge=0, le=99, description="SCHED_FIFO priority, where permitted; 0: an ordinary process")


class CommandGuard:
    """`acts`: the torque (4,), N m, that goes to the motors; `fault`: why it is zero, empty while commands act.

    `now` is s by a steady clock, a stamp ns by the sensors'.
    """

    def __init__(self, parameters: GuardParameters) -> None:
        self._p = parameters
        self.acts, self.fault = REST, "no command of zero yet"
        self._sensed, self._sensed_at, self._commanded_at = 0, -np.inf, -np.inf

    def sense(self, stamp: int, now: float) -> None:
        """The newest stamp of joint_states."""
        self._sensed, self._sensed_at = stamp, now

    def command(self, torque: Array, stamp: int, now: float) -> None:
        """A command (4,), N m, finite, that answers sensors of this `stamp`."""
        self.look(now)
        self._commanded_at = now
        if not torque.any():
            self.acts, self.fault = REST, ""
            return
        age = (self._sensed - stamp) / SECOND
        if age > self._p.largest_age:
            self._stop(f"a command of sensors that are {age:.3f} s old; expected at most {self._p.largest_age:g}")
        if not self.fault:
            self.acts = np.clip(torque, -self._p.command_limit, self._p.command_limit)
        self.look(now)

    def look(self, now: float) -> None:
        """Stops the robot where commands or sensors are older than the timeout."""
        ages: dict[str, Any] = {"command": now - self._commanded_at, "joint_states": now - self._sensed_at}
        for name, age in ages.items():
            if self.acts.any() and age > self._p.timeout:
                self._stop(f"no {name} for {age:.3f} s; expected one every {self._p.timeout:g} s")

    def alone(self, masters: int) -> bool:
        """Whether no more than one commands; of several nobody knows which one is the bridge, and none is obeyed."""
        if masters > 1:
            self._stop(f"{masters} publishers of stamped_commands; expected the bridge alone")
        return masters <= 1

    def _stop(self, reason: str) -> None:
        self.acts, self.fault = REST, self.fault or reason

"""Whether a robot's sensors can be believed: their stamps make ticks, and the encoders turn as the robot does."""

from collections.abc import Sequence

import numpy as np
from rabbit_description.state import ACTUATED, TICK_SECONDS, Array, BodySensors

JITTER = 0.1  # of a tick, by which the sensors' stamps may come early
SECOND = 1_000_000_000  # ns
TURNS = 0.5  # rad/s, above which the robot moves


class SensorClock:
    """The sensors are the clock: a tick is complete once all have a stamp a tick after the last one's.

    `ticked`: the stamp of the newest tick, ns, 0 before the first; `fault`: why nobody may walk by it, or empty.
    """

    def __init__(
        self, names: Sequence[str], largest_tick: float, largest_skew: float, tick_seconds: float = TICK_SECONDS
    ) -> None:
        self._tick = round(tick_seconds * SECOND)
        self._largest_tick, self._largest_skew = largest_tick, largest_skew
        self._stamps = dict.fromkeys(names, 0)
        self.ticked, self.fault = 0, ""

    def take(self, name: str, stamp: int) -> bool:
        """A sensor's newest stamp, ns. Returns whether it completes a tick, or shows that the clock went back."""
        before, self._stamps[name] = self._stamps[name], stamp
        if stamp < before:
            self.fault = f"clock went back: {name} from {before / SECOND:.3f} to {stamp / SECOND:.3f} s"
            self._stamps = dict.fromkeys(self._stamps, 0) | {name: stamp}
            self.ticked = 0
            return True
        (last, oldest), (first, newest) = self._ends
        if not oldest or oldest < self.ticked + (1 - JITTER) * self._tick:
            return False
        passed, skew = (oldest - self.ticked) / SECOND, (newest - oldest) / SECOND
        self.fault = ""
        if self.ticked and passed > self._largest_tick:
            self.fault = f"tick too long: {passed:.3f} s by the stamps; expected at most {self._largest_tick:g}"
        elif skew > self._largest_skew:
            self.fault = f"skew: {first} is {skew:.3f} s ahead of {last}; expected at most {self._largest_skew:g}"
        self.ticked = oldest
        return True

    @property
    def _ends(self) -> tuple[tuple[str, int], tuple[str, int]]:
        """The oldest and the newest of the newest stamps."""
        in_order = sorted(self._stamps.items(), key=lambda name_and_stamp: name_and_stamp[1])
        return in_order[0], in_order[-1]

    def __str__(self) -> str:
        """Who is late, and by how much."""
        (last, oldest), (first, newest) = self._ends
        if not oldest:
            return f"{last} has said nothing"
        return f"{last} is {(newest - oldest) / SECOND:.3f} s behind {first}"


class EncoderWatch:
    """How long an encoder's angle has been the same, `still` (4,), s, and how far the robot has turned meanwhile,
    `turned` (4,), rad: by the fastest of joints and torso."""

    def __init__(self, frozen_time: float) -> None:
        self._frozen_time, self._angles = frozen_time, np.full(len(ACTUATED), np.nan)
        self.still = self.turned = np.zeros(len(ACTUATED))

    def see(self, sensors: BodySensors, seconds: float) -> None:
        """What they say so many s later."""
        rate = max(abs(sensors.pitch_rate), float(np.abs(sensors.joint_rates).max()))
        is_same = sensors.joint_angles == self._angles
        self.still = np.where(is_same, self.still + seconds, 0.0)
        self.turned = np.where(is_same, self.turned + rate * seconds, 0.0)
        self._angles = sensors.joint_angles

    @property
    def are_frozen(self) -> Array:
        """Which are, (4,)."""
        return (self.still > self._frozen_time) & (self.turned > TURNS * self.still)

"""Real time: which torque acts in a tick, and how well the machine keeps time.

State k goes out as tick k begins. The torque that answers it acts over the whole tick, which is simulated at its end:

    answered by then      its torque
    not answered          the newest torque again, while the state that it answers is at most `held_ticks` ticks old
    no newer torque       joint damping, u_j = -d dq_j, for `damped_ticks`; no answer counts any more, the episode ends

An answer that comes a tick late is thus of use: it stands in for the next one. A controller that dies after its answer
to tick k is held for over ticks k + 1 and k + 2, and damped from tick k + 3.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import IntEnum

from rabbit_description.state import Array, no_torque

LATE_SECONDS = 0.002  # later than this, a tick is late
WINDOW = 6000  # newest ticks that fitness is judged by, one minute


class Source(IntEnum):
    """What acted in a tick."""

    ANSWER = 0
    HELD = 1
    DAMPING = 2


class StandIn:
    """What acts where no torque has come, in one episode. `damping` in N m s/rad; `answered`: the newest such tick."""

    def __init__(self, held_ticks: int, damped_ticks: int, damping: float) -> None:
        self._held_ticks, self._damped_ticks, self._damping = held_ticks, damped_ticks, damping
        self.begin()

    def begin(self) -> None:
        """A new episode."""
        self._torque: Array = no_torque()
        self.answered = -1
        self._held = self._damped = 0

    @property
    def gave_up(self) -> bool:
        """The joints are damped: no answer counts any more."""
        return self._damped > 0

    @property
    def is_over(self) -> bool:
        """All damped ticks were walked."""
        return self.gave_up and self._damped >= self._damped_ticks

    def answer(self, tick: int, torque: Array) -> None:
        """The newest torque (4,), N m, and the tick that it answers."""
        self.answered, self._torque = tick, torque

    def missed(self, tick: int, rates: Array) -> tuple[Array, Source]:
        """Tick `tick` has no answer, but an earlier one had: what acts in its place, (4,) N m.

        `rates` (4,): of the joints as it began, rad/s.
        """
        if self.gave_up or tick - self.answered > self._held_ticks:
            self._damped += 1
            return -self._damping * rates, Source.DAMPING
        self._held = tick - self.answered
        return self._torque, Source.HELD

    def verdict(self, outcome: str, reason: str = "") -> tuple[str, str]:
        """Outcome and reason of an episode that ends now and that the plant says `outcome` of, and why."""
        if not self.gave_up:
            return outcome, reason
        fate = "" if outcome == "running" else f", {outcome}"
        return (
            "silent",
            f"no torque in time: the last one held for {self._held}, joints damped for {self._damped} ticks{fate}",
        )


@dataclass
class Punctuality:
    """Counts late ticks and missed deadlines; `is_fit` judges the newest `WINDOW` ticks by the share `limit`."""

    limit: float
    ticks: int = 0
    late: int = 0
    missed: int = 0
    worst: float = 0.0
    _newest: deque[bool] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def add(self, late_by: float, source: Source) -> None:
        """A tick was simulated `late_by` s after it was due."""
        is_late = late_by > LATE_SECONDS
        self._newest.append(is_late)
        self.ticks += 1
        self.late += is_late
        self.missed += source is not Source.ANSWER
        self.worst = max(self.worst, late_by)

    @property
    def figures(self) -> dict[str, float]:
        """The figures for diagnostics."""
        return {"ticks": self.ticks, "late ticks": self.late, "missed deadlines": self.missed, "worst (s)": self.worst}

    def __str__(self) -> str:
        """States how many ticks were late, for the log."""
        count, seconds = sum(self._newest), LATE_SECONDS * 1e3
        return f"{count} of the newest {len(self._newest)} ticks more than {seconds:g} ms late, limit {self.limit:.1%}"

    @property
    def is_fit(self) -> bool:
        """Whether no more ticks were late than the limit allows in a whole window."""
        return sum(self._newest) <= self.limit * WINDOW

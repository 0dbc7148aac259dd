"""How noisy the measured rates are, found from the pitch rate.

Of three rates a tick apart, each with an error of variance sigma^2, the second difference has the variance 6 sigma^2;
of the torso's motion itself hardly anything is left in it: its second differences say 0.015 rad/s of a walk without
noise. Those of the joints' rates would not do. In the first ticks of a walk they say 0.2 rad/s.
"""

from rl_cbf_clf_controller.identification import RATE_NOISE

PER_VARIANCE = 6.0  # of a second difference
CORRELATED = 6.0  # ticks over which the identification's low-passed errors are the same
FIRST_DIFFERENCES = 3  # before which nothing is known


class RateNoise:
    """`variance` of the rates' errors, (m/s)^2 and (rad/s)^2, as the identification takes it; None at first.

    That without noise, of what a tick's mean leaves out, is in it.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self._squares, self._differences = 0.0, 0
        self.interrupt()

    def interrupt(self) -> None:
        """The next tick does not follow the last one."""
        self._rates: list[float] = []

    def add(self, start: float, end: float) -> None:
        """The pitch rate at a tick's ends, rad/s."""
        self._rates = [*(self._rates or [start]), end][-3:]
        if len(self._rates) == 3:
            first, middle, last = self._rates
            self._squares += (first - 2 * middle + last) ** 2
            self._differences += 1

    @property
    def variance(self) -> float | None:
        if self._differences < FIRST_DIFFERENCES:
            return None
        return RATE_NOISE**2 + CORRELATED * self._squares / (PER_VARIANCE * self._differences)

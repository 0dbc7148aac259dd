"""The slope that the next step is made for, chosen at each touchdown by a learned model of the speed from step to step.

The problem. A robot that climbs, is held back by its joints, or carries a load behind its hip walks slower than its
gait. Before it knows why, it can take the next step from a gait for steeper ground: that leans the torso forward, and
the robot falls faster into its step. But a push makes it slower or faster too, and is gone with the next step. A robot
that answers to a push as to a hill walks on with the wrong gait, and falls.

So two questions are asked at a touchdown. First: on which slope would the speed be what it is? Let v_k be the mean
speed of step k less that of its periodic gait, gamma_k the slope, degrees, that step k was made for, and Gamma the
slope on which the robot would keep its gait's speed. In walks with random changes of gamma the speed follows

    v_k = A v_{k-1} + B_0 gamma_k + B_1 gamma_{k-1} + B_2 gamma_{k-2} - (B_0 + B_1 + B_2) Gamma + noise,

whose coefficients `rabbit speed` finds. Each touchdown gives one Gamma. The estimate is the
median of the last REMEMBERED ones, of which the first is 0: what a push does to one or two of them is left out.

Second: what does the rate of the phase angle omega after the impact ask for? It is the state on the Poincare section,
and answers to the step's gait at once. With omega_d the periodic gait's,

    gamma_{k+1} = clip(Gamma + K_P (omega_d - omega)),    abs(gamma_{k+1} - gamma_k) <= MOST,

where clip is to the slopes that the library has gaits for.

`IntegralRegulation` is the rule without a model, to compare with. It takes for Gamma

    I_k = clip(I_{k-1} - K_I v_k).
"""

from collections import deque
from dataclasses import dataclass
from statistics import median

import numpy as np

RETAINED = 0.695  # A
PER_SLOPE = (-0.046, 0.148, -0.037)  # B_0, B_1, B_2, (m/s) / degree
REMEMBERED = 6
K_P, MOST = 1.5, 1.5  # degrees / (rad/s), degrees
INTEGRAL_K_P, INTEGRAL_MOST = 2.0, 3.0  # the same without the model
K_I = 2.0  # degrees / (m/s), once a step


@dataclass
class SpeedRegulation:
    """Between the slopes `least` and `most`, degrees; `slope` is the present step's."""

    least: float
    most: float

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Level ground, or the library's slope nearest to it."""
        self.slope = self._clip(0.0)
        self._slopes = deque([self.slope] * len(PER_SLOPE), maxlen=len(PER_SLOPE))  # of the last steps, latest first
        self._speed: float | None = None
        self._found = deque([0.0], maxlen=REMEMBERED)

    def after(self, rate_missing: float, speed_missing: float) -> float:
        """The slope, degrees, of the step after a touchdown that lacks `rate_missing` = omega_d - omega, rad/s, and
        ends a step that lacked `speed_missing`, m/s, the negative of v."""
        self._slopes.appendleft(self.slope)
        speed = -speed_missing
        if self._speed is not None:
            unexplained = RETAINED * self._speed + float(np.dot(PER_SLOPE, self._slopes)) - speed
            self._found.append(unexplained / sum(PER_SLOPE))
        self._speed = speed
        return self._towards(self._clip(median(self._found)) + K_P * rate_missing, MOST)

    def _towards(self, aim: float, most: float) -> float:
        self.slope = min(max(self._clip(aim), self.slope - most), self.slope + most)
        return self.slope

    def _clip(self, slope: float) -> float:
        return min(max(slope, self.least), self.most)


@dataclass
class IntegralRegulation(SpeedRegulation):
    """PI control: the slope on which the speed is kept is the integral of what the speed lacks."""

    def reset(self) -> None:
        """Level ground, or the library's slope nearest to it."""
        super().reset()
        self._integral = self.slope

    def after(self, rate_missing: float, speed_missing: float) -> float:
        """The slope, degrees, of the step after a touchdown with these."""
        self._integral = self._clip(self._integral + K_I * speed_missing)
        return self._towards(self._integral + INTEGRAL_K_P * rate_missing, INTEGRAL_MOST)

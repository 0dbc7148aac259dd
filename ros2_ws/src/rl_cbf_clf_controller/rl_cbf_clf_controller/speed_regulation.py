"""The slope that the next step is made for, chosen at each touchdown: PI control of the speed on the Poincaré section.

A robot that climbs, is held back by its joints, or carries a load behind its hip walks slower than its gait. Before it
knows why, it can take the next step from a gait for steeper ground: that leans the torso forward, and the robot falls
faster into its step. At touchdown k, with omega the rate of the phase angle after the impact, v the mean speed of the
step that ended, omega_d and v_d those of its periodic gait, and gamma the slope in degrees:

    I_k = clip(I_{k-1} + K_I (v_d - v)),
    gamma_k = clip(I_k + K_P (omega_d - omega)),    abs(gamma_k - gamma_{k-1}) <= MOST,

where clip is to the slopes that the library has gaits for. On ground of a slope at which the robot keeps its gait's
speed, gamma settles at that slope. The rate is the state on the Poincaré section: it answers to the step's gait at
once, where the mean speed lags by half a step. The speed decides where the rate settles: under a payload the impact
costs more, and a robot with its gait's rate after the impact would walk too fast.
"""

from dataclasses import dataclass

K_P = 2.0  # degrees / (rad/s)
K_I = 2.0  # degrees / (m/s), once a step
MOST = 3.0  # degrees


@dataclass
class SpeedRegulation:
    """Between the slopes `least` and `most`, degrees; `slope` is the present step's."""

    least: float
    most: float

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Level ground, or the library's slope nearest to it."""
        self.slope = self._integral = self._clip(0.0)

    def after(self, rate_missing: float, speed_missing: float) -> float:
        """The slope, degrees, of the step after a touchdown that lacks `rate_missing` = omega_d - omega, rad/s, and
        ends a step that lacked `speed_missing` = v_d - v, m/s."""
        self._integral = self._clip(self._integral + K_I * speed_missing)
        aim = self._clip(self._integral + K_P * rate_missing)
        self.slope = min(max(aim, self.slope - MOST), self.slope + MOST)
        return self.slope

    def _clip(self, slope: float) -> float:
        return min(max(slope, self.least), self.most)

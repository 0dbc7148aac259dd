"""Outputs y = q_act - q_desired(phase) and their derivatives, in stance/swing coordinates.

phase = (phase_angle - start) / (end - start),  phase_angle = pitch + stance hip + stance knee / 2 = c' q_s
y-ddot = J_y q-ddot + y_bias,  J_y = [0 I] - q_desired'(phase) c' / (end - start)
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from cbf_clf_qp.affine import Affine
from rabbit_description.state import Array

from rl_cbf_clf_controller.bezier import Bezier

PHASE_ANGLE = np.array([0.0, 0.0, 1.0, 1.0, 0.5, 0.0, 0.0])
ACTUATED = np.hstack([np.zeros((4, 3)), np.eye(4)])


@dataclass(frozen=True)
class Outputs:
    """`y`, `dy` (4,), `jacobian` (4, 7) and `bias` (4,) of y-ddot, `phase` and `phase_rate` (1/s)."""

    y: Array
    dy: Array
    jacobian: Array
    bias: Array
    phase: float
    phase_rate: float

    @cached_property
    def eta(self) -> Array:
        """(y, dy), shape (8,)."""
        return np.concatenate([self.y, self.dy])

    def second_derivative(self, acceleration: Affine) -> Affine:
        """y-ddot (4), affine in whatever `acceleration` (7) is affine in."""
        return acceleration.mapped(self.jacobian, self.bias)


class Path(Protocol):
    """Desired actuated joints over the phase, as a gait has them: `coeffs` (4, n), rad, and the phase angles, rad."""

    @property
    def coeffs(self) -> Array: ...

    @property
    def phase_angle_start(self) -> float: ...

    @property
    def phase_angle_end(self) -> float: ...


class VirtualConstraints:
    """The outputs of a gait, or of another path."""

    def __init__(self, path: Path) -> None:
        self._desired = Bezier(path.coeffs)
        self._start = path.phase_angle_start
        self._gradient = PHASE_ANGLE / (path.phase_angle_end - path.phase_angle_start)

    def evaluate(self, q_s: Array, dq_s: Array) -> Outputs:
        """Outputs at `q_s`, `dq_s` (7,), stance/swing order."""
        phase = float(self._gradient @ q_s) - self._start * float(self._gradient[2])
        phase_rate = float(self._gradient @ dq_s)
        desired, slope, curvature = self._desired(phase)
        return Outputs(
            y=q_s[3:] - desired,
            dy=dq_s[3:] - slope * phase_rate,
            jacobian=ACTUATED - np.outer(slope, self._gradient),
            bias=-curvature * phase_rate**2,
            phase=phase,
            phase_rate=phase_rate,
        )

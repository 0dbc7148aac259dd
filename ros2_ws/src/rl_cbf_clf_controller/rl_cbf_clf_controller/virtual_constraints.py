"""Outputs y = H q_s - desired(phase) and their derivatives, in stance/swing coordinates.

phase = (phase_angle - start) / (end - start),  phase_angle = c' q_s
y-ddot = J_y q-ddot + y_bias,  J_y = H - desired'(phase) c' / (end - start)

H q_s are m controlled angles, linear in the coordinates. RABBIT's are its four joints, and its phase angle is
pitch + stance hip + stance knee / 2.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from cbf_clf_qp.affine import Affine
from rabbit_description.state import Array

from rl_cbf_clf_controller.bezier import FADING, Bezier


@dataclass(frozen=True)
class Angles:
    """What is controlled and what stands for time: H = `controlled` (m, n), c = `phase_angle` (n,)."""

    controlled: Array
    phase_angle: Array

    def coordinates(self, controlled: Array, phase_angle: float) -> Array:
        """Pitch and joints (n - 2,) at these angles, or their rates at these rates; needs m = n - 3."""
        matrix = np.vstack([self.controlled, self.phase_angle])[:, 2:]
        return np.linalg.solve(matrix, np.append(controlled, phase_angle))


RABBIT_ANGLES = Angles(np.eye(7)[3:], np.array([0.0, 0.0, 1.0, 1.0, 0.5, 0.0, 0.0]))


@dataclass(frozen=True)
class Outputs:
    """`eta` = (y, dy) (2 m,), `jacobian` (m, n) and `bias` (m,) of y-ddot, `phase` and `phase_rate` (1/s)."""

    eta: Array
    jacobian: Array
    bias: Array
    phase: float
    phase_rate: float

    @property
    def y(self) -> Array:
        """The outputs (m,), rad."""
        return self.eta[: len(self.bias)]

    @property
    def dy(self) -> Array:
        """Their rates (m,), rad/s."""
        return self.eta[len(self.bias) :]

    def second_derivative(self, acceleration: Affine) -> Affine:
        """y-ddot (m), affine in whatever `acceleration` (n) is affine in."""
        return acceleration.mapped(self.jacobian, self.bias)


class Path(Protocol):
    """Desired controlled angles over the phase, as a gait has them: `coeffs` (m, k), rad, and the phase angles, rad."""

    @property
    def coeffs(self) -> Array: ...

    @property
    def phase_angle_start(self) -> float: ...

    @property
    def phase_angle_end(self) -> float: ...


@dataclass(frozen=True)
class KnownPath:
    """A path at a state at which the outputs have been computed."""

    outputs: Outputs

    def at(self, q_s: Array, dq_s: Array) -> Outputs:
        """At that state."""
        return self.outputs


class VirtualConstraints:
    """The outputs of a gait, or of another path."""

    def __init__(self, path: Path, angles: Angles = RABBIT_ANGLES) -> None:
        self._desired = Bezier(path.coeffs)
        self.controlled = angles.controlled
        per_angle = 1.0 / (path.phase_angle_end - path.phase_angle_start)
        self._start = path.phase_angle_start * per_angle
        self._gradient = angles.phase_angle / (path.phase_angle_end - path.phase_angle_start)

    def parameters(self) -> dict[str, Array]:
        """What the generated code needs to know of them, as in `generated.layout.PATH`."""
        return {
            "gradient": self._gradient,
            "phase_start": np.array(self._start),
            "powers": self._desired.powers,
            "fading": np.array(FADING),
            "correction_width": np.ones(1),
        }

    def evaluate(self, q_s: Array, dq_s: Array) -> Outputs:
        """Outputs at `q_s`, `dq_s` (n,), stance/swing order."""
        phase = float(self._gradient @ q_s) - self._start
        phase_rate = float(self._gradient @ dq_s)
        desired, slope, curvature = self._desired(phase)
        return Outputs(
            eta=np.concatenate([self.controlled @ q_s - desired, self.controlled @ dq_s - slope * phase_rate]),
            jacobian=self.controlled - np.outer(slope, self._gradient),
            bias=-curvature * phase_rate**2,
            phase=phase,
            phase_rate=phase_rate,
        )

    def path_at(self, q_s: Array, dq_s: Array) -> KnownPath:
        """The outputs at a state, for a trace."""
        return KnownPath(self.evaluate(q_s, dq_s))

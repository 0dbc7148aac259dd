"""A walk with outputs identically zero, by pinocchio: independent of the optimisation that found it.

With y = 0 the state follows from (phase, phase rate), and with sigma = phase_rate^2 / 2 one step obeys

    d sigma / d phase = a(phase) + b(phase) sigma,

linear in sigma because the phase's acceleration is quadratic in its rate: hence sigma(phase) = Phi sigma(0) + W.
The model may carry a payload: then this is the zero dynamics under perfect knowledge of it.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from rabbit_description.gait import Gait
from rabbit_description.state import Array
from rl_cbf_clf_controller.bezier import Bezier
from rl_cbf_clf_controller.nominal_model import NominalModel
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints
from scipy.integrate import solve_ivp

TORSO_COM_HEIGHT = 0.24  # m above the hip


def loaded_model(payload: float = 0.0, height: float = TORSO_COM_HEIGHT) -> NominalModel:
    """The nominal model with a point mass of `payload` kg on the torso, `height` m above the hip.

    Raises:
        ValueError: the payload is negative or not finite.
    """
    if not (np.isfinite(payload) and payload >= 0):
        raise ValueError(f"payload = {payload} kg: expected a finite mass, 0 or more")
    model = NominalModel()
    torso = model.model.getJointId("base_pitch")
    model.model.inertias[torso] += pin.Inertia(payload, np.array([0.0, 0.0, height]), np.zeros((3, 3)))
    model.data = model.model.createData()
    return model


@dataclass(frozen=True)
class Instant:
    """One instant on the zero dynamics: state and acceleration (7,), torque (4,), stance-foot force (2,); the swing
    foot's position, velocity and acceleration (2,) from the stance foot; the phase's acceleration, 1/s^2."""

    q: Array
    dq: Array
    ddq: Array
    torque: Array
    force: Array
    swing: Array
    swing_rate: Array
    swing_acceleration: Array
    phase_acceleration: float


class ZeroDynamics:
    """The zero dynamics of `gait` on `model`."""

    def __init__(self, gait: Gait, model: NominalModel | None = None) -> None:
        self.gait = gait
        self.model = model or NominalModel()
        self._constraints = VirtualConstraints(gait)
        self._desired = Bezier(gait.coeffs)
        self._span = gait.phase_angle_end - gait.phase_angle_start

    def state(self, phase: float, phase_rate: float) -> tuple[Array, Array]:
        """`(q, dq)`, each (7,), stance/swing order, with y = y-dot = 0 and the stance foot at rest at the origin."""
        joints, slope, _ = self._desired(phase)
        angle = self.gait.phase_angle_start + phase * self._span
        q = np.concatenate([[0.0, 0.0, angle - joints[0] - joints[1] / 2], joints])
        dq = phase_rate * np.concatenate([[0.0, 0.0, self._span - slope[0] - slope[1] / 2], slope])
        feet = self.model.update(q, dq)  # with the hip held, the foot moves by minus the hip's true motion
        q[:2], dq[:2] = feet.hip, feet.hip_rate
        return q, dq

    def at(self, phase: float, phase_rate: float) -> Instant:
        """Motion, torque and force at a point of the zero dynamics."""
        q, dq = self.state(phase, phase_rate)
        feet = self.model.update(q, dq)
        pinned = self.model.pinned()
        outputs = self._constraints.evaluate(q, dq)
        y_ddot = outputs.second_derivative(pinned.acceleration)
        torque = y_ddot.inverse()(np.zeros(4))
        ddq = pinned.acceleration(torque)
        return Instant(
            q, dq, ddq, torque, pinned.force(torque), feet.swing, feet.swing_rate,
            feet.swing_jacobian @ ddq + feet.swing_bias, float((ddq[2] + ddq[3] + ddq[4] / 2) / self._span),
        )  # fmt: skip

    def transition(self, phases: Array) -> tuple[Array, Array]:
        """Phi and W at increasing `phases` (n,) from the first: sigma(phase) = Phi sigma(first) + W, each (n,)."""

        def slope(phase: float, values: Array) -> Array:
            at_rest = self.at(phase, 0.0).phase_acceleration
            per_sigma = self.at(phase, np.sqrt(2.0)).phase_acceleration - at_rest
            return np.array([per_sigma * values[0], per_sigma * values[1] + at_rest])

        span = (float(phases[0]), float(phases[-1]))
        solution = solve_ivp(slope, span, [1.0, 0.0], "DOP853", phases, rtol=1e-9, atol=1e-11)
        return solution.y[0], solution.y[1]

    def phase_rates(self, phases: Array, first_rate: float) -> Array:
        """Phase rate at `phases` (n,) of a step begun at `first_rate`, 1/s; nan from where the step has stopped."""
        phi, offset = self.transition(phases)
        sigma = phi * first_rate**2 / 2 + offset
        stopped = np.maximum.accumulate(sigma <= 0)
        return np.where(stopped, np.nan, np.sqrt(2 * np.maximum(sigma, 0.0)))

    def least_phase_rate(self, points: int = 201) -> float:
        """Least post-impact phase rate, 1/s, that completes a step; slower, the robot falls back."""
        phi, offset = self.transition(np.linspace(0.0, 1.0, points))
        return float(np.sqrt(2 * max(0.0, float(np.max(-offset / phi)))))

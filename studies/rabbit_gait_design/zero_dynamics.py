"""A walk with outputs identically zero, by pinocchio: independent of the optimisation that found it.

With y = 0 the state follows from (phase, phase rate), and with sigma = phase_rate^2 / 2 one step obeys

    d sigma / d phase = a(phase) + b(phase) sigma,

linear in sigma because the phase's acceleration is quadratic in its rate: hence sigma(phase) = Phi sigma(0) + W.
"""

from dataclasses import dataclass

import numpy as np
from cbf_clf_qp.functions import NumpyFunction
from rabbit_description.gait import Gait
from rabbit_description.state import Array
from rl_cbf_clf_controller.virtual_constraints import RABBIT_ANGLES, Angles, StepPath
from scipy.integrate import solve_ivp

from rabbit_gait_design.path_outputs import VirtualConstraints
from rabbit_gait_design.pinocchio_model import PinocchioModel


def nominal_model(slope: float = 0.0) -> PinocchioModel:
    """The nominal model; x runs along ground that rises by `slope` degrees: gravity is turned against it."""
    model = PinocchioModel()
    down, turn = model.model.gravity.linear[2], np.radians(slope)
    model.model.gravity.linear = down * np.array([np.sin(turn), 0.0, np.cos(turn)])
    return model


@dataclass(frozen=True)
class Instant:
    """One instant on the zero dynamics: state and acceleration (n,), torque (m,), stance-foot force (2,); the swing
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
    """The zero dynamics of `gait` on `model`, whose outputs and phase are `angles`; RABBIT's unless said."""

    def __init__(
        self,
        gait: StepPath | Gait,
        model: PinocchioModel | None = None,
        angles: Angles = RABBIT_ANGLES,
        functions: tuple[NumpyFunction, ...] | None = None,
    ) -> None:
        self.gait, self.angles = gait, angles
        self.model = model or PinocchioModel()
        self.constraints = VirtualConstraints(gait, angles, functions)
        self._span = gait.phase_angle_end - gait.phase_angle_start

    def state(self, phase: float, phase_rate: float) -> tuple[Array, Array]:
        """`(q, dq)`, each (n,), stance/swing order, with y = y-dot = 0 and the stance foot at rest at the origin."""
        desired, slope, _ = self.constraints.desired(phase)
        angle = self.gait.phase_angle_start + phase * self._span
        q = np.concatenate([np.zeros(2), self.angles.coordinates(desired, angle)])
        dq = phase_rate * np.concatenate([np.zeros(2), self.angles.coordinates(slope, self._span)])
        feet = self.model.update(q, dq)  # with the hip held, the foot moves by minus the hip's true motion
        q[:2], dq[:2] = feet.hip, feet.hip_rate
        return q, dq

    def at(self, phase: float, phase_rate: float) -> Instant:
        """Motion, torque and force at a point of the zero dynamics."""
        q, dq = self.state(phase, phase_rate)
        feet = self.model.update(q, dq)
        pinned = self.model.pinned()
        outputs = self.constraints.evaluate(q, dq)
        y_ddot = outputs.second_derivative(pinned.acceleration)
        torque = np.linalg.solve(y_ddot.a, -y_ddot.b)
        ddq = pinned.acceleration(torque)
        return Instant(
            q, dq, ddq, torque, pinned.force(torque), feet.swing, feet.swing_rate,
            feet.swing_jacobian @ ddq + feet.swing_bias, float(self.angles.phase_angle @ ddq / self._span),
        )  # fmt: skip

    def transition(self, phases: Array, tolerance: float = 1e-9) -> tuple[Array, Array]:
        """Phi and W at increasing `phases` (n,) from the first: sigma(phase) = Phi sigma(first) + W, each (n,).

        Raises:
            ArithmeticError: the path has no motion: at some phase no torque makes y'' = 0 or the phase does not move.
        """

        def slope(phase: float, values: Array) -> Array:
            at_rest = self.at(phase, 0.0).phase_acceleration
            per_sigma = self.at(phase, np.sqrt(2.0)).phase_acceleration - at_rest
            return np.array([per_sigma * values[0], per_sigma * values[1] + at_rest])

        span = (float(phases[0]), float(phases[-1]))
        solution = solve_ivp(slope, span, [1.0, 0.0], "DOP853", phases, rtol=tolerance, atol=tolerance / 100)
        if not solution.success:
            raise ArithmeticError(f"no motion along the path beyond the phase {solution.t[-1]:.3f}: {solution.message}")
        return solution.y[0], solution.y[1]

    def phase_rates(self, phases: Array, first_rate: float) -> Array:
        """Phase rate at `phases` (n,) of a step begun at `first_rate`, 1/s; nan from where the step has stopped."""
        phi, offset = self.transition(phases)
        sigma = phi * first_rate**2 / 2 + offset
        stopped = np.maximum.accumulate(sigma <= 0)
        return np.where(stopped, np.nan, np.sqrt(2 * np.maximum(sigma, 0.0)))

    def least_phase_rate(self) -> float:
        """Least post-impact phase rate, 1/s, that completes a step; slower, the robot falls back."""
        phi, offset = self.transition(np.linspace(0.0, 1.0, 201))
        return float(np.sqrt(2 * max(0.0, float(np.max(-offset / phi)))))

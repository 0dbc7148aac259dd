"""Does a gait keep a fixed point when the torso carries a payload and the controller knows it perfectly?

Definition. The plant is the pinned-foot model with the payload; the controller is exact input-output linearisation on
that same model, y'' = -kp / eps^2 y - kd / eps y', in continuous time, without torque limit, stones or noise. One step
runs until the swing foot comes down; impact and relabelling give the next start: the Poincaré map on post-impact
states. At the nominal mass the impact maps the zero-dynamics manifold into itself. Under a payload it does not, since
post-impact velocities depend on the mass: outputs leave zero at each impact and return within the step. So the fixed
point is one of this whole map, found by walking, and its eigenvalue that of the map's Jacobian, not of a scalar map.
The least phase rate is the manifold's own (`ZeroDynamics.least_phase_rate`): slower post-impact starts fall backwards.
"""

from dataclasses import dataclass

import numpy as np
from rabbit_description.gait import Gait
from rabbit_description.state import SWAP_STATE, Array
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints
from scipy.integrate import solve_ivp

LONGEST_STEP = 3.0  # s
HIP_FALL = 0.5  # m
SHAPE = slice(2, 7)  # pitch and joints: the pinned robot's own coordinates


@dataclass(frozen=True)
class Step:
    """One step: the next post-impact state `q`, `dq` (7,); duration, s; torque (n, 4) and stance force (n, 2)."""

    q: Array
    dq: Array
    duration: float
    torque: Array
    force: Array


class OracleWalk:
    """The Poincaré map of `gait` on `model` under exact input-output linearisation of that model."""

    def __init__(self, gait: Gait, model: PinocchioModel, eps: float = 0.05, kp: float = 0.5, kd: float = 3**0.5 / 2):
        self.model = model
        self._constraints = VirtualConstraints(gait)
        self._gains = kp / eps**2, kd / eps

    def control(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Acceleration (7,), torque (4,) and stance-foot force (2,) at a state, stance/swing order."""
        self.model.update(q, dq)
        pinned = self.model.pinned()
        outputs = self._constraints.evaluate(q, dq)
        wanted = -self._gains[0] * outputs.y - self._gains[1] * outputs.dy
        y_ddot = outputs.second_derivative(pinned.acceleration)
        torque = np.linalg.solve(y_ddot.a, wanted - y_ddot.b)
        return pinned.acceleration(torque), torque, pinned.force(torque)

    def step(self, q: Array, dq: Array) -> Step | None:
        """Walk one step from a post-impact state; None if the swing foot never lands ahead."""

        def motion(_: float, x: Array) -> Array:
            return np.concatenate([x[7:], self.control(x[:7], x[7:])[0]])

        start = np.concatenate([q, dq])
        events = [self._landing, self._turning_back, _falling]
        solution = solve_ivp(motion, (0.0, LONGEST_STEP), start, "RK45", events=events, rtol=1e-8, atol=1e-9)
        if not len(solution.t_events[0]):
            return None
        x = solution.y_events[0][0]
        path = [self.control(state[:7], state[7:]) for state in solution.y.T]
        after, _ = self.model.impact(x[:7], x[7:])
        landed = x[:7].copy()
        landed[:2] -= self.model.update(x[:7], x[7:]).swing
        torque, force = (np.array([point[i] for point in path]) for i in (1, 2))
        return Step(landed[SWAP_STATE], after[SWAP_STATE], float(solution.t[-1]), torque, force)

    def phase_rate(self, q: Array, dq: Array) -> float:
        """Rate of the phase, 1/s."""
        return self._constraints.evaluate(q, dq).phase_rate

    def _landing(self, _: float, x: Array) -> float:
        if self._constraints.evaluate(x[:7], x[7:]).phase < 0.5:
            return 1.0
        return float(self.model.update(x[:7], x[7:]).swing[1])

    def _turning_back(self, _: float, x: Array) -> float:
        return self.phase_rate(x[:7], x[7:])

    _landing.terminal, _landing.direction = True, -1  # type: ignore[attr-defined]
    _turning_back.terminal = True  # type: ignore[attr-defined]


def _falling(_: float, x: Array) -> float:
    return float(x[1] - HIP_FALL)


_falling.terminal = True  # type: ignore[attr-defined]


def fixed_point(walk: OracleWalk, q: Array, dq: Array, steps: int = 150, tolerance: float = 1e-7) -> Step | None:
    """Walk until two post-impact states agree; None if the robot stops or falls before.

    Steps from a start that is too slow fail although a fixed point exists: give a fast one.
    """
    for _ in range(steps):
        taken = walk.step(q, dq)
        if taken is None:
            return None
        change = max(np.abs(taken.q - q)[SHAPE].max(), np.abs(taken.dq - dq).max())
        q, dq = taken.q, taken.dq
        if change < tolerance:
            return taken
    return None


def poincare_eigenvalue(walk: OracleWalk, q: Array, dq: Array, h: float = 1e-5) -> float:
    """Largest modulus of the Poincaré map's eigenvalues at a fixed point, by central differences in 10 directions."""

    def image(perturbation: Array) -> Array:
        start_q, start_dq = q.copy(), dq.copy()
        start_q[SHAPE] += perturbation[:5]
        start_dq[SHAPE] += perturbation[5:]
        start_q, start_dq = pinned_state(walk.model, start_q, start_dq)
        taken = walk.step(start_q, start_dq)
        if taken is None:
            raise ArithmeticError(f"a start {h} from the fixed point does not complete a step")
        return np.concatenate([taken.q[SHAPE], taken.dq[SHAPE]])

    columns = [(image(h * e) - image(-h * e)) / (2 * h) for e in np.eye(10)]
    return float(np.abs(np.linalg.eigvals(np.column_stack(columns))).max())


def pinned_state(model: PinocchioModel, q: Array, dq: Array) -> tuple[Array, Array]:
    """The same pitch and joints with the stance foot at rest at the origin."""
    q, dq = np.concatenate([[0.0, 0.0], q[SHAPE]]), np.concatenate([[0.0, 0.0], dq[SHAPE]])
    feet = model.update(q, dq)
    q[:2], dq[:2] = feet.hip, feet.hip_rate
    return q, dq

"""The gait as a nonlinear programme.

    minimise    (1 / step length) integral u'u dt
    over        Bézier coefficients, phase range, and at each Hermite-Simpson point: sigma, w, u, F; the impulse
    subject to  equation of motion at every point, d sigma / d s = w by Hermite-Simpson,
                impact and leg relabelling lead back to the start, step length and time,
                torque, friction, normal force, foot path, both barrier inequalities.

`orbit_point` says why the phase, not time, is the independent variable: outputs are zero exactly, everywhere.
"""

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from rl_cbf_clf_controller.gait_design import orbit_point, symbolic_robot
from rl_cbf_clf_controller.gait_design.guess import initial_guess
from rl_cbf_clf_controller.gait_design.orbit_point import DEGREE, SWAP
from rl_cbf_clf_controller.gait_design.specification import GaitSpecification

UNBOUNDED = np.inf


@dataclass
class Rows:
    """Constraint rows lower <= value <= upper, each group under a name for the error message."""

    values: list[ca.SX] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def add(self, name: str, value: ca.SX, lower: float = 0.0, upper: float = UNBOUNDED) -> None:
        """Append `lower <= value <= upper`, element by element."""
        size = ca.SX(value).numel()
        self.values.append(ca.vec(value))
        self.lower += [lower] * size
        self.upper += [upper] * size
        self.names += [name] * size

    def equal(self, name: str, value: ca.SX) -> None:
        """Append `value = 0`."""
        self.add(name, value, 0.0, 0.0)


class Transcription:
    """Variables, rows and cost of one `GaitSpecification`; `solver_arguments` is what IPOPT is given."""

    def __init__(self, specification: GaitSpecification) -> None:
        self.specification = specification
        self.points = 2 * specification.intervals + 1
        self.s = np.linspace(0.0, 1.0, self.points)
        self.coeffs = ca.SX.sym("coeffs", 4, DEGREE + 1)
        self.phase_range = ca.SX.sym("phase_range", 2)
        self.sigma = ca.SX.sym("sigma", self.points)
        self.w = ca.SX.sym("w", self.points)
        self.u = ca.SX.sym("u", 4, self.points)
        self.force = ca.SX.sym("force", 2, self.points)
        self.impulse = ca.SX.sym("impulse", 2)
        self.rows = Rows()
        self._add_points()
        self._add_collocation()
        self._add_closure()
        self._add_step()

    @property
    def variables(self) -> ca.SX:
        """All variables in one column."""
        blocks = [self.coeffs, self.phase_range, self.sigma, self.w, self.u, self.force, self.impulse]
        return ca.vertcat(*(ca.vec(block) for block in blocks))

    @property
    def durations(self) -> ca.SX:
        """Simpson weight of each point times ds / s', so that their sum is the step time, s."""
        weights = np.ones(self.points)
        weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
        return weights / (3 * (self.points - 1)) / ca.sqrt(2 * self.sigma)

    @property
    def cost(self) -> ca.SX:
        """Integral of u'u dt over step length, (N m)^2 s / m."""
        return ca.sum1(self.durations * ca.sum1(self.u**2).T) / self.specification.step_length

    def nlp(self) -> dict[str, ca.SX]:
        """CasADi's description of the programme."""
        return {"x": self.variables, "f": self.cost, "g": ca.vertcat(*self.rows.values)}

    def bounds(self) -> dict[str, np.ndarray]:
        """Simple bounds, row bounds and the initial guess."""
        n, limit = self.points, self.specification.torque_limit
        lower = [np.full(26, -UNBOUNDED), np.full(n, 1e-3), np.full(n, -UNBOUNDED), np.full(4 * n, -limit)]
        upper = [np.full(26, UNBOUNDED), np.full(2 * n, UNBOUNDED), np.full(4 * n, limit)]
        lower.append(np.full(2 * n + 2, -UNBOUNDED))
        upper.append(np.full(2 * n + 2, UNBOUNDED))
        return {
            "x0": self.pack_guess(),
            "lbx": np.concatenate(lower),
            "ubx": np.concatenate(upper),
            "lbg": np.array(self.rows.lower),
            "ubg": np.array(self.rows.upper),
        }

    def pack_guess(self) -> np.ndarray:
        """A walk with a straight hip path, upright torso, and support by weight alone."""
        coeffs, phase_range = initial_guess(self.specification)
        rate = 1.0 / self.specification.step_time
        force = np.tile([0.0, 32.0 * symbolic_robot.GRAVITY], self.points)
        tail = [np.full(self.points, rate**2 / 2), np.zeros(self.points), np.zeros(4 * self.points), force, [0.0, 10.0]]
        return np.concatenate([coeffs.flatten(order="F"), phase_range, *tail])

    def unpack(self, x: ca.DM) -> dict[str, np.ndarray]:
        """Coefficients (4, 6), phase range (2,), sigma (points,) of a solution."""
        x = np.asarray(x).ravel()
        return {
            "coeffs": x[:24].reshape(4, DEGREE + 1, order="F"),
            "phase_range": x[24:26],
            "sigma": x[26 : 26 + self.points],
        }

    def _add_points(self) -> None:
        spec, path = self.specification, (self.coeffs, self.phase_range)
        conditions = orbit_point.barrier_conditions(
            spec.step_length - spec.near_edge, spec.step_length + spec.far_edge, spec.R1, spec.R2, spec.barrier_poles
        )
        for i, s in enumerate(self.s):
            motion = (*path, s, self.sigma[i], self.w[i])
            force = self.force[:, i]
            self.rows.equal("equation of motion", orbit_point.dynamics_residual()(*motion, self.u[:, i], force))
            self.rows.add("normal force", force[1], spec.min_normal_force)
            self.rows.add("friction", spec.friction_limit * force[1] - force[0])
            self.rows.add("friction", spec.friction_limit * force[1] + force[0])
            q, _, _ = orbit_point.path()(*path, s)
            self.rows.add("pitch range", q[2], *spec.pitch_range)
            self.rows.add("knee range", q[[4, 6]], *spec.knee_range)
            foot, velocity, acceleration = orbit_point.swing_foot()(*motion)
            if 0 < i < self.points - 1:
                self.rows.add("foot height", foot[1], spec.clearance * 4 * s * (1 - s), spec.max_foot_height)
            if spec.barriers:
                self.rows.add("barriers", conditions(foot, velocity, acceleration), spec.barrier_margin)

    def _add_collocation(self) -> None:
        h = 1.0 / self.specification.intervals
        first, middle, last = slice(0, -2, 2), slice(1, None, 2), slice(2, None, 2)
        sigma, w = self.sigma, self.w
        hermite = sigma[middle] - (sigma[first] + sigma[last]) / 2 - h / 8 * (w[first] - w[last])
        simpson = sigma[last] - sigma[first] - h / 6 * (w[first] + 4 * w[middle] + w[last])
        self.rows.equal("collocation", ca.vertcat(hermite, simpson))

    def _add_closure(self) -> None:
        """Impact: M (dq+ - dq-) = J_swing' impulse with dq+ the relabelled start, so the orbit closes."""
        spec, path = self.specification, (self.coeffs, self.phase_range)
        q_0, tangent_0, _ = orbit_point.path()(*path, 0.0)
        q_1, tangent_1, _ = orbit_point.path()(*path, 1.0)
        before, after = tangent_1 * ca.sqrt(2 * self.sigma[-1]), (tangent_0 * ca.sqrt(2 * self.sigma[0]))[SWAP]
        feet = symbolic_robot.foot_motion()(q=q_1, dq=after, ddq=0)
        mass_matrix, _ = symbolic_robot.dynamics()
        jump = mass_matrix(q_1) @ (after - before) - feet["J_swing"].T @ self.impulse
        self.rows.equal("leg relabelling", q_0[2:] - q_1[SWAP][2:])
        self.rows.equal("impact map", jump)
        self.rows.add("impulse friction", 0.8 * self.impulse[1] - self.impulse[0])
        self.rows.add("impulse friction", 0.8 * self.impulse[1] + self.impulse[0])
        self.rows.add("lift-off", feet["v_stance"][1], spec.lift_speed)

    def _add_step(self) -> None:
        spec = self.specification
        foot, velocity, _ = orbit_point.swing_foot()(self.coeffs, self.phase_range, 1.0, self.sigma[-1], self.w[-1])
        self.rows.equal("step length", foot - ca.vertcat(spec.step_length, 0))
        self.rows.add("landing speed", -velocity[1], spec.landing_speed, spec.max_landing_speed)
        self.rows.add("landing slide", velocity[0], -spec.max_landing_slide, spec.max_landing_slide)
        self.rows.equal("step time", ca.sum1(self.durations) - spec.step_time)

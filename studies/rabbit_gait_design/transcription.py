"""The gait as a nonlinear programme.

    minimise    (1 / step length) integral u'u dt
    over        Bézier coefficients and phase range: the path q(s);
                sigma, w, u, F at Hermite-Simpson points, the impact
    subject to  equation of motion at every point, d sigma / d s = w by Hermite-Simpson,
                impact and leg relabelling lead back to the start, step length and time,
                torque, friction, normal force, foot path, both barrier inequalities.

`orbit_point` says why the phase, not time, is the independent variable: outputs are zero exactly, everywhere.
"""

from dataclasses import astuple, dataclass, field, replace

import casadi as ca
import numpy as np
from rabbit_description.gait import Gait
from rabbit_description.state import ROBOT_MASS, Array

from rabbit_gait_design import orbit_point, symbolic_robot
from rabbit_gait_design.guess import initial_guess
from rabbit_gait_design.orbit_point import DEGREE, SWAP
from rabbit_gait_design.specification import GaitSpecification

IMPULSE_FRICTION = 0.8
UNBOUNDED_STONE = 1.0  # m, a far edge out of reach
UNBOUNDED = np.inf
LEAST_SIGMA = 1e-3  # 1/s^2; the phase never stops
PATH_SIZE = 4 * (DEGREE + 1) + 2  # coefficients and phase range


@dataclass
class ConstraintRows:
    """Rows lower <= value <= upper in the order they were added, each under a name for error messages."""

    values: list[ca.SX] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def add(self, name: str, value: ca.SX, lower: float = 0.0, upper: float = UNBOUNDED) -> None:
        """Append `lower <= value <= upper`, element by element."""
        size = value.numel()
        self.values.append(ca.vec(value))
        self.lower += [lower] * size
        self.upper += [upper] * size
        self.names += [name] * size

    def equal(self, name: str, value: ca.SX) -> None:
        """Append `value = 0`."""
        self.add(name, value, 0.0, 0.0)

    def broken(self, rows: Array, tolerance: float = 1e-6) -> dict[str, float]:
        """Largest violation above `tolerance` of each name at the rows' values (n,), worst first."""
        excess = np.maximum(np.array(self.lower) - rows, rows - np.array(self.upper))
        worst: dict[str, float] = {}
        for name, value in zip(self.names, excess, strict=True):
            if not value <= tolerance:
                worst[name] = max(worst.get(name, 0.0), float(value))
        return dict(sorted(worst.items(), key=lambda item: -item[1]))


class Transcription:
    """Variables, rows and cost of one `GaitSpecification`, as CasADi's `nlpsol` takes them.

    The search begins with the path of `guess`, where there is one.
    """

    def __init__(self, specification: GaitSpecification, guess: Gait | None = None) -> None:
        self.specification, self._guess, self.rows = specification, guess, ConstraintRows()
        self.points = n = 2 * specification.intervals + 1
        self.s = np.linspace(0.0, 1.0, n)
        self.path = (ca.SX.sym("coeffs", 4, DEGREE + 1), ca.SX.sym("phase_range", 2))
        self.sigma, self.w, self.u = ca.SX.sym("sigma", n), ca.SX.sym("w", n), ca.SX.sym("u", 4, n)
        self.force, self.impulse, self.after = ca.SX.sym("force", 2, n), ca.SX.sym("impulse", 2), ca.SX.sym("dq+", 7)
        self._add_motion()
        self._add_impact()
        self._add_path()
        self._add_walk()

    @property
    def durations(self) -> ca.SX:
        """Simpson weight of each point times ds / s', so that their sum is the step time, s."""
        weights = np.ones(self.points)
        weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
        return ca.SX(weights / (3 * (self.points - 1))) / ca.sqrt(2 * self.sigma)

    @property
    def cost(self) -> ca.SX:
        """Integral of u'u dt over step length, (N m)^2 s / m."""
        return ca.sum1(self.durations * ca.sum1(self.u**2).T) / self.specification.step_length

    def nlp(self) -> dict[str, ca.SX]:
        """CasADi's description of the programme."""
        blocks = [*self.path, self.sigma, self.w, self.u, self.force, self.impulse, self.after]
        x = ca.vertcat(*(ca.vec(block) for block in blocks))
        return {"x": x, "f": self.cost, "g": ca.vertcat(*self.rows.values)}

    def bounds(self) -> dict[str, Array]:
        """Initial guess (constant phase rate, no torque, support by weight alone), bounds of variables and rows."""
        spec, n = self.specification, self.points
        if guess := self._guess:
            coeffs, phase_range = guess.coeffs, np.array([guess.phase_angle_start, guess.phase_angle_end])
        else:
            coeffs, phase_range = initial_guess(spec)
        motion = [np.full(n, (1 / spec.step_time) ** 2 / 2), np.zeros(5 * n)]
        support = [np.tile([0.0, ROBOT_MASS * symbolic_robot.GRAVITY], n), np.array([0.0, 10.0]), np.zeros(7)]
        upper = np.full(PATH_SIZE + 8 * n + 9, UNBOUNDED)
        upper[PATH_SIZE + 2 * n : PATH_SIZE + 6 * n] = spec.torque_limit
        lower = -upper
        lower[PATH_SIZE : PATH_SIZE + n] = LEAST_SIGMA
        return {
            "x0": np.concatenate([coeffs.flatten(order="F"), phase_range, *motion, *support]),
            "lbx": lower,
            "ubx": upper,
            "lbg": np.array(self.rows.lower),
            "ubg": np.array(self.rows.upper),
        }

    @staticmethod
    def unpack(x: Array) -> tuple[Array, Array, float]:
        """Coefficients (4, 6), phase range (2,) and post-impact phase rate, 1/s, of a solution."""
        return x[:24].reshape(4, DEGREE + 1, order="F"), x[24:26], float(np.sqrt(2 * x[PATH_SIZE]))

    def _at(self, s: float) -> tuple[ca.SX, ca.SX]:
        """q and q_s at `s`."""
        q, q_s, _ = orbit_point.path()(*self.path, s)
        return q, q_s

    def _add_motion(self) -> None:
        """Equation of motion and collocation."""
        residual = orbit_point.dynamics_residual(self.specification.slope)
        for i, s in enumerate(self.s):
            rows = residual(*self.path, s, self.sigma[i], self.w[i], self.u[:, i], self.force[:, i])
            self.rows.equal("equation of motion", rows)
        first, middle, last = slice(0, -2, 2), slice(1, None, 2), slice(2, None, 2)
        sigma, w, h = self.sigma, self.w, 1.0 / self.specification.intervals
        hermite = sigma[middle] - (sigma[first] + sigma[last]) / 2 - h / 8 * (w[first] - w[last])
        simpson = sigma[last] - sigma[first] - h / 6 * (w[first] + 4 * w[middle] + w[last])
        self.rows.equal("collocation", ca.vertcat(hermite, simpson))

    def _add_impact(self) -> None:
        """M (dq+ - dq-) = J_swing' impulse, the landed foot at rest; relabelled, its phase rate is the first one."""
        q, q_s = self._at(1.0)
        before = q_s * ca.sqrt(2 * self.sigma[-1])
        feet = symbolic_robot.foot_motion()(q=q, dq=self.after, ddq=0)
        mass_matrix, _ = symbolic_robot.dynamics()
        self.rows.equal("impact map", mass_matrix(q) @ (self.after - before) - feet["J_swing"].T @ self.impulse)
        self.rows.equal("impact map", feet["v_swing"])
        span = self.path[1][1] - self.path[1][0]
        rate = (self.after[2] + self.after[5] + self.after[6] / 2) / span
        self.rows.equal("orbit closure", rate - ca.sqrt(2 * self.sigma[0]))
        for sign in (-1, 1):
            self.rows.add("impulse friction", IMPULSE_FRICTION * self.impulse[1] + sign * self.impulse[0])

    def _add_path(self) -> None:
        """Leg relabelling, step length, joint ranges and foot height: geometry of the path alone."""
        spec, (first, _), (last, _) = self.specification, self._at(0.0), self._at(1.0)
        self.rows.equal("leg relabelling", first[2:] - last[SWAP][2:])
        foot = symbolic_robot.feet()(last)[1]
        self.rows.equal("step length", foot - ca.vertcat(spec.step_length, 0))
        for s in self.s:
            q, _ = self._at(s)
            self.rows.add("pitch range", q[2], *spec.pitch_range)
            self.rows.add("knee range", q[[4, 6]], *spec.knee_range)
            if 0 < s < 1:
                height = symbolic_robot.feet()(q)[1][1]
                self.rows.add("foot height", height, spec.clearance * 4 * s * (1 - s), spec.max_foot_height)

    def _add_walk(self) -> None:
        """Closure, step time, forces, landing, barriers."""
        spec, (_, tangent) = self.specification, self._at(0.0)
        start = (tangent * ca.sqrt(2 * self.sigma[0]))[SWAP]
        self.rows.equal("orbit closure", (start - self.after)[2:6])
        self.rows.equal("step time", ca.sum1(self.durations) - spec.step_time)
        tangential, upward = self.force[0, :], self.force[1, :]
        self.rows.add("normal force", upward, spec.min_normal_force)
        self.rows.add("friction", spec.friction_limit * upward - tangential)
        self.rows.add("friction", spec.friction_limit * upward + tangential)
        last, tangent = self._at(1.0)
        lift = symbolic_robot.foot_motion()(q=last, dq=self.after, ddq=0)["v_stance"]
        landing = symbolic_robot.foot_motion()(q=last, dq=tangent * ca.sqrt(2 * self.sigma[-1]), ddq=0)["v_swing"]
        self.rows.add("lift-off", ca.SX(lift[1]), spec.lift_speed)
        self.rows.add("landing speed", ca.SX(-landing[1]), spec.landing_speed, spec.max_landing_speed)
        self.rows.add("landing slide", ca.SX(landing[0]), -spec.max_landing_slide, spec.max_landing_slide)
        if spec.barriers:
            self._add_barriers()

    def _add_barriers(self) -> None:
        spec = self.specification
        own = orbit_point.barrier_conditions(*astuple(spec.stone))
        farthest_stone = replace(spec.stone, l_min=spec.farthest_l_min, l_max=UNBOUNDED_STONE)
        farthest = orbit_point.barrier_conditions(*astuple(farthest_stone))
        for i, s in enumerate(self.s):
            foot = orbit_point.swing_foot()(*self.path, s, self.sigma[i], self.w[i])
            self.rows.add("barriers", ca.SX(own(*foot)), spec.barrier_margin)
            if s <= spec.clear_until:
                self.rows.add("farthest stone", ca.SX(farthest(*foot)[1]), spec.barrier_margin)

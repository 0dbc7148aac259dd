"""The gait as a nonlinear programme.

    minimise    (1 / step length) integral u'u dt
    over        Bézier coefficients and phase range: the path q(s);
                sigma, w, u, F at Hermite-Simpson points, the impact
    subject to  equation of motion at every point, d sigma / d s = w by Hermite-Simpson,
                impact and leg relabelling lead back to the start, step length and time,
                torque, friction, normal force, foot path, both barrier inequalities.

`orbit_point` says why the phase, not time, is the independent variable: outputs are zero exactly, everywhere.
"""

from collections.abc import Sequence
from dataclasses import astuple, replace

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
LEAST_SIGMA = 1e-3  # 1/s^2; the phase never stops


class Transcription(ca.Opti):
    """The programme of one `GaitSpecification`; `rows` has a name for each row of its constraints, for error messages.

    The search begins with the path of `guess`, where there is one, a constant phase rate, no torque, and support by
    weight alone.
    """

    def __init__(self, specification: GaitSpecification, guess: Gait | None = None) -> None:
        super().__init__()
        self.specification, self.rows = specification, list[str]()
        self.points = n = 2 * specification.intervals + 1
        self.s = np.linspace(0.0, 1.0, n)
        self.path = self.variable(4, DEGREE + 1), self.variable(2)  # Bézier coefficients, phase range
        self.sigma, self.w, self.u, self.force = (self.variable(*size) for size in ((n,), (n,), (4, n), (2, n)))
        self.impulse, self.after = self.variable(2), self.variable(7)  # and q' after the impact
        self.minimize(self.cost)
        self._add("phase rate", self.sigma, LEAST_SIGMA)
        self._add("torque", self.u, -specification.torque_limit, specification.torque_limit)
        self._add_motion()
        self._add_impact()
        self._add_path()
        self._add_walk()
        self._begin(guess)
        self._figures = ca.Function("figures", [self.x], [self.f, self.g, self.lbg, self.ubg])

    def latest(self) -> tuple[float, Array]:
        """The cost of the latest iterate, and by how much each row is broken, (n,), below zero where it is not."""
        cost, *rows = self._figures(self.debug.value(self.x))
        values, lower, upper = (np.asarray(row).ravel() for row in rows)
        return float(cost), np.maximum(lower - values, values - upper)

    @property
    def durations(self) -> ca.MX:
        """Simpson weight of each point times ds / s', so that their sum is the step time, s."""
        weights = np.ones(self.points)
        weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
        return ca.DM(weights / (3 * (self.points - 1))) / ca.sqrt(2 * self.sigma)

    @property
    def cost(self) -> ca.MX:
        """Integral of u'u dt over step length, (N m)^2 s / m."""
        return ca.sum1(self.durations * ca.sum1(self.u**2).T) / self.specification.step_length

    def _add(self, name: str, value: ca.MX, lower: float = 0.0, upper: float = np.inf) -> None:
        """`lower <= value <= upper`, element by element."""
        self.subject_to(self.bounded(lower, ca.vec(value), upper))
        self.rows += [name] * value.numel()

    def _equal(self, name: str, value: ca.MX) -> None:
        """`value = 0`."""
        self._add(name, value, 0.0, 0.0)

    def _begin(self, guess: Gait | None) -> None:
        """Where the search begins."""
        spec = self.specification
        if guess:
            coeffs, phase_range = guess.coeffs, np.array([guess.phase_angle_start, guess.phase_angle_end])
        else:
            coeffs, phase_range = initial_guess(spec)
        self.set_initial(self.path[0], coeffs)
        self.set_initial(self.path[1], phase_range)
        self.set_initial(self.sigma, (1 / spec.step_time) ** 2 / 2)
        self.set_initial(self.force[1, :], ROBOT_MASS * symbolic_robot.GRAVITY)
        self.set_initial(self.impulse[1], 10.0)

    def _at(self, s: float) -> tuple[ca.MX, ca.MX]:
        """q and q_s at `s`."""
        q, q_s, _ = orbit_point.path()(*self.path, s)
        return q, q_s

    def _add_motion(self) -> None:
        """Equation of motion and collocation."""
        residual = orbit_point.dynamics_residual(self.specification.slope)
        for i, s in enumerate(self.s):
            rows = residual(*self.path, s, self.sigma[i], self.w[i], self.u[:, i], self.force[:, i])
            self._equal("equation of motion", rows)
        first, middle, last = slice(0, -2, 2), slice(1, None, 2), slice(2, None, 2)
        sigma, w, h = self.sigma, self.w, 1.0 / self.specification.intervals
        hermite = sigma[middle] - (sigma[first] + sigma[last]) / 2 - h / 8 * (w[first] - w[last])
        simpson = sigma[last] - sigma[first] - h / 6 * (w[first] + 4 * w[middle] + w[last])
        self._equal("collocation", ca.vertcat(hermite, simpson))

    def _add_impact(self) -> None:
        """M (dq+ - dq-) = J_swing' impulse, the landed foot at rest; relabelled, its phase rate is the first one."""
        q, q_s = self._at(1.0)
        before = q_s * ca.sqrt(2 * self.sigma[-1])
        feet = symbolic_robot.foot_motion()(q=q, dq=self.after, ddq=0)
        mass_matrix, _ = symbolic_robot.dynamics()
        self._equal("impact map", mass_matrix(q) @ (self.after - before) - feet["J_swing"].T @ self.impulse)
        self._equal("impact map", feet["v_swing"])
        span = self.path[1][1] - self.path[1][0]
        rate = (self.after[2] + self.after[5] + self.after[6] / 2) / span
        self._equal("orbit closure", rate - ca.sqrt(2 * self.sigma[0]))
        for sign in (-1, 1):
            self._add("impulse friction", IMPULSE_FRICTION * self.impulse[1] + sign * self.impulse[0])

    def _add_path(self) -> None:
        """Leg relabelling, step length, joint ranges and foot height: geometry of the path alone."""
        spec, (first, _), (last, _) = self.specification, self._at(0.0), self._at(1.0)
        self._equal("leg relabelling", first[2:] - last[SWAP][2:])
        foot = symbolic_robot.feet()(last)[1]
        self._equal("step length", foot - ca.vertcat(spec.step_length, 0))
        for s in self.s:
            q, _ = self._at(s)
            self._add("pitch range", q[2], *spec.pitch_range)
            self._add("knee range", q[[4, 6]], *spec.knee_range)
            if 0 < s < 1:
                height = symbolic_robot.feet()(q)[1][1]
                self._add("foot height", height, spec.clearance * 4 * s * (1 - s), spec.max_foot_height)

    def _add_walk(self) -> None:
        """Closure, step time, forces, landing, barriers."""
        spec, (_, tangent) = self.specification, self._at(0.0)
        start = (tangent * ca.sqrt(2 * self.sigma[0]))[SWAP]
        self._equal("orbit closure", (start - self.after)[2:6])
        self._equal("step time", ca.sum1(self.durations) - spec.step_time)
        tangential, upward = self.force[0, :], self.force[1, :]
        self._add("normal force", upward, spec.min_normal_force)
        self._add("friction", spec.friction_limit * upward - tangential)
        self._add("friction", spec.friction_limit * upward + tangential)
        last, tangent = self._at(1.0)
        lift = symbolic_robot.foot_motion()(q=last, dq=self.after, ddq=0)["v_stance"]
        landing = symbolic_robot.foot_motion()(q=last, dq=tangent * ca.sqrt(2 * self.sigma[-1]), ddq=0)["v_swing"]
        self._add("lift-off", lift[1], spec.lift_speed)
        self._add("landing speed", -landing[1], spec.landing_speed, spec.max_landing_speed)
        self._add("landing slide", landing[0], -spec.max_landing_slide, spec.max_landing_slide)
        if spec.barriers:
            self._add_barriers()

    def _add_barriers(self) -> None:
        spec = self.specification
        conditions = orbit_point.barrier_conditions(*astuple(spec.stone))
        farthest_stone = replace(spec.stone, l_min=spec.farthest_l_min, l_max=UNBOUNDED_STONE)
        farthest = orbit_point.barrier_conditions(*astuple(farthest_stone))
        for i, s in enumerate(self.s):
            foot = orbit_point.swing_foot()(*self.path, s, self.sigma[i], self.w[i])
            self._add("barriers", ca.MX(conditions(*foot)), spec.barrier_margin)
            if s <= spec.clear_until:
                self._add("farthest stone", ca.MX(farthest(*foot)[1]), spec.barrier_margin)


def broken(rows: Sequence[str], excess: Array, tolerance: float = 1e-6) -> dict[str, float]:
    """The largest `excess` (n,) above `tolerance` of each name among `rows`, worst first."""
    worst: dict[str, float] = {}
    for name, value in zip(rows, excess.tolist(), strict=True):
        if not value <= tolerance:
            worst[name] = max(worst.get(name, 0.0), value)
    return dict(sorted(worst.items(), key=lambda item: -item[1]))

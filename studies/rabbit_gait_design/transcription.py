"""The gait as a nonlinear programme.

    minimise    (1 / step length) integral u'u dt  of the nominal walk
    over        Bézier coefficients and phase range: one path q(s), shared by all walks;
                for each walk (nominal, and each payload): sigma, w, u, F at Hermite-Simpson points, the impact
    subject to  equation of motion at every point, d sigma / d s = w by Hermite-Simpson,
                impact and leg relabelling lead back to the start, step length and time,
                torque, friction, normal force, foot path, both barrier inequalities.

`orbit_point` says why the phase, not time, is the independent variable: outputs are zero exactly, everywhere.
"""

from dataclasses import astuple, dataclass, field, replace
from typing import Any

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


class Path:
    """The shared path q(s): Bézier coefficients (4, 6) and phase range (2,)."""

    size = 4 * (DEGREE + 1) + 2

    def __init__(self) -> None:
        self.symbols = (ca.SX.sym("coeffs", 4, DEGREE + 1), ca.SX.sym("phase_range", 2))

    def at(self, s: float) -> tuple[ca.SX, ca.SX]:
        """q and q_s at `s`."""
        q, q_s, _ = orbit_point.path()(*self.symbols, s)
        return q, q_s

    @staticmethod
    def unpack(x: Array) -> tuple[Array, Array]:
        """Coefficients (4, 6) and phase range (2,) of a solution."""
        return x[:24].reshape(4, DEGREE + 1, order="F"), x[24:26]


class PeriodicWalk:
    """One periodic walk along the path, of the robot with `payload` kg: variables, dynamics, impact."""

    def __init__(self, path: Path, payload: float, specification: GaitSpecification, rows: ConstraintRows) -> None:
        self.path, self.payload, self.rows = path, payload, rows
        self.slope, intervals = specification.slope, specification.intervals
        self.label = f"{payload:g} kg: " if payload else ""
        self.points = n = 2 * intervals + 1
        self.s = np.linspace(0.0, 1.0, n)
        self.sigma, self.w, self.u = ca.SX.sym("sigma", n), ca.SX.sym("w", n), ca.SX.sym("u", 4, n)
        self.force, self.impulse, self.after = ca.SX.sym("force", 2, n), ca.SX.sym("impulse", 2), ca.SX.sym("dq+", 7)
        self._add_motion()
        self._add_collocation(1.0 / intervals)
        self._add_impact()

    @property
    def variables(self) -> ca.SX:
        """All of this walk's variables in one column."""
        blocks = [self.sigma, self.w, self.u, self.force, self.impulse, self.after]
        return ca.vertcat(*(ca.vec(block) for block in blocks))

    @property
    def durations(self) -> ca.SX:
        """Simpson weight of each point times ds / s', so that their sum is the step time, s."""
        weights = np.ones(self.points)
        weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
        return ca.SX(weights / (3 * (self.points - 1))) / ca.sqrt(2 * self.sigma)

    def guess(self, rate: float) -> Array:
        """Constant phase rate, no torque, support by weight alone."""
        n, weight = self.points, (ROBOT_MASS + self.payload) * symbolic_robot.GRAVITY
        force, impulse = np.tile([0.0, weight], n), np.array([0.0, 10.0])
        return np.concatenate([np.full(n, rate**2 / 2), np.zeros(5 * n), force, impulse, np.zeros(7)])

    def bounds(self, torque_limit: float) -> tuple[Array, Array]:
        """Lower and upper bounds of the variables."""
        n = self.points
        upper = np.concatenate([np.full(2 * n, UNBOUNDED), np.full(4 * n, torque_limit), np.full(2 * n + 9, UNBOUNDED)])
        lower = -upper
        lower[:n] = LEAST_SIGMA
        return lower, upper

    def limit_force(self, friction: float, normal: float) -> None:
        """Hold abs(F_T) <= friction F_N and F_N >= normal at every point."""
        tangential, upward = self.force[0, :], self.force[1, :]
        self.rows.add(f"{self.label}normal force", upward, normal)
        self.rows.add(f"{self.label}friction", friction * upward - tangential)
        self.rows.add(f"{self.label}friction", friction * upward + tangential)

    def _add_motion(self) -> None:
        residual = orbit_point.dynamics_residual(self.payload, self.slope)
        for i, s in enumerate(self.s):
            rows = residual(*self.path.symbols, s, self.sigma[i], self.w[i], self.u[:, i], self.force[:, i])
            self.rows.equal(f"{self.label}equation of motion", rows)

    def _add_collocation(self, h: float) -> None:
        first, middle, last = slice(0, -2, 2), slice(1, None, 2), slice(2, None, 2)
        sigma, w = self.sigma, self.w
        hermite = sigma[middle] - (sigma[first] + sigma[last]) / 2 - h / 8 * (w[first] - w[last])
        simpson = sigma[last] - sigma[first] - h / 6 * (w[first] + 4 * w[middle] + w[last])
        self.rows.equal(f"{self.label}collocation", ca.vertcat(hermite, simpson))

    def _add_impact(self) -> None:
        """M (dq+ - dq-) = J_swing' impulse, the landed foot at rest; relabelled, its phase rate is the first one."""
        q, q_s = self.path.at(1.0)
        before = q_s * ca.sqrt(2 * self.sigma[-1])
        feet = symbolic_robot.foot_motion()(q=q, dq=self.after, ddq=0)
        mass_matrix, _ = symbolic_robot.dynamics(self.payload)
        self.rows.equal(
            f"{self.label}impact map", mass_matrix(q) @ (self.after - before) - feet["J_swing"].T @ self.impulse
        )
        self.rows.equal(f"{self.label}impact map", feet["v_swing"])
        span = self.path.symbols[1][1] - self.path.symbols[1][0]
        rate = (self.after[2] + self.after[5] + self.after[6] / 2) / span
        self.rows.equal(f"{self.label}orbit closure", rate - ca.sqrt(2 * self.sigma[0]))
        for sign in (-1, 1):
            self.rows.add(f"{self.label}impulse friction", IMPULSE_FRICTION * self.impulse[1] + sign * self.impulse[0])


class Transcription:
    """Variables, rows and cost of one `GaitSpecification`, as CasADi's `nlpsol` takes them.

    The search begins with the path of `guess`, where there is one.
    """

    def __init__(self, specification: GaitSpecification, guess: Gait | None = None) -> None:
        self.specification = spec = specification
        self._guess = guess
        self.rows = ConstraintRows()
        self.path = Path()
        self.nominal, *self.loaded = (
            PeriodicWalk(self.path, payload, spec, self.rows) for payload in (0.0, *spec.payloads)
        )
        self._add_path()
        self._add_nominal()
        for walk in self.loaded:
            walk.limit_force(spec.payload_friction_limit, spec.payload_min_normal_force)

    @property
    def walks(self) -> list[PeriodicWalk]:
        """The nominal walk, then the loaded ones."""
        return [self.nominal, *self.loaded]

    @property
    def cost(self) -> ca.SX:
        """Integral of u'u dt over step length, (N m)^2 s / m."""
        walk = self.nominal
        return ca.sum1(walk.durations * ca.sum1(walk.u**2).T) / self.specification.step_length

    def nlp(self) -> dict[str, ca.SX]:
        """CasADi's description of the programme."""
        x = ca.vertcat(*(ca.vec(block) for block in self.path.symbols), *(walk.variables for walk in self.walks))
        return {"x": x, "f": self.cost, "g": ca.vertcat(*self.rows.values)}

    def bounds(self) -> dict[str, Array]:
        """Initial guess, bounds of the variables and of the rows."""
        spec = self.specification
        if guess := self._guess:
            coeffs, phase_range = guess.coeffs, np.array([guess.phase_angle_start, guess.phase_angle_end])
        else:
            coeffs, phase_range = initial_guess(spec)
        limits = [spec.torque_limit] + [spec.payload_torque_limit] * len(self.loaded)
        free = np.full(Path.size, UNBOUNDED)
        pairs: list[Any] = [(-free, free)]
        pairs += [walk.bounds(limit) for walk, limit in zip(self.walks, limits, strict=True)]
        guesses = [coeffs.flatten(order="F"), phase_range, *(walk.guess(1 / spec.step_time) for walk in self.walks)]
        return {
            "x0": np.concatenate(guesses),
            "lbx": np.concatenate([pair[0] for pair in pairs]),
            "ubx": np.concatenate([pair[1] for pair in pairs]),
            "lbg": np.array(self.rows.lower),
            "ubg": np.array(self.rows.upper),
        }

    def first_rate(self, x: Array) -> float:
        """Post-impact phase rate of the nominal walk of a solution, 1/s."""
        return float(np.sqrt(2 * x[Path.size]))

    def _add_path(self) -> None:
        """Leg relabelling, step length, joint ranges and foot height: geometry of the path alone."""
        spec, (first, _), (last, _) = self.specification, self.path.at(0.0), self.path.at(1.0)
        self.rows.equal("leg relabelling", first[2:] - last[SWAP][2:])
        foot = symbolic_robot.feet()(last)[1]
        self.rows.equal("step length", foot - ca.vertcat(spec.step_length, 0))
        for s in self.nominal.s:
            q, _ = self.path.at(s)
            self.rows.add("pitch range", q[2], *spec.pitch_range)
            self.rows.add("knee range", q[[4, 6]], *spec.knee_range)
            if 0 < s < 1:
                height = symbolic_robot.feet()(q)[1][1]
                self.rows.add("foot height", height, spec.clearance * 4 * s * (1 - s), spec.max_foot_height)

    def _add_nominal(self) -> None:
        """What only the nominal walk must keep: exact closure, step time, forces, landing, barriers."""
        spec, walk = self.specification, self.nominal
        _, tangent = self.path.at(0.0)
        start = (tangent * ca.sqrt(2 * walk.sigma[0]))[SWAP]
        self.rows.equal("orbit closure", (start - walk.after)[2:6])
        self.rows.equal("step time", ca.sum1(walk.durations) - spec.step_time)
        walk.limit_force(spec.friction_limit, spec.min_normal_force)
        last, tangent = self.path.at(1.0)
        lift = symbolic_robot.foot_motion()(q=last, dq=walk.after, ddq=0)["v_stance"]
        landing = symbolic_robot.foot_motion()(q=last, dq=tangent * ca.sqrt(2 * walk.sigma[-1]), ddq=0)["v_swing"]
        self.rows.add("lift-off", ca.SX(lift[1]), spec.lift_speed)
        self.rows.add("landing speed", ca.SX(-landing[1]), spec.landing_speed, spec.max_landing_speed)
        self.rows.add("landing slide", ca.SX(landing[0]), -spec.max_landing_slide, spec.max_landing_slide)
        if spec.barriers:
            self._add_barriers()

    def _add_barriers(self) -> None:
        spec, walk = self.specification, self.nominal
        own = orbit_point.barrier_conditions(*astuple(spec.stone))
        farthest_stone = replace(spec.stone, l_min=spec.farthest_l_min, l_max=UNBOUNDED_STONE)
        farthest = orbit_point.barrier_conditions(*astuple(farthest_stone))
        for i, s in enumerate(walk.s):
            foot = orbit_point.swing_foot()(*self.path.symbols, s, walk.sigma[i], walk.w[i])
            self.rows.add("barriers", ca.SX(own(*foot)), spec.barrier_margin)
            if s <= spec.clear_until:
                self.rows.add("farthest stone", ca.SX(farthest(*foot)[1]), spec.barrier_margin)

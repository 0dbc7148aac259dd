"""The figures of a gait's nominal walk, evaluated by pinocchio between the optimisation's nodes as well as at them."""

from dataclasses import asdict, astuple, dataclass
from functools import cached_property

import numpy as np
from rabbit_description.gait import Gait
from rabbit_description.state import SWAP_STATE, Array
from rl_cbf_clf_controller.virtual_constraints import RABBIT_ANGLES

from rabbit_gait_design.orbit_point import barrier_conditions
from rabbit_gait_design.specification import Stone
from rabbit_gait_design.zero_dynamics import Instant, ZeroDynamics, nominal_model


@dataclass(frozen=True)
class GaitFigures:
    """What a gait asks of robot and ground over one nominal step (SI units)."""

    speed: float
    step_time: float
    cost: float
    peak_torque: float
    friction_used: float
    least_normal_force: float
    foot_height: float
    landing_speed_down: float
    landing_speed_forward: float
    impulse_friction: float
    least_phase_rate: float
    start_phase_rate: float
    eigenvalue: float
    closure_error: float

    def rounded(self, digits: int = 6) -> dict[str, float]:
        """The numbers for the gait file."""
        return {name: round(value, digits) for name, value in asdict(self).items()}


class Orbit:
    """The gait's nominal step sampled at `points` phases."""

    def __init__(self, gait: Gait, points: int = 401) -> None:
        self.gait, self.dynamics = gait, ZeroDynamics(gait, nominal_model(gait.slope))
        self.phases = np.linspace(0.0, 1.0, points)
        self.start_rate = start_phase_rate(gait)
        self.rates = self.dynamics.phase_rates(self.phases, self.start_rate)
        self.instants: list[Instant] = [self.dynamics.at(s, r) for s, r in zip(self.phases, self.rates, strict=True)]

    def series(self, name: str) -> Array:
        """One field of the instants over the step, shape (points, ...)."""
        return np.array([getattr(instant, name) for instant in self.instants])

    @cached_property
    def times(self) -> Array:
        """Time since impact at each phase, s, shape (points,)."""
        slowness = 1.0 / self.rates
        steps = np.diff(self.phases) * (slowness[1:] + slowness[:-1]) / 2
        return np.concatenate([[0.0], np.cumsum(steps)])

    def ecbf_conditions(self, stone: Stone) -> Array:
        """B'' + (p1 + p2) B' + p1 p2 B of both barriers, shape (points, 2), m/s^2."""
        conditions = barrier_conditions(*astuple(stone))
        motions = ((i.swing, i.swing_rate, i.swing_acceleration) for i in self.instants)
        return np.array([np.array(conditions(*motion)).ravel() for motion in motions])

    def after_impact(self) -> tuple[Array, Array, Array]:
        """Relabelled `(q, dq)` after the landing, hip from the new stance foot, and the impulse (2,), N s."""
        last = self.instants[-1]
        dq, impulse = self.dynamics.model.impact(last.q, last.dq)
        q = last.q.copy()
        q[:2] -= last.swing
        return q[SWAP_STATE], dq[SWAP_STATE], impulse

    def figures(self) -> GaitFigures:
        """Reduce the step to figures."""
        torque, force, swing = self.series("torque"), self.series("force"), self.series("swing")
        last, (q, dq, impulse) = self.instants[-1], self.after_impact()
        phi, _ = self.dynamics.transition(np.array([0.0, 1.0]))
        start_q, start_dq = self.gait.x_start
        return GaitFigures(
            speed=float(last.swing[0] / self.times[-1]),
            step_time=float(self.times[-1]),
            cost=float(np.trapezoid(np.sum(torque**2, axis=1), self.times) / last.swing[0]),
            peak_torque=float(np.abs(torque).max()),
            friction_used=float(np.abs(force[:, 0] / force[:, 1]).max()),
            least_normal_force=float(force[:, 1].min()),
            foot_height=float(swing[:, 1].max()),
            landing_speed_down=float(-last.swing_rate[1]),
            landing_speed_forward=float(last.swing_rate[0]),
            impulse_friction=float(abs(impulse[0] / impulse[1])),
            least_phase_rate=self.dynamics.least_phase_rate(),
            start_phase_rate=self.start_rate,
            eigenvalue=float(phi[-1] * (self.start_rate / self.rates[-1]) ** 2),
            closure_error=float(max(np.abs(q - start_q).max(), np.abs(dq - start_dq).max())),
        )


def start_phase_rate(gait: Gait) -> float:
    """Phase rate of the gait's post-impact state, 1/s."""
    _, dq = gait.x_start
    return float(RABBIT_ANGLES.phase_angle @ dq / (gait.phase_angle_end - gait.phase_angle_start))

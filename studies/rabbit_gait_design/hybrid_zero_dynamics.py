"""A step and its impact on the zero dynamics of any planar robot (Westervelt et al. 2007).

With y = 0 a step is known from its phase rate alone. Over the step sigma = phase_rate^2 / 2 becomes Phi sigma + W (see
`zero_dynamics`); the impact multiplies the phase rate by delta. So from the start of a step to that of the next

    sigma -> delta^2 (Phi sigma + W),   which repeats at delta^2 W / (1 - delta^2 Phi) and is stable if delta^2 Phi < 1.

The impact keeps y = dy/dt = 0 if the path begins with the angles and the slope that the impact makes of its end:
`impact_invariant` chooses a path's first two control points so.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from cbf_clf_qp.functions import NumpyFunction
from rabbit_description.state import Array
from rl_cbf_clf_controller.virtual_constraints import Angles, StepPath

from rabbit_gait_design.path_outputs import output_functions
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rabbit_gait_design.zero_dynamics import Instant, ZeroDynamics


@dataclass(frozen=True)
class Walker:
    """A planar robot of n coordinates: its model and outputs, and `swap` (n,), so that `q[swap]` exchanges the legs."""

    model: PinocchioModel
    angles: Angles
    swap: Array

    @cached_property
    def functions(self) -> tuple[NumpyFunction, ...]:
        """The functions of its outputs along any path."""
        return output_functions(self.angles)

    def along(self, path: StepPath) -> ZeroDynamics:
        """The zero dynamics along a path."""
        return ZeroDynamics(path, self.model, self.angles, self.functions)

    def after_impact(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Relabelled `(q, dq)`, each (n,), once the swing foot has landed at a state; it is at the origin then."""
        landed = self.model.update(q, dq).swing
        after, _ = self.model.impact(q, dq)
        return (q - np.concatenate([landed, np.zeros(len(q) - 2)]))[self.swap], after[self.swap]


def impact_invariant(walker: Walker, later: Array, phase_angle_end: float) -> StepPath:
    """The path with control points `later` (m, k) from the third on, and before them those that the impact asks for."""
    c, H = walker.angles.phase_angle, walker.angles.controlled
    path = StepPath(np.hstack([np.zeros((len(later), 2)), later]), 0.0, phase_angle_end)
    q, _ = walker.after_impact(*_at_end(walker, path))
    path = replace(path, phase_angle_start=float(c @ q))
    _, dq = walker.after_impact(*_at_end(walker, path))
    span = phase_angle_end - path.phase_angle_start
    slope = H @ dq / (c @ dq) * span
    first = H @ q
    second = first + slope / (path.coeffs.shape[1] - 1)
    return replace(path, coeffs=np.column_stack([first, second, later]))


def _at_end(walker: Walker, path: StepPath) -> tuple[Array, Array]:
    return walker.along(path).state(1.0, 1.0)


class RepeatedStep:
    """The step along a path that repeats, at `points` phases.

    `delta`: the phase rate after the impact over that before; `eigenvalue`: of the map of sigma; `sigma` (points,):
    1/s^2, of the repeated step, negative where there is none.
    """

    def __init__(self, walker: Walker, path: StepPath, points: int = 201, tolerance: float = 1e-9) -> None:
        self.walker, self.path = walker, path
        self.dynamics = walker.along(path)
        self.phases = np.linspace(0.0, 1.0, points)
        _, dq = walker.after_impact(*self.dynamics.state(1.0, 1.0))
        span = path.phase_angle_end - path.phase_angle_start
        self.delta = float(walker.angles.phase_angle @ dq) / span
        phi, offset = self.dynamics.transition(self.phases, tolerance)
        self.eigenvalue = float(self.delta**2 * phi[-1])
        self.sigma = phi * self.delta**2 * offset[-1] / (1 - self.eigenvalue) + offset

    @property
    def exists(self) -> bool:
        """Whether the robot gets through the step that repeats, and starts near it come nearer."""
        return bool(self.eigenvalue < 1 and self.sigma.min() > 0)

    @property
    def start(self) -> tuple[Array, Array]:
        """`(q, dq)`, each (n,), after the impact, stance foot at the origin."""
        return self.dynamics.state(0.0, float(self.rates[0]))

    @cached_property
    def rates(self) -> Array:
        """Phase rates, 1/s, shape (points,)."""
        return np.sqrt(2 * np.maximum(self.sigma, 1e-6))

    @cached_property
    def instants(self) -> list[Instant]:
        """The step's motion, torque and force."""
        return [self.dynamics.at(s, rate) for s, rate in zip(self.phases, self.rates, strict=True)]

    def series(self, name: str) -> Array:
        """One field of the instants, shape (points, ...)."""
        return np.array([getattr(instant, name) for instant in self.instants])

    @property
    def duration(self) -> float:
        """The duration of the step, s."""
        return float(np.trapezoid(1 / self.rates, self.phases))

    @property
    def cost(self) -> float:
        """The integral of |u|^2 over the time, over the step length, N^2 m s."""
        power = np.sum(self.series("torque") ** 2, axis=1)
        return float(np.trapezoid(power / self.rates, self.phases) / self.instants[-1].swing[0])

"""A gait of any planar robot with two point feet, by optimisation on its hybrid zero dynamics.

    minimise    integral of |u|^2 dt / step length
    over        the path's control points from the third on, and the phase angle at its end
    subject to  step length and speed, the swing foot at z = 0 at the end and above it in the last part of the step,
                normal force, friction, torque, and an eigenvalue below 1

For RABBIT, with its stones, there is `design`, which knows more conditions.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import count

import casadi as ca
import numpy as np
from rabbit_description.state import Array
from rl_cbf_clf_controller.planar_walker import StonesFile
from rl_cbf_clf_controller.stone_barriers import stone_barriers
from rl_cbf_clf_controller.virtual_constraints import StepPath
from scipy.optimize import minimize

from rabbit_gait_design.hybrid_zero_dynamics import RepeatedStep, Walker, impact_invariant

PHASES, ODE_TOLERANCE = 21, 1e-6  # while a gait is sought
NEAR = 0.4  # rad, how far from the guess it is sought
TOLERANCE = 1e-4  # of the scaled conditions

Progress = Callable[[int, float], None]  # iteration, cost over the torque limit's square


class PlanarDesignError(RuntimeError):
    """No gait was found; names the conditions that are broken."""


@dataclass(frozen=True)
class PlanarSpecification:
    """What a gait must be; SI units.

    `clear_from`: the phase from which the swing foot is above the ground; a robot without knees scuffs before.
    `clearance`: its least height midway between there and the landing. `landing_speed`: its least speed downward.
    `stones`: the barriers of such stones hold along the gait.
    """

    step_length: float
    speed: float
    clear_from: float = 0.6
    clearance: float = 0.01
    landing_speed: float = 0.1
    friction_limit: float = 0.6
    min_normal_force: float = 50.0
    torque_limit: float = 150.0
    max_eigenvalue: float = 0.9
    stones: StonesFile | None = None

    @cached_property
    def barriers(self) -> ca.Function:
        """B and B + B' / p of both barriers, m, of the swing foot (2,) and its rate: of a stone that it lands on."""
        foot, rate = ca.SX.sym("foot", 2), ca.SX.sym("rate", 2)
        assert self.stones
        half, (pole, _) = self.stones.width / 2, self.stones.poles
        edges = self.step_length - half, self.step_length + half
        both = ca.vertcat(*stone_barriers(foot, *edges, 0.0, self.stones.R1, self.stones.R2))
        return ca.Function("barriers", [foot, rate], [ca.vertcat(both, both + ca.jtimes(both, foot, rate) / pole)])


def design(
    walker: Walker, wanted: PlanarSpecification, guess: StepPath, progress: Progress = lambda _, __: None
) -> RepeatedStep:
    """The best gait near `guess`, of which the first two control points do not count.

    Raises:
        PlanarDesignError: none was found.
    """
    programme = _Programme(walker, wanted, guess.coeffs[:, 2:].shape)
    first, iterations = np.append(guess.coeffs[:, 2:], guess.phase_angle_end), count(1)
    try:
        optimum = minimize(
            programme.cost,
            first,
            method="SLSQP",
            bounds=np.column_stack([first - NEAR, first + NEAR]),
            constraints=[{"type": "eq", "fun": programme.equal}, {"type": "ineq", "fun": programme.least}],
            options={"maxiter": 200, "ftol": 1e-5},
            callback=lambda x: progress(next(iterations), programme.cost(x)),
        )
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise PlanarDesignError(f"no gait of {wanted} found: {error}") from error
    broken = programme.broken(optimum.x)
    if broken:
        raise PlanarDesignError(f"no gait of {wanted} found ({optimum.message}); still broken: {', '.join(broken)}")
    return RepeatedStep(walker, programme.path(optimum.x))


def search(
    walker: Walker, wanted: PlanarSpecification, guesses: Iterable[StepPath], progress: Progress = lambda _, __: None
) -> RepeatedStep:
    """The first gait that is found near one of the guesses; raises `PlanarDesignError` of the last."""
    error = PlanarDesignError("expected a guess")
    for guess in guesses:
        try:
            return design(walker, wanted, guess, progress)
        except PlanarDesignError as failed:
            error = failed
    raise error


class _Programme:
    """Cost and scaled conditions of a path; each step is evaluated once, though cost and conditions ask in turn."""

    def __init__(self, walker: Walker, wanted: PlanarSpecification, shape: tuple[int, ...]) -> None:
        self._walker, self._wanted, self._shape = walker, wanted, shape
        self._step = lru_cache(4 * shape[0] * shape[1])(self._evaluated)

    def path(self, x: Array) -> StepPath:
        """The path of the unknowns `x`."""
        return impact_invariant(self._walker, x[:-1].reshape(self._shape), float(x[-1]))

    def cost(self, x: Array) -> float:
        """The integral of |u|^2 over the time and the step length, over the square of the torque limit."""
        return self._at(x).cost / self._wanted.torque_limit**2

    def equal(self, x: Array) -> Array:
        """Must be zero."""
        step, wanted = self._at(x), self._wanted
        length, height = step.series("swing")[-1]
        return np.array([length - wanted.step_length, height, length / step.duration - wanted.speed])

    def least(self, x: Array) -> Array:
        """Must not be negative."""
        return np.concatenate(list(self._conditions(x).values()))

    def broken(self, x: Array) -> list[str]:
        """Names of the conditions that do not hold."""
        names = [f"{name} by {-row.min():.2g}" for name, row in self._conditions(x).items() if row.min() < -TOLERANCE]
        equal = np.abs(self.equal(x)).max()
        return names + ([f"length, height, speed by {equal:.2g}"] if equal > TOLERANCE else [])

    def _conditions(self, x: Array) -> dict[str, Array]:
        step, wanted = self._at(x), self._wanted
        height, force = step.series("swing")[:, 1], step.series("force")
        left = (step.phases - wanted.clear_from) / (1 - wanted.clear_from)
        clearance = 4 * wanted.clearance * left * (1 - left)
        swing, rate = (step.series(name).T for name in ("swing", "swing_rate"))
        stones = {"stones": wanted.barriers(swing, rate).full().ravel() / wanted.clearance} if wanted.stones else {}
        return {
            **stones,
            "exists": np.array([step.sigma.min() - 0.05, wanted.max_eigenvalue - step.eigenvalue]),
            "clearance": (height - clearance)[(left > 0) & (left < 1)] / wanted.clearance,
            "landing speed": -step.series("swing_rate")[-1:, 1] - wanted.landing_speed,
            "normal force": force[:, 1] / wanted.min_normal_force - 1,
            "friction": (wanted.friction_limit * force[:, 1] - np.abs(force[:, 0])) / wanted.min_normal_force,
            "torque": 1 - np.abs(step.series("torque")).ravel() / wanted.torque_limit,
        }

    def _at(self, x: Array) -> RepeatedStep:
        return self._step(x.tobytes())

    def _evaluated(self, x: bytes) -> RepeatedStep:
        return RepeatedStep(self._walker, self.path(np.frombuffer(x)), PHASES, ODE_TOLERANCE)

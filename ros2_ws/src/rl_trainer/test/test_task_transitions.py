"""A task's transitions, of a double integrator whose true error is known in closed form."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Barrier, Clf, Estimates, System
from cbf_clf_qp.functions import Array
from rabbit_description.state import RobotState
from rabbit_description.task import ControlTask
from rabbit_description.task_state import task_state
from rl_cbf_clf_controller.policy import LearnedPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.task_controller import NOMINAL, Controlling, TaskController
from rl_trainer.parameters import TrainingParameters
from rl_trainer.transitions import Doubt, Transition, TransitionBuilder

SECONDS, SCALE, PUSH = 0.01, 2.0, 3.0  # s; true over nominal mass; m/s^2, nothing that the model knows
UNITS = (("y", 0.0, 1.0), ("dy", 0.0, 1.0))
CLF_PROBLEM, WALL_PROBLEM = (Problem("task", 1, (n,), ("y", "dy"), UNITS, (1.0,), (10.0,), (1.0,)) for n in "VB")
Y, DY, U, MASS = (ca.SX.sym(name) for name in ("y", "dy", "u", "mass"))
INTEGRATOR = System(ca.vertcat(Y, DY), U, ca.vertcat(DY, U / MASS), parameters=[MASS])
CLF, WALLED = Clf(Y, eps=0.5, gains=(1.0, 1.8)), Barrier("B", 1 - Y, poles=(2.0, 3.0))


def controller_of(quantity: Any = CLF, problem: Problem = CLF_PROBLEM, limit: float | None = None) -> TaskController:
    task = ControlTask(
        "task", INTEGRATOR, [quantity], {"mass": 1.0}, {"mass": SCALE}, ((0, 0), (0, 0)),
        limit=limit, seconds=SECONDS, coordinates=("y",),
    )  # fmt: skip
    return TaskController(task, problem)


CONTROLLER = controller_of()


def at(eta: Array, controller: TaskController = CONTROLLER, tick: int = 0, **told: Any) -> RobotState:
    return task_state(controller.task, eta, np.ones(1), told.pop("applied", np.full(1, np.nan)), tick, **told)


def measured(
    eta: Array,
    rng: np.random.Generator,
    controller: TaskController = CONTROLLER,
    policy: Controlling = NOMINAL,
    **later: Any,
) -> Transition:
    """The transition of a tick with exploration: y'' = mu / SCALE + PUSH; `later`: told of the state after it."""
    controller.policy, controller.sigma = policy, 2.0
    controller.reset(int(rng.integers(2**31)))
    builder = TransitionBuilder(TrainingParameters(problem=controller.problem))
    first = at(eta, controller)
    output = controller.step(first)
    assert builder.add(first, output) is None
    y_ddot = output.torque[0] / SCALE + PUSH
    moved = eta + np.array([SECONDS * eta[1] + SECONDS**2 / 2 * y_ddot, SECONDS * y_ddot])
    second = at(moved, controller, 1, **{"applied": output.torque, **later})
    found = builder.add(second, controller.step(second))
    assert found
    return found


@pytest.mark.parametrize("seed", range(5))
def test_the_target_is_the_models_error(seed: int) -> None:
    """V-dot = LfV + LgV (mu / SCALE + PUSH), so alpha = (1 / SCALE - 1) LgV and beta = LgV PUSH."""
    rng = np.random.default_rng(seed)
    found = measured(rng.standard_normal(2), rng)
    assert found.target[0] == pytest.approx(found.LgV[0] * ((1 / SCALE - 1) * found.mu[0] + PUSH), rel=1e-6, abs=1e-6)
    assert found.doubt is Doubt.NONE


class Constant(LearnedPolicy):
    """The same estimates everywhere."""

    version = "constant"

    def act(self, observation: Array, LgV: Array) -> Estimates:
        return Estimates(np.array([[0.3]]), np.array([0.1]))


def test_a_barriers_target_is_the_models_error_under_any_estimates() -> None:
    """B-ddot = -(mu / SCALE + PUSH), whatever was estimated when mu was decided; no V, no LgV."""
    controller, rng = controller_of(WALLED, WALL_PROBLEM), np.random.default_rng(0)
    found = measured(np.array([0.2, 0.4]), rng, controller, Constant())
    assert found.target == pytest.approx(-((1 / SCALE - 1) * found.mu + PUSH))
    assert found.correction == pytest.approx(0.3 * found.mu + 0.1)
    assert found.LgV == pytest.approx([0.0])


@pytest.mark.parametrize("later", [{"impacts": 1}, {"applied": np.zeros(1)}])
def test_nothing_is_measured_through_an_impact_or_under_another_input(later: dict[str, Any]) -> None:
    found = measured(np.array([0.1, 0.0]), np.random.default_rng(0), **later)
    assert Doubt.UNMEASURED in found.doubt
    assert np.isnan(found.measured).all()

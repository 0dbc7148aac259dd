"""Transitions from ticks, RABBIT's and a task's: exact where the truth is linear; what is left out."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Barrier, Clf, Estimates, System
from cbf_clf_qp.functions import Array
from rabbit_description.state import Leg, RobotState
from rabbit_description.task import ControlTask
from rabbit_description.task_state import task_state
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.policy import LearnedPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.task_controller import NOMINAL, Controlling, TaskController
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Replay
from rl_trainer.transitions import Doubt, Transition, TransitionBuilder
from tiny_world import tick

PARAMETERS = TrainingParameters()
PAPER = TrainingParameters(measurement="paper")


def join(*ticks: tuple[RobotState, ControllerOutput], parameters: TrainingParameters = PARAMETERS) -> Transition:
    builder = TransitionBuilder(parameters)
    transitions = [builder.add(state, output) for state, output in ticks]
    assert transitions[0] is None
    assert transitions[-1] is not None
    return transitions[-1]


def test_what_the_controller_measured_belongs_to_the_tick_before() -> None:
    """Of V its own difference may be taken in place of the gradient's."""
    measured = np.array([40.0, 10.0, 20.0, 310.0, -40.0])
    first = tick(20, output={"V": 2.0, "measured": np.full(5, 7.0)})
    second = tick(21, output={"V": 2.5, "measured": measured})
    np.testing.assert_array_equal(join(first, second).measured, measured)
    np.testing.assert_allclose(join(first, second, parameters=PAPER).measured, [50.0, *measured[1:]])


def test_nominal_of_a_tick_is_the_mean_of_its_ends_under_the_held_torque() -> None:
    """At the mu that was executed. Exact where the nominal value changes at a constant rate; the CLF's, where the
    nominal acceleration does. As the paper has it, and where the torque was not held: that of the tick's begin.
    """
    rng = np.random.default_rng(3)
    mu, mu_held, (a, next_a), b = rng.normal(size=4), rng.normal(size=4), rng.normal(size=(2, 5, 4)), np.arange(5.0)
    first = tick(20, output={"mu": mu, "mu_qp": -mu, "nominal_a": a, "nominal_b": b, "LgV": a[0]})
    second = tick(21, output={"mu_held": mu_held, "nominal_a": next_a, "nominal_b": b})
    expected = (a @ mu + next_a @ mu_held) / 2 + b
    expected[0] = a[0] @ (mu + mu_held) / 2 + b[0]
    np.testing.assert_allclose(join(first, second).nominal, expected)
    np.testing.assert_allclose(join(first, second, parameters=PAPER).nominal, a @ mu + b)
    np.testing.assert_allclose(join(first, tick(21)).nominal, a @ mu + b)


def test_error_is_the_papers_loss() -> None:
    """V-dot measured 50, nominal 10, corrected by alpha mu + beta = 25: the estimate is 15 short."""
    alpha = np.zeros((5, 4))
    alpha[0] = [5, 0, 0, 0]
    output = {
        "mu": np.array([4.0, 0, 0, 0]),
        "nominal_b": np.array([10.0, 0, 0, 0, 0]),
        "alpha": alpha,
        "beta": np.array([5.0, 0, 0, 0, 0]),
    }
    transition = join(tick(20, output=output), tick(21, output={"V": 0.5}), parameters=PAPER)
    assert transition.target[0] == pytest.approx(40)
    assert transition.error[0] == pytest.approx(-15)


@pytest.mark.parametrize(
    ("first", "second", "state", "doubt"),
    [
        ({}, {}, {}, Doubt.NONE),
        ({}, {"step_index": 1, "stance": Leg.RIGHT}, {}, Doubt.UNMEASURED),
        ({"step_index": 1, "step_time": 0.03}, {"step_index": 1}, {}, Doubt.SETTLING),
        ({"step_index": 1, "step_time": 0.04}, {"step_index": 1}, {}, Doubt.NONE),
        ({"step_index": 0, "step_time": 0.0}, {}, {}, Doubt.NONE),  # an episode does not begin with an impact
        ({}, {}, {"foot_force": np.zeros((2, 2))}, Doubt.FLIGHT),
        ({}, {}, {"foot_force": np.array([[0, 200.0], [0, 50.0]])}, Doubt.SCUFF),
        ({"saturated": True}, {}, {}, Doubt.SATURATED),
        ({"phase": 0.99}, {"phase": 1.01}, {}, Doubt.EDGE),
        ({"phase": 1.01}, {"phase": 1.03}, {}, Doubt.NONE),
        ({"phase": -0.01}, {"phase": 0.02}, {}, Doubt.EDGE),
        ({"eta": np.array([0, 0.7, 0, 0, 0, 0, 0, 0])}, {}, {}, Doubt.FAR),
        ({"eta": np.array([0, 0, 0, 0, 0, 0, 0, -13.0])}, {}, {}, Doubt.FAR),
    ],
)
def test_doubts(first: dict[str, Any], second: dict[str, Any], state: dict[str, Any], doubt: Doubt) -> None:
    transition = join(tick(20, output=first), tick(21, state=state, output=second))
    assert transition.doubt == doubt
    assert Replay(PARAMETERS).add(transition) == (doubt == Doubt.NONE)
    assert np.isnan(transition.measured).all() == (doubt == Doubt.UNMEASURED)


def test_gaps_are_never_bridged() -> None:
    builder = TransitionBuilder(PARAMETERS)
    made = [builder.add(*tick(k)) for k in (0, 1, 3, 4)]
    assert [transition is not None for transition in made] == [False, True, False, True]
    builder.reset()
    assert builder.add(*tick(5)) is None


@pytest.mark.parametrize(("height", "pitch", "failed"), [(0.78, 0.0, False), (0.69, 0.0, True), (0.78, -1.1, True)])
def test_the_last_transition_knows_of_failure_by_pose(height: float, pitch: float, failed: bool) -> None:
    builder = TransitionBuilder(PARAMETERS)
    builder.add(*tick(7))
    state, _ = tick(8, state={"q": np.array([0, height, pitch, 0, 0, 0, 0]), "running": False})
    last = builder.add(state)
    assert last is not None
    assert last.failed == failed
    assert last.doubt & Doubt.UNMEASURED
    assert builder.add(state) is None


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

"""A system without a robot: transitions of a double integrator whose true error is known in closed form."""

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Barrier, Clf, Estimates, System, Tick
from cbf_clf_qp.functions import Array
from rl_trainer.systems import EpisodePlan, LearnedPolicy, Problem, SystemTicks, TrainingParameters, Transition, learn

SECONDS, SCALE, PUSH = 0.01, 2.0, 3.0  # s; true over nominal mass; m/s^2, nothing that the model knows
PROBLEM = Problem("integrator", 1, ("V",), ("y", "dy"), (("y", 0.0, 1.0), ("dy", 0.0, 1.0)), (1.0,), (10.0,), (1.0,))
Y, DY, U, MASS, WALL = (ca.SX.sym(name) for name in ("y", "dy", "u", "mass", "wall"))
INTEGRATOR = System(ca.vertcat(Y, DY), U, ca.vertcat(DY, U / MASS), parameters=[MASS, WALL])
CLF, WALLED = Clf(Y, eps=0.5, gains=(1.0, 1.8)), Barrier("wall", WALL - Y, poles=(2.0, 3.0))
P = np.array([1.0, 1.0])


def ticks_of(quantity: Any, problem: Problem = PROBLEM, limit: float = np.inf) -> SystemTicks:
    tick = Tick(INTEGRATOR, [quantity], control=INTEGRATOR.affine(DY * 0 + U), reads={"observation": INTEGRATOR.x})
    return SystemTicks(tick, problem, SECONDS, limit)


TICKS = ticks_of(CLF)


def following(eta: Array, mu: float) -> Array:
    """A tick later: y'' = mu / SCALE + PUSH."""
    acceleration = mu / SCALE + PUSH
    return eta + np.array([SECONDS * eta[1] + SECONDS**2 / 2 * acceleration, SECONDS * acceleration])


def measured(eta: Array, mu: float, ticks: SystemTicks = TICKS, policy: LearnedPolicy | None = None) -> Transition:
    """The transition of a tick with this mu as executed."""
    ticks.begin(policy)
    qp = float(ticks(eta, P).mu[0])
    ticks.begin(policy)
    assert ticks(eta, P, np.array([mu - qp])).control == pytest.approx([mu])
    ticks(following(eta, mu), P)
    return ticks.transitions[0]


@pytest.mark.parametrize("seed", range(5))
def test_the_target_is_the_models_error(seed: int) -> None:
    """V-dot = LfV + LgV (mu / SCALE + PUSH), so alpha = (1 / SCALE - 1) LgV and beta = LgV PUSH."""
    rng = np.random.default_rng(seed)
    eta, mu = rng.standard_normal(2), float(rng.standard_normal())
    found = measured(eta, mu)
    LgV = float(TICKS(eta, P).seen.LgV[0])
    assert found.LgV[0] == pytest.approx(LgV)
    assert found.target[0] == pytest.approx(LgV * ((1 / SCALE - 1) * mu + PUSH), rel=1e-6, abs=1e-6)


class Constant(LearnedPolicy):
    """The same estimates everywhere."""

    version = "constant"

    def act(self, observation: Array, LgV: Array) -> Estimates:
        return Estimates(np.array([[0.3]]), np.array([0.1]))


def test_a_barriers_target_is_the_models_error_under_any_estimates() -> None:
    """B-ddot = -(mu / SCALE + PUSH), whatever was estimated when mu was decided; no V, no LgV."""
    problem = Problem("wall", 1, ("wall",), ("y", "dy"), PROBLEM.units, (1.0,), (10.0,), (1.0,))
    found = measured(np.array([0.2, 0.4]), 0.7, ticks_of(WALLED, problem), Constant())
    assert found.target == pytest.approx([-((1 / SCALE - 1) * 0.7 + PUSH)])
    assert found.correction == pytest.approx([0.3 * 0.7 + 0.1])
    assert found.LgV == pytest.approx([0.0])


def test_an_oracle_knows_the_true_parameters() -> None:
    """Twice the mass: y'' = mu / 2, so that V-dot is wrong by -LgV mu / 2, and mu with it twice as large."""
    TICKS.begin(true={"mass": 2.0})
    now = TICKS(np.array([0.3, -0.2]), P)
    assert now.estimates.alpha == pytest.approx(-now.seen.LgV[None] / 2)
    assert now.estimates.output_error == pytest.approx(np.array([[-0.5, 0.0]]))


def test_the_limit_holds_with_exploration_and_an_interruption_is_no_transition() -> None:
    ticks = ticks_of(CLF, limit=1.5)
    now = ticks(np.array([0.1, 0.0]), P, np.array([50.0]))
    assert (now.control, now.mu) == (pytest.approx([1.5]), pytest.approx([1.5]))
    ticks.interrupt()
    ticks(np.array([0.2, 0.0]), P)
    assert ticks.transitions == []
    ticks(np.array([0.2, 0.0]), P)
    assert len(ticks.transitions) == 1


def test_a_trainer_learns_it() -> None:
    """One input, one quantity, two observations: a fifth of the error without a policy is left."""
    parameters = TrainingParameters(
        problem=PROBLEM, learner="regression", hidden1=32, hidden2=32, batch=64, seed=3, episodes=1, updates_least=1500
    )
    rng = np.random.default_rng(8)

    said, ticks = list[str](), SimpleNamespace(transitions=list[Transition]())

    def draw(number: int) -> list[Transition]:
        return [measured(rng.standard_normal(2), float(2 * rng.standard_normal())) for _ in range(number)]

    def walk(policy: LearnedPolicy, plan: EpisodePlan) -> None:
        assert plan.episode == 0
        ticks.transitions = draw(600)

    policy, held_out = learn(parameters, ticks, walk, said.append), draw(100)
    assert [line.split(":")[0] for line in said] == ["seed 3, episode 1"]
    errors = [policy.act(each.observation, each.LgV).error(each.mu) - each.target for each in held_out]
    assert np.linalg.norm(errors) < 0.2 * np.linalg.norm([each.target for each in held_out])

"""A system without a robot: transitions of a double integrator whose true error is known in closed form."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Barrier, Clf, Estimates, System, Tick
from cbf_clf_qp.functions import Array
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_trainer.parameters import TrainingParameters
from rl_trainer.system_transitions import SystemTick, SystemTicks
from rl_trainer.training import Trainer

SECONDS, SCALE, PUSH = 0.01, 2.0, 3.0  # s; true over believed mass; m/s^2, nothing that the model knows
PROBLEM = Problem("integrator", 1, ("V",), ("y", "dy"), (("y", 0.0, 1.0), ("dy", 0.0, 1.0)), (1.0,), (10.0,), (1.0,))
Y, DY, U, WALL = (ca.SX.sym(name) for name in ("y", "dy", "u", "wall"))
INTEGRATOR = System(ca.vertcat(Y, DY), U, ca.vertcat(DY, U), parameters=[WALL])
TICK = Tick(INTEGRATOR, [Clf(Y, eps=0.5, gains=(1.0, 1.8))])
TICKS = SystemTicks(TICK, PROBLEM)
P = np.array([1.0])


def tick(eta: Array, mu: float, ticks: SystemTicks = TICKS, estimates: Estimates | None = None) -> SystemTick:
    """At a state, mu as executed."""
    decided = ticks.decide(eta, P, estimates or TICK.no_error(), eta)
    return SystemTick(eta, P, decided.seen, decided.estimates, decided.decided, np.array([mu]), eta)


def following(eta: Array, mu: float) -> Array:
    """A tick later: y'' = mu / SCALE + PUSH."""
    acceleration = mu / SCALE + PUSH
    return eta + np.array([SECONDS * eta[1] + SECONDS**2 / 2 * acceleration, SECONDS * acceleration])


@pytest.mark.parametrize("seed", range(5))
def test_the_target_is_the_models_error(seed: int) -> None:
    """V-dot = LfV + LgV (mu / SCALE + PUSH), so alpha = (1 / SCALE - 1) LgV and beta = LgV PUSH."""
    rng = np.random.default_rng(seed)
    eta, mu = rng.standard_normal(2), float(rng.standard_normal())
    before = tick(eta, mu)
    found = TICKS.transition(0, before, tick(following(eta, mu), 0.0), SECONDS)
    LgV = float(before.seen.LgV[0])
    assert before.control == pytest.approx([mu])
    assert found.LgV[0] == pytest.approx(LgV)
    assert found.target[0] == pytest.approx(LgV * ((1 / SCALE - 1) * mu + PUSH), rel=1e-6, abs=1e-6)


def test_a_barriers_target_is_the_models_error_under_any_estimates() -> None:
    """B-ddot = -(mu / SCALE + PUSH), whatever was estimated when mu was decided; no V, no LgV."""
    problem = Problem("wall", 1, ("wall",), ("y", "dy"), PROBLEM.units, (1.0,), (10.0,), (1.0,))
    barrier_tick = Tick(INTEGRATOR, [Barrier("wall", WALL - Y, poles=(2.0, 3.0))])
    ticks, estimates = SystemTicks(barrier_tick, problem), Estimates(np.array([[0.3]]), np.array([0.1]))
    eta = np.array([0.2, 0.4])
    found = ticks.transition(
        0, tick(eta, 0.7, ticks, estimates), tick(following(eta, 0.7), 0.0, ticks, estimates), SECONDS
    )
    assert found.target == pytest.approx([-((1 / SCALE - 1) * 0.7 + PUSH)])
    assert found.correction == pytest.approx([0.3 * 0.7 + 0.1])
    assert found.LgV == pytest.approx([0.0])


def test_a_trainer_learns_it() -> None:
    """One input, one quantity, two observations: a fifth of the error without a policy is left."""
    parameters = TrainingParameters(problem=PROBLEM, learner="regression", hidden1=32, hidden2=32, batch=64, seed=3)
    trainer, rng = Trainer(parameters), np.random.default_rng(8)

    def draw() -> Any:
        eta, mu = rng.standard_normal(2), float(2 * rng.standard_normal())
        return TICKS.transition(0, tick(eta, mu), tick(following(eta, mu), 0.0), SECONDS)

    for _ in range(600):
        trainer.take(draw())
    trainer.learn(1500)
    held_out = [draw() for _ in range(100)]
    policy = ActorPolicy(trainer.policy_file())
    errors = []
    for each in held_out:
        estimates = policy.act(each.observation, each.LgV)
        errors.append(estimates.error(each.mu) - each.target)
    assert np.linalg.norm(errors) < 0.2 * np.linalg.norm([each.target for each in held_out])

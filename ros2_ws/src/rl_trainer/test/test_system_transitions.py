"""A system without a robot: transitions of a double integrator whose true error is known in closed form."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cbf_clf_qp.affine import Affine, Array
from cbf_clf_qp.clf import Clf
from cbf_clf_qp.problem import Problem
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.solvers import make_solver
from cbf_clf_qp.tick import Recipe, Terms, decide
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_trainer.parameters import TrainingParameters
from rl_trainer.system_transitions import SystemTick, transition
from rl_trainer.training import Trainer

SECONDS, SCALE, PUSH = 0.01, 2.0, 3.0  # s; true over believed mass; m/s^2, nothing that the model knows
PROBLEM = Problem("integrator", 1, ("V",), ("y", "dy"), (("y", 0.0, 1.0), ("dy", 0.0, 1.0)), (1.0,), (10.0,), (1.0,))
CLF = ResClf(1, 0.5, (1.0, 1.8))
RECIPE = Recipe((Clf(CLF, 10.0),))


@dataclass(frozen=True)
class Outputs:
    """y = position."""

    eta: Array

    def second_derivative(self, acceleration: Affine) -> Affine:
        """Of the output."""
        return acceleration


def tick(eta: Array, mu: float) -> SystemTick:
    """At a state, mu as executed."""
    acceleration = Affine(np.eye(1), np.zeros(1))
    scene: Any = SimpleNamespace(outputs=Outputs(eta))
    terms = Terms.of(RECIPE.quantities, scene, SimpleNamespace(acceleration=acceleration), acceleration.inverse())
    decided = decide(RECIPE, terms, make_solver("daqp"))
    return SystemTick(terms, decided, np.array([mu]), eta)


def following(eta: Array, mu: float) -> Array:
    """A tick later: y'' = mu / SCALE + PUSH."""
    acceleration = mu / SCALE + PUSH
    return eta + np.array([SECONDS * eta[1] + SECONDS**2 / 2 * acceleration, SECONDS * acceleration])


@pytest.mark.parametrize("seed", range(5))
def test_the_target_is_the_models_error(seed: int) -> None:
    """V-dot = LfV + LgV (mu / SCALE + PUSH), so alpha = (1 / SCALE - 1) LgV and beta = LgV PUSH."""
    rng = np.random.default_rng(seed)
    eta, mu = rng.standard_normal(2), float(rng.standard_normal())
    found = transition(PROBLEM, 0, tick(eta, mu), tick(following(eta, mu), 0.0), SECONDS)
    LgV = CLF.derivative(eta).a[0, 0]
    assert found.LgV[0] == pytest.approx(LgV)
    assert found.target[0] == pytest.approx(LgV * ((1 / SCALE - 1) * mu + PUSH), rel=1e-6, abs=1e-6)


def test_a_trainer_learns_it() -> None:
    """One input, one quantity, two observations: a fifth of the error without a policy is left."""
    parameters = TrainingParameters(problem=PROBLEM, learner="regression", hidden1=32, hidden2=32, batch=64, seed=3)
    trainer, rng = Trainer(parameters), np.random.default_rng(8)

    def draw() -> Any:
        eta, mu = rng.standard_normal(2), float(2 * rng.standard_normal())
        return transition(PROBLEM, 0, tick(eta, mu), tick(following(eta, mu), 0.0), SECONDS)

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

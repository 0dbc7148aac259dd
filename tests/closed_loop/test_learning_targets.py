"""What the trainer measures on a walk is the true model error, which only this test knows."""

from typing import Any

import numpy as np
import pytest
from rabbit_description.gait import load_gait
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import from_flat
from rl_cbf_clf_controller.oracle import OraclePolicy, TruePlant
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP
from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit
from rl_trainer.rollout import Record, rollout
from rl_trainer.transitions import Doubt, TransitionBuilder

STEPS = 4


def parts(problem: Problem, plant: str) -> tuple[Simulation, Controller, TrainingParameters]:
    terrain = "stones" if problem == RL_CBF_CLF_QP else "flat"
    simulated = SimulationParameters.model_validate(
        {"mass_scale": 2.0, "terrain": terrain, "stones": STEPS, "plant": plant}
    )
    parameters = ControllerParameters.model_validate({"controller": problem.name, "sigma": 5.0})
    gait = load_gait(parameters.gait)
    oracle = OraclePolicy(TruePlant(perturbed_urdf(simulated)), io=problem.corrects_input)
    return Simulation(simulated, gait), Controller(parameters, gait, oracle), TrainingParameters(problem=problem)


@pytest.mark.parametrize("plant", ["pybullet", "rigid"])
@pytest.mark.parametrize("problem", PAPER)
def test_targets_are_the_true_errors(problem: Problem, plant: str) -> None:
    """At the executed mu, noise on: relative error below 0.1; of the forces, which the engine's ground gives, 0.25.

    In the first approach the oracle cancels the error, so y'' must be mu; the error counts against the input's size.
    """
    simulation, controller, parameters = parts(problem, plant)
    builder = TransitionBuilder(parameters)
    target, true, size, io = [], [], [], problem.corrects_input

    def observe(record: Record) -> None:
        transition = builder.add(record.state, record.output)
        if transition is not None and not transition.doubt & ~Doubt.SATURATED:
            unit = error_unit(transition.LgV, parameters)
            target.append(transition.target / unit)
            true.append(transition.correction / unit)  # the oracle's: exact
            size.append((transition.correction + transition.mu if io else transition.correction) / unit)

    rollout(simulation, controller, 11, observe)
    simulation.close()
    assert len(target) > 30 * STEPS
    error = np.linalg.norm(np.array(target) - true, axis=0) / np.linalg.norm(size, axis=0)
    limit = [0.25 if name in ("C1", "C2") else 0.1 for name in problem.quantities]
    assert (error < limit).all(), dict(zip(problem.quantities, error, strict=True))


def test_beside_an_adaptation_the_target_is_what_it_leaves() -> None:
    """The robot is found within a step; what is left to learn is less than a tenth of the nominal model's error."""
    simulation, _, parameters = parts(RL_CBF_CLF_QP, "rigid")
    tuning = ControllerParameters(controller="rl-cbf-clf-qp", adaptation="identification", sigma=5.0)
    controller = Controller(tuning, load_gait(tuning.gait), ZeroPolicy(tuning.problem))
    builder = TransitionBuilder(parameters)
    left, whole = [], []

    def observe(record: Record) -> None:
        transition = builder.add(record.state, record.output)
        if transition is not None and not transition.doubt & ~Doubt.SATURATED and transition.step_index:
            assert not transition.alpha.any()  # the policy's own
            found = from_flat(previous[0].adapted, 5, 4)
            left.append(transition.target)
            whole.append(transition.target + found.error(transition.mu))
        previous[0] = record.output

    previous: list[Any] = [None]
    rollout(simulation, controller, 11, observe)
    simulation.close()
    assert len(left) > 20 * STEPS
    assert (np.linalg.norm(left, axis=0) < 0.1 * np.linalg.norm(whole, axis=0)).all()

"""Which policy file fits which controller: the problem, the adaptation, the gait; stones' policies on flat ground."""

from collections.abc import Callable

import numpy as np
import pytest
from rabbit_description.gait import load_gait
from rabbit_experiments.assembly import Assembly
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Outcome
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import STONE_WIDTH, ActorPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import IO_RL_CLF_QP, RL_CBF_CLF_QP, RL_CLF_QP
from rl_cbf_clf_controller.weights import PolicyFile, PolicyFileError, policy_path, read
from rl_trainer.rollout import rollout
from untrained_policy import policy_file, policy_metadata

GAIT = load_gait("stones_0350_084")
STONES = ControllerParameters(controller="rl-cbf-clf-qp")
FLAT = ControllerParameters(controller="rl-clf-qp")


def make_file(problem: Problem, observations: int = -1, adaptation: str | None = None) -> PolicyFile:
    """An untrained policy that reads the problem's `observations`-th set, the whole by default."""
    form = policy_metadata(
        problem, observation=problem.observations[observations], hidden=(8, 8), adaptation=adaptation
    )
    return policy_file(form, np.random.default_rng(3).standard_normal)


@pytest.mark.parametrize("controller", ["io-rl-clf-qp", "rl-clf-qp", "rl-cbf-clf-qp"])
def test_a_policy_fits_the_controller_of_its_problem(controller: str) -> None:
    parameters = ControllerParameters.model_validate({"controller": controller})
    assert isinstance(fitted(make_file(parameters.problem, 0), parameters, GAIT), ActorPolicy)


def test_on_flat_ground_a_policy_for_stones_sees_the_stone_under_the_gaits_own_step() -> None:
    file, rng = make_file(RL_CBF_CLF_QP), np.random.default_rng(5)
    state, LgV = rng.standard_normal(14), rng.standard_normal(4)
    l_min = GAIT.step_length - STONE_WIDTH / 2
    on_stones = ActorPolicy(file).act(np.append(state, [l_min, GAIT.step_length]), LgV)
    flat = fitted(file, FLAT, GAIT).act(state, LgV)
    np.testing.assert_array_equal(flat.alpha, on_stones.alpha[:1])
    np.testing.assert_array_equal(flat.beta, on_stones.beta[:1])
    assert flat.output_error is not None
    np.testing.assert_array_equal(flat.output_error, on_stones.output_error)


@pytest.mark.parametrize(
    ("file", "parameters", "text"),
    [
        (lambda: make_file(RL_CLF_QP), STONES, "trained for rl-clf-qp; this controller needs rl-cbf-clf-qp"),
        (lambda: make_file(IO_RL_CLF_QP), FLAT, "trained for io-rl-clf-qp; this controller needs rl-clf-qp"),
        (lambda: make_file(RL_CBF_CLF_QP), STONES, "reads step_length: expected a gait library, gait is stones"),
        (
            lambda: make_file(RL_CBF_CLF_QP, 0, "identification"),
            FLAT,
            "trained with adaptation identification; this controller has none",
        ),
    ],
)
def test_what_does_not_fit_is_refused(
    file: Callable[[], PolicyFile], parameters: ControllerParameters, text: str
) -> None:
    with pytest.raises(PolicyFileError, match=text):
        fitted(file(), parameters, GAIT)


def test_one_file_walks_on_both_terrains() -> None:
    """The paper's policy for stones, on a robot of twice the mass."""
    path = policy_path("rl-cbf-clf-qp")
    for terrain, parameters in {"flat": FLAT, "stones": STONES}.items():
        plant = SimulationParameters.model_validate({"terrain": terrain, "mass_scale": 2.0, "stones": 3})
        simulation, controller = Assembly(plant, parameters, str(path)).build()
        rollout(simulation, controller, 7001)
        simulation.close()
        assert simulation.outcome is Outcome.WALKED
        assert controller.policy.version == read(path).version

"""The policy file: what is read back, which controller it fits, on both terrains; a policy within the step."""

from typing import Any

import numpy as np
import pytest
from rabbit_description.gait import load_gait, load_gaits
from rabbit_description.state import Array
from rabbit_experiments.assembly import Assembly, make_simulation
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Outcome
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.policy import STONE_WIDTH, ActorPolicy, estimate_function
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.residual_policy import READS, SCALE, ResidualActor, ResidualPolicy
from rl_cbf_clf_controller.uncertainty import IO_RL_CLF_QP, PAPER, RL_CBF_CLF_QP, RL_CLF_QP
from rl_cbf_clf_controller.weights import (
    PROBE,
    RESIDUAL_READS,
    PolicyFile,
    PolicyFileError,
    PolicyMetadata,
    decode,
    policy_path,
    read,
)
from untrained_policy import policy_file, policy_metadata
from walked import walked


def random_file(about: PolicyMetadata) -> PolicyFile:
    """With random weights."""
    return policy_file(about, np.random.default_rng(0).standard_normal)


def make_file(problem: Problem = RL_CBF_CLF_QP, structured: bool = True, **changes: Any) -> PolicyFile:
    m, n = len(problem.observation), len(problem.quantities)
    values = {
        "observation_center": (0.1,) * m,
        "observation_scale": (2.0,) * m,
        "hidden": (8, 6),
        "structured": structured,
        "alpha_scale": tuple(range(1, n + 1)),
        "beta_scale": tuple(range(10, n + 10)),
        "plant": {"mass_scale": 2.0, "plant": "pybullet"},
        "episodes": 3,
        "transitions": 100,
        "commit": "0" * 40,
        "command": "rabbit train",
    }
    return random_file(policy_metadata(problem, **values | changes))


@pytest.mark.parametrize("problem", PAPER)
def test_bytes_come_back_as_they_went(problem: Problem) -> None:
    file = make_file(problem, structured=problem.has_clf)
    again = decode(file.encode())
    assert again.metadata.fits(problem)
    assert again.metadata == file.metadata
    assert again.version == file.version
    assert again.encode() == file.encode()
    assert all((again.arrays[name] == array).all() for name, array in file.arrays.items())


def test_outputs_that_differ_from_those_stored_are_refused() -> None:
    file = make_file()
    arrays = file.arrays | {PROBE: file.arrays[PROBE] + np.float32(0.01)}
    with pytest.raises(PolicyFileError, match="fixed observations"):
        decode(PolicyFile(file.metadata, arrays).encode())


@pytest.mark.parametrize(
    "changes", [{"observation": ("y1",)}, {"observation_center": (0.0,) * 14}, {"hidden": (0, 6)}, {"something": 1}]
)
def test_metadata_that_does_not_fit(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(changes))):
        make_file(**changes)


def test_structured_row_is_LgV_times_the_matrix() -> None:
    rng = np.random.default_rng(1)
    D2, D1, LgV, others = rng.standard_normal((4, 4)), rng.standard_normal(4), rng.standard_normal(4), np.arange(20.0)
    outputs, scales = np.concatenate([np.column_stack([D2, D1]).ravel(), others]), (np.full(5, 2.0), np.full(5, 3.0))
    estimates = estimate_function(5, 4, structured=True, has_clf=True)(outputs, LgV, *scales)
    np.testing.assert_allclose(estimates.alpha[0], 2 * LgV @ D2)
    np.testing.assert_allclose(estimates.beta[0], 3 * LgV @ D1)
    np.testing.assert_array_equal(estimates.alpha[1:].ravel(), 2 * others[:16])
    np.testing.assert_array_equal(estimates.beta[1:], 3 * others[16:])
    np.testing.assert_allclose(estimates.output_error, np.column_stack([2 * D2, 3 * D1]))


GAIT = load_gait("stones_0350_084")
STONES = ControllerParameters(controller="rl-cbf-clf-qp")
FLAT = ControllerParameters(controller="rl-clf-qp")


def fit(problem: Problem, observations: int = -1, adaptation: str | None = None) -> PolicyFile:
    """A file that reads the problem's `observations`-th set, the whole by default."""
    observation = problem.observations[observations]
    return random_file(policy_metadata(problem, observation=observation, hidden=(8, 8), adaptation=adaptation))


@pytest.mark.parametrize("controller", ["io-rl-clf-qp", "rl-clf-qp", "rl-cbf-clf-qp"])
def test_a_policy_fits_the_controller_of_its_problem(controller: str) -> None:
    parameters = ControllerParameters.model_validate({"controller": controller})
    assert isinstance(fitted(fit(parameters.problem, 0), parameters, GAIT), ActorPolicy)


def test_on_flat_ground_a_policy_for_stones_sees_the_stone_under_the_gaits_own_step() -> None:
    file, rng = fit(RL_CBF_CLF_QP), np.random.default_rng(5)
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
        (fit(RL_CLF_QP), STONES, "trained for rl-clf-qp; this controller needs rl-cbf-clf-qp"),
        (fit(IO_RL_CLF_QP), FLAT, "trained for io-rl-clf-qp; this controller needs rl-clf-qp"),
        (fit(RL_CBF_CLF_QP), STONES, "reads step_length: expected a gait library, gait is stones"),
        (fit(RL_CBF_CLF_QP, 0, "identification"), FLAT, "with adaptation identification; this controller has none"),
    ],
)
def test_what_does_not_fit_is_refused(file: PolicyFile, parameters: ControllerParameters, text: str) -> None:
    with pytest.raises(PolicyFileError, match=text):
        fitted(file, parameters, GAIT)


@pytest.mark.parametrize("own", [FLAT, STONES], ids=lambda own: own.terrain)
def test_one_file_walks_on_both_terrains(own: ControllerParameters) -> None:
    """The paper's policy for stones, on a robot of twice the mass."""
    plant = SimulationParameters.model_validate({"terrain": own.terrain, "mass_scale": 2.0, "stones": 3})
    records, simulation = walked(Assembly(plant, own, str(policy_path("rl-cbf-clf-qp"))), 7001)
    assert simulation.outcome is Outcome.WALKED
    assert {record.output.policy_version for record in records} == {read(policy_path("rl-cbf-clf-qp")).version}


def parameters(terrain: str = "stones") -> ControllerParameters:
    kind = "rl-cbf-clf-qp" if terrain == "stones" else "rl-clf-qp"
    return load_parameters("best", controller=kind, qp_solver="daqp")


def plant(terrain: str = "stones", **values) -> SimulationParameters:
    return SimulationParameters(plant="mujoco", motor_lag=0.004, terrain=terrain, stones=3, **values)


def residual_file() -> PolicyFile:
    own = {"observation": RESIDUAL_READS, "hidden": (8, 8), "structured": False, "residual": True}
    own |= {"observation_center": (0.0,) * READS, "observation_scale": (1.0,) * READS}
    own |= {"alpha_scale": (), "beta_scale": ()}
    about, rng = policy_metadata(RL_CBF_CLF_QP, **own, adaptation="identification"), np.random.default_rng(5)
    return policy_file(about, lambda shape: 0.3 * rng.standard_normal(shape) * (len(shape) > 1))  # no biases


class Constant(ResidualPolicy):
    """Says the same always."""

    version = "constant"

    def __init__(self, said: Array) -> None:
        super().__init__()
        self._said = said

    def says(self, reads: Array) -> Array:
        return np.tile(self._said, (len(reads), 1))


def test_without_an_active_row_mu_moves_by_what_is_said() -> None:
    """|E mu + Delta - v_PD - r|^2 + w |mu|^2 is least at mu_0 + (E'E + w I)^-1 E' r; the nominal robot has E = I."""
    own, gait = parameters("flat").model_copy(update={"torque_limit": 2000.0}), load_gaits("slopes")
    simulation, compared = make_simulation(plant("flat"), gait), 0
    controller = Controller(own, gait, Constant(np.zeros(4)))
    for seed in range(20):
        state, found = simulation.reset(seed), []
        controller.policy = Constant(np.zeros(4))
        controller.reset(seed)
        controller.step(state)
        towards = -np.sign(controller.scene.LgV)  # in which V falls faster than the CLF's row asks
        for size in (0.5, 0.55):
            controller.policy = Constant(size * towards)
            controller.reset(seed)
            found.append(controller.step(state))
        if not (found[0].active or found[1].active):
            assert found[1].mu - found[0].mu == pytest.approx(SCALE * 0.05 * towards / 1.01, abs=1e-6)
            compared += 1
    assert compared >= 3


def test_no_row_of_the_programme_moves() -> None:
    """Alpha and beta of all quantities are those without it, whatever it says."""
    own, gait = parameters(), load_gaits("slopes")
    state = make_simulation(plant(mass_scale=2.0), gait).reset(3)
    estimates = []
    for said in (np.zeros(4), np.ones(4)):
        controller = Controller(own, gait, Constant(said))
        controller.reset(1)
        controller.step(state)
        estimates.append(controller.estimates)
    assert np.array_equal(estimates[0].alpha, estimates[1].alpha)
    assert np.array_equal(estimates[0].beta, estimates[1].beta)


@pytest.mark.parametrize("terrain", ["stones", "flat"])
def test_in_a_batch_it_says_to_the_bit_what_it_says_alone(terrain) -> None:
    own, gait, file = parameters(terrain), load_gaits("slopes"), residual_file()
    plants = [plant(terrain, mass_scale=scale) for scale in (1.0, 1.6)]
    policy = ResidualActor(file)
    batch = BatchSimulation([make_simulation(plant, gait) for plant in plants])
    together = BatchController(Controller(own, gait, policy), [policy] * 2)
    for robot in range(2):
        together.reset(robot, robot)
    states, torques = batch.reset([7, 8]), []
    for _ in range(60):
        torques.append(together.step(states).torque)
        states = batch.step(torques[-1])
    for robot in range(2):
        simulation, alone = make_simulation(plants[robot], gait), Controller(own, gait, ResidualActor(file))
        alone.reset(robot)
        state = simulation.reset(7 + robot)
        for tick in range(60):
            torque = alone.step(state).torque
            assert np.array_equal(torque, torques[tick][robot])
            state = simulation.step(torque)


def test_a_file_is_read_back_and_fits_the_centred_objective_alone() -> None:
    file, gait = decode(residual_file().encode()), load_gaits("slopes")
    assert isinstance(fitted(file, parameters(), gait), ResidualActor)
    assert isinstance(fitted(file, parameters("flat"), gait), ResidualActor)
    with pytest.raises(PolicyFileError, match="it moves the centre of pd_centred"):
        fitted(file, load_parameters("best", objective="paper"), gait)
    with pytest.raises(PolicyFileError, match="trained with adaptation identification"):
        fitted(file, load_parameters("ours", controller="rl-cbf-clf-qp", objective="pd_centred"), gait)

"""A policy within the step: it moves the objective's centre by what it says, and no row; alone as in a batch."""

import numpy as np
import pytest
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array
from rabbit_experiments.assembly import make_simulation
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.residual_policy import READS, SCALE, ResidualActor, ResidualPolicy
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import RESIDUAL_READS, PolicyFile, PolicyFileError, decode
from untrained_policy import policy_file, policy_metadata

HIDDEN = 8


def parameters(terrain: str = "stones") -> ControllerParameters:
    kind = "rl-cbf-clf-qp" if terrain == "stones" else "rl-clf-qp"
    return load_parameters("best", controller=kind, qp_solver="daqp")


def plant(terrain: str = "stones", **values) -> SimulationParameters:
    return SimulationParameters(plant="mujoco", motor_lag=0.004, terrain=terrain, stones=3, **values)


def residual_file() -> PolicyFile:
    own = {"observation": RESIDUAL_READS, "hidden": (HIDDEN, HIDDEN), "structured": False, "residual": True}
    own |= {
        "observation_center": (0.0,) * READS,
        "observation_scale": (1.0,) * READS,
        "alpha_scale": (),
        "beta_scale": (),
    }
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
    batch = BatchSimulation([make_simulation(each, gait) for each in plants])
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

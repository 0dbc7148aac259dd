"""Joint targets: PD on the reference, and what a network reads, of one robot and of N."""

import numpy as np
import pytest
from rabbit_description.gait import load_gaits
from rabbit_description.state import SWAP_TORQUE, Leg
from rabbit_rivals.joint_targets import (
    KD,
    KP,
    JointTargetController,
    Memory,
    NetworkAbout,
    NetworkPolicy,
    command,
    observe,
    reference_alone,
)
from rabbit_rivals.methods import PD
from rabbit_rivals.model_file import ModelFile
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller

GAITS = load_gaits("paper_stones")


def some_network(seed: int = 1) -> NetworkPolicy:
    about = NetworkAbout(learner="none", hidden=(16, 16), ticks=0, hours=0.0, seed=seed, command="")
    rng = np.random.default_rng(seed)
    arrays = {name: (0.03 * rng.standard_normal(shape)).astype(np.float32) for name, shape in about.shapes.items()}
    return NetworkPolicy(ModelFile(about, arrays))


def controller(terrain: str, policy: NetworkPolicy) -> JointTargetController:
    return JointTargetController(PD.on(terrain).assembly().controller, GAITS, policy)


def test_without_an_action_it_is_pd_on_the_outputs() -> None:
    own = controller("flat", reference_alone())
    simulation = Simulation(SimulationParameters(plant="rigid", terrain="flat"), GAITS)
    state = simulation.reset(1)
    own.reset(1)
    legs = set()
    while state.running and state.touchdowns < 2:
        output = own.step(state)
        wanted = np.clip(-KP * output.eta[:4] - KD * output.eta[4:], -200, 200)
        legs.add(output.stance)
        assert output.torque == pytest.approx(wanted if output.stance is Leg.LEFT else wanted[SWAP_TORQUE])
        state = simulation.step(output.torque)
    assert legs == {Leg.LEFT, Leg.RIGHT}


@pytest.mark.parametrize("terrain", ["stones", "flat"])
def test_n_robots_walk_as_each_walks_alone_to_the_bit(terrain: str) -> None:
    course = {"plant": "mujoco", "terrain": terrain, "motor_lag": 0.004}
    wide = {"stone_width": 0.25, "l_min_mean": 0.2} if terrain == "stones" else {}
    changes = ({}, {"mass_scale": 1.5}, {"velocity_noise": 0.02}, {"torque_rate": 40000.0}, {"coulomb": 1.0})
    plants = [SimulationParameters.model_validate(course | wide | each) for each in changes]
    policy = some_network()
    alone = []
    for seed, plant in enumerate(plants):
        simulation, own, torques = Simulation(plant, GAITS), controller(terrain, policy), []
        state = simulation.reset(seed)
        own.reset(seed)
        while state.running and len(torques) < 60:
            output = own.step(state)
            torques.append(output.torque)
            state = simulation.step(output.torque)
        alone.append(torques)
    ticks, legs = min(map(len, alone)), set()

    parameters = PD.on(terrain).assembly().controller
    batch = BatchSimulation([Simulation(plant, GAITS) for plant in plants])
    together = BatchController(Controller(parameters, GAITS, policy), [policy] * len(plants))
    states, memory = batch.reset(range(len(plants))), Memory.of(len(plants))
    for seed in range(len(plants)):
        together.reset(seed, seed)
    for tick in range(ticks):
        scene = together.look(states)
        legs |= set(scene.stance.tolist())
        torque = command(memory, scene, policy.act(observe(memory, scene))).clip(-200, 200)
        torque = np.where(scene.stance[:, None], torque[:, SWAP_TORQUE], torque)
        assert np.array_equal(torque, [torques[tick] for torques in alone])
        states = batch.step(torque)
    assert legs == {Leg.LEFT, Leg.RIGHT}

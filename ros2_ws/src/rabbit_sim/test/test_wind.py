"""Wind against mechanics and the statistics of its gusts."""

import numpy as np
import pytest
from rabbit_description.gait import load_gait
from rabbit_description.state import TICK_SECONDS
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbation import Memory
from rabbit_sim.perturbations.wind import Wind
from rabbit_sim.plant import SUBSTEPS
from rabbit_sim.simulation import Simulation

GAIT = load_gait("authors_035")


def forces(seed, ticks, **changes):
    """In each tick, N, each held over its substeps."""
    wind, memory = Wind(**changes), Memory(rng=np.random.default_rng(seed), parameters=SimulationParameters())
    wind.begin(memory)
    found = np.array([wind.force(memory, tick) for tick in range(ticks)])
    assert found.shape == (ticks, SUBSTEPS)
    assert (found == found[:, :1]).all()
    return found[:, 0]


@pytest.mark.parametrize("plant", ["pybullet", "mujoco"])
@pytest.mark.parametrize("wind", [40.0, -15.0])
def test_wind_gives_a_falling_robot_its_impulse(plant, wind, truth, random_state):
    """Momentum is force times time along the ground; nothing else acts there."""
    parameters = SimulationParameters(plant=plant, wind=wind, stop_at_miss=False, fall_height=0, fall_pitch=3.0)
    robot, simulation = truth(), Simulation(parameters, GAIT)
    simulation.reset(1)
    q, _ = random_state(4)
    simulation.plant.reset(q, np.zeros(7), 0)
    for _ in range(5):
        simulation.step(np.zeros(4))
    after = simulation.reading
    assert robot.momentum(after.q, after.dq)[0] == pytest.approx(wind * 5 * TICK_SECONDS, rel=2e-3)
    simulation.close()


def test_gusts_have_their_spread_and_their_time_constant():
    """Mean, standard deviation and the correlation exp(-t / T) of a Gauss-Markov process from its first tick on."""
    many = np.array([forces(seed, 60, wind=20.0, gusts=8.0, gust_seconds=0.2) for seed in range(3000)])
    np.testing.assert_allclose(many.mean(axis=0), 20.0, atol=5 * 8 / np.sqrt(3000))
    np.testing.assert_allclose(many.std(axis=0), 8.0, rtol=0.07)
    for lag in (1, 20, 50):
        correlation = np.corrcoef(many[:, 5], many[:, 5 + lag])[0, 1]
        assert correlation == pytest.approx(np.exp(-lag * TICK_SECONDS / 0.2), abs=0.08)


def test_robots_in_a_batch_feel_the_wind_that_they_feel_alone():
    """To the bit, also beside a calm one."""
    changes = [{"wind": 25.0}, {}, {"wind": -10.0, "gusts": 15.0, "push": 5.0, "push_interval": 0.1}]
    alone, own = (
        [Simulation(SimulationParameters(plant="mujoco", **each), GAIT) for each in changes] for _ in range(2)
    )
    batch = BatchSimulation(own)
    states = batch.reset([1, 2, 3])
    expected = [simulation.reset(seed) for simulation, seed in zip(alone, (1, 2, 3), strict=True)]
    torque = np.array([3.0, -5.0, 2.0, 4.0])
    for _ in range(12):
        states = batch.step(np.tile(torque, (3, 1)))
        expected = [simulation.step(torque) for simulation in alone]
        assert (states.q == [each.q for each in expected]).all()
        assert (states.dq == [each.dq for each in expected]).all()
    assert len({each.q[0] for each in expected}) == 3
    for simulation in (*alone, *own):
        simulation.close()

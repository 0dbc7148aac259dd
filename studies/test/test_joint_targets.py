"""Joint targets: PD on the reference, and the environment that a learner sees."""

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from rabbit_description.gait import load_gaits
from rabbit_description.state import SWAP_TORQUE, Leg
from rabbit_rivals.joint_target_env import WIDTHS, JointTargetEnv, walking_parameters
from rabbit_rivals.joint_targets import KD, KP, REACH, JointTargetController, reference_alone
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation

PLANT = {"plant": "rigid", "mass_scale": 2.0, "motor_lag": 0.0}


def test_without_an_action_it_is_pd_on_the_outputs() -> None:
    controller = JointTargetController(walking_parameters("flat"), load_gaits("paper_stones"), reference_alone())
    simulation = Simulation(SimulationParameters(plant="rigid", terrain="flat"), load_gaits("paper_stones"))
    state = simulation.reset(1)
    controller.reset(1)
    legs = set()
    while state.running and state.touchdowns < 2:
        output = controller.step(state)
        wanted = np.clip(-KP * output.eta[:4] - KD * output.eta[4:], -200, 200)
        legs.add(output.stance)
        assert output.torque == pytest.approx(wanted if output.stance is Leg.LEFT else wanted[SWAP_TORQUE])
        state = simulation.step(output.torque)
    assert legs == {Leg.LEFT, Leg.RIGHT}


def test_an_action_moves_the_targets() -> None:
    controller = JointTargetController(walking_parameters("flat"), load_gaits("paper_stones"), reference_alone())
    simulation = Simulation(SimulationParameters(plant="rigid", terrain="flat"), load_gaits("paper_stones"))
    controller.reset(1)
    controller.observe(simulation.reset(1))
    action = np.array([1.0, -0.5, 0.25, 0.0])
    assert controller.command(action) - controller.command(np.zeros(4)) == pytest.approx(KP * REACH * action)


def test_the_environment_is_one_of_gymnasium_and_repeats_itself() -> None:
    env = JointTargetEnv(**PLANT)
    check_env(env, skip_render_check=True)

    def walk() -> list[float]:
        env.reset(seed=3)
        return [env.step(np.full(4, 0.1, np.float32))[1] for _ in range(30)]

    assert walk() == walk()


def test_stones_get_narrower_around_the_same_middle() -> None:
    for level, width in enumerate(WIDTHS):
        env = JointTargetEnv(level, l_min_std=0.0, **PLANT)
        seed = 0
        env.reset(seed=seed)
        while env.unwrapped._state.preview is None:  # one walk in four is on flat ground
            seed += 1
            env.reset(seed=seed)
        stone = env.unwrapped._state.preview
        assert stone.l_max - stone.l_min == pytest.approx(width)
        assert (stone.l_max + stone.l_min) / 2 == pytest.approx(0.375)


def test_a_fall_costs_one_and_ends_the_walk() -> None:
    env = JointTargetEnv(**PLANT)
    env.reset(seed=1)
    ended, reward = False, 0.0
    while not ended:
        _, reward, ended, truncated, _ = env.step(np.array([1.0, 1.0, -1.0, 1.0], np.float32))
        assert not truncated
    assert reward < -0.9

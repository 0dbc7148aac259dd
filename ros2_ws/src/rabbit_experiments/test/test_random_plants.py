"""Robots drawn at random to train on."""

import numpy as np
import pytest
from rabbit_description.gait import DEFAULT_GAIT, load_gait
from rabbit_experiments.random_plants import BEND, DAMPING, LOSS, PAYLOAD, SCALES, RandomPlants, random_plant
from rabbit_sim.parameters import SimulationParameters

PLANT = SimulationParameters(mass_scale=2.0, stones=3)


def test_every_robot_is_within_the_ranges_and_no_two_are_alike() -> None:
    plants = [random_plant(PLANT, seed) for seed in range(200)]
    assert len(set(plants)) == len(plants)
    for plant in plants:
        assert SCALES[0] <= plant.mass_scale <= SCALES[1]
        assert 0 <= plant.payload <= PAYLOAD
        assert plant.mass_scale == 1 or plant.payload == 0
        assert (plant.motor_loss, plant.joint_damping, abs(plant.link_bend)) <= (LOSS, DAMPING, BEND)
        SimulationParameters.model_validate(plant.model_dump())
    assert min(plant.mass_scale for plant in plants) < 0.7
    assert max(plant.payload for plant in plants) > 60
    assert any(plant.link_bend == 0 for plant in plants)


def test_the_seed_decides_the_robot_and_the_rest_stays() -> None:
    assert random_plant(PLANT, 3) == random_plant(PLANT, 3)
    assert random_plant(PLANT, 3).stones == PLANT.stones


def test_a_reset_makes_another_robot() -> None:
    plants = RandomPlants(PLANT, load_gait(DEFAULT_GAIT))
    with pytest.raises(RuntimeError, match="expected a reset"):
        plants.step([0.0] * 4)
    first, second, again = plants.reset(1), plants.reset(2), plants.reset(1)
    plants.close()
    assert (first.q == again.q).all()
    assert (first.q != second.q).any()


def test_with_a_labs_sensors_each_robot_has_an_estimator() -> None:
    plants = RandomPlants(PLANT.model_copy(update={"sensors": "lab"}), load_gait(DEFAULT_GAIT))
    states = [plants.reset(1), plants.step([0.0] * 4), plants.reset(2)]
    plants.close()
    assert all(np.isfinite([*state.q, *state.dq]).all() for state in states)

"""Walks over the plants of the training: as a robot walks with the file; how episodes end and begin; which plants."""

from typing import Any

import numpy as np
import pytest
from rabbit_benchmark.cells import storm
from rabbit_benchmark.families import families
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array, Leg
from rabbit_experiments.assembly import make_simulation
from rabbit_rivals.end_to_end import JointTargets
from rabbit_rivals.joint_targets import READS, JointTargetController, NetworkAbout, NetworkPolicy
from rabbit_rivals.model_file import ModelFile
from rabbit_rivals.over_plants import KNOWN, over_plants
from rabbit_rivals.plants import draw_plant
from rabbit_rivals.residual import Residuals
from rabbit_rivals.vec_env import SideBySide
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller import residual_policy
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.network import Actor
from rl_cbf_clf_controller.weights import layer_shapes
from rl_trainer.rollout import Record, rollout

CHANGES = {}, {"mass_scale": 2.0}, {"velocity_noise": 0.02}, {"coulomb": 1.0}
PLANTS = [
    SimulationParameters(plant="mujoco", terrain="flat", stones=2, motor_lag=0.004, **changes) for changes in CHANGES
]


class Same(residual_policy.ResidualPolicy):
    """Says what a network says."""

    version = "same"

    def __init__(self, actor: Actor) -> None:
        super().__init__()
        self._actor = actor

    def says(self, reads: Array) -> Array:
        return self._actor(reads)


@pytest.mark.parametrize(("kind", "reads"), [(JointTargets, READS), (Residuals, residual_policy.READS)])
def test_robots_walk_side_by_side_as_each_walks_alone_with_the_file(kind: Any, reads: int) -> None:
    """But for the single precision of what a learner reads."""
    rng, shapes = np.random.default_rng(1), layer_shapes(reads, 8, 8, 4)
    arrays = {name: 0.03 * rng.standard_normal(shape).astype(np.float32) for name, shape in shapes.items()}
    robots, actor = kind("flat", len(PLANTS)), Actor(arrays)
    parameters = robots.controller.parameters
    gaits = load_gaits(parameters.gait)
    about = NetworkAbout(learner="none", hidden=(8, 8), ticks=0, hours=0.0, seed=0, command="")
    controller = (
        JointTargetController(parameters, gaits, NetworkPolicy(ModelFile(about, arrays)))
        if kind is JointTargets
        else Controller(parameters, gaits, Same(actor))
    )
    seeds: list[int] = []
    robots._plant = lambda seed: seeds.append(seed) or PLANTS[(len(seeds) - 1) % len(PLANTS)]
    observed, _ = robots.reset(seed=3)
    alone = [list[Record]() for _ in PLANTS]
    for plant, seed, records in zip(PLANTS, seeds, alone, strict=True):
        rollout(make_simulation(plant, gaits), controller, seed, records.append)
    last = min(map(len, alone)) - 1
    assert {record.output.stance for record in alone[0][:last]} == {Leg.LEFT, Leg.RIGHT}
    for tick in range(last + 1):
        np.testing.assert_allclose(robots.states.q, [records[tick].state.q for records in alone], atol=1e-3)
        observed, _, failed, cut, _ = robots.step(actor(observed[:, :reads]))
        assert (failed | cut).tolist() == [tick == len(records) - 1 for records in alone]


def walked(robots: SideBySide, seed: int, action: float, ticks: int) -> list[tuple[Any, ...]]:
    """What came of so many ticks of one action."""
    robots.seed(seed)
    steps: list[tuple[Any, ...]] = [(robots.reset(),)]
    for _ in range(ticks):
        robots.step_async(np.full((robots.num_envs, 4), action, dtype=np.float32))
        steps.append(robots.step_wait())
    return steps


def test_the_same_seed_gives_the_same_transitions_and_another_seed_other_ones() -> None:
    robots = over_plants(JointTargets, 4, 0.5)
    assert robots.observation_space.shape == (READS + KNOWN,)
    one, same, other = (walked(robots, seed, 0.2, 80) for seed in (1, 1, 2))
    assert any(step[2].any() for step in one[1:])  # episodes ended, and others began
    for first, second in zip(one, same, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(first[:3], second[:3], strict=True))
    assert not np.array_equal(one[0][0], other[0][0])


@pytest.mark.parametrize(("action", "has_walked"), [(0.0, True), (-1.0, False)])
def test_a_course_walked_is_a_time_limit_and_a_fall_is_not(action: float, has_walked: bool) -> None:
    """The next episode begins in the same step, from another first state."""
    course = SimulationParameters(plant="mujoco", terrain="flat", stones=2)
    walking = JointTargets("flat", 2)
    walking._plant, robots = lambda seed: course, SideBySide([walking])
    last = first = walked(robots, 1, action, 0)[0][0]
    for _ in range(200):
        robots.step_async(np.full((2, 4), action, dtype=np.float32))
        observed, reward, done, infos = robots.step_wait()
        if done[0]:
            break
        last = observed
    assert infos[0]["TimeLimit.truncated"] is has_walked
    assert np.array_equal(infos[0]["terminal_observation"], last[0])
    assert reward[0] > 0.9 if has_walked else reward[0] < -0.9
    begun = observed[0][:READS].reshape(10, -1)
    assert (begun == begun[0]).all()  # as if it had always stood there
    assert not np.array_equal(begun, first[0][:READS].reshape(10, -1))


@pytest.mark.parametrize("terrain", ["stones", "flat"])
def test_plants_of_the_training_are_of_development_families_alone(terrain) -> None:
    others = {
        name
        for family in families().families.values()
        if family.split != "development"
        for name in family.on(terrain) or {}
    } - storm().on(terrain).keys()
    development = {"torque_rate", "dead_zone", "sensor_dropout"} | ({"loose_stone"} if terrain == "stones" else set())
    seen: set[str] = set()
    for seed in range(300):
        drawn = draw_plant(terrain, np.random.default_rng(seed), 5).model_dump(exclude_defaults=True)
        assert not others & drawn.keys()
        seen |= drawn.keys()
    assert development <= seen

"""A walk in a batch is the walk alone, to the bit: MuJoCo, controller, policy, sensors, tally, environment."""

import gc
import math
import weakref
from dataclasses import replace
from itertools import product
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from rabbit_description.gait import load_gaits
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import StonePreview
from rabbit_experiments.assembly import Assembly, make_simulation, resolve_policy
from rabbit_experiments.evaluation import forget_parts, walk, walk_together
from rabbit_experiments.registered import make_vector
from rabbit_experiments.vector_environment import LearnerUnits, VectorWalkingEnv
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Outcome
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.scene import ControllerError
from rl_cbf_clf_controller.uncertainty import PAPER
from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import reward
from rl_trainer.rollout import Record, rollout

TIMES = {"tick_ms_p50", "tick_ms_p99", "plant_ms_p50", "walk_seconds"}
PLANTS: list[dict[str, Any]] = [
    {"mass_scale": 2.0},
    {"mass_scale": 0.5},  # soon falls
    {"mass_scale": 1.5, "ground_friction": 0.7, "friction_spread": 0.2, "stone_width": 0.04},
    {"payload": 20.0, "slope": 1.0, "torque_delay": 0.004},
    {"mass_scale": 1.2, "stone_height": 0.02, "torque_rate": 15e3},
    {"mass_scale": 1.8, "velocity_noise": 0.02, "force_noise": 5.0},
    {"mass_scale": 2.0, "sensors": "lab"},
    {"mass_scale": 2.0, "joint_damping": 1.0, "backlash": 0.2, "command_dropout": 0.1},
    {"mass_scale": 2.0, "push": 5.0, "push_interval": 0.2},
    {"swing_payload": 3.0, "sliding_payload": 2.0, "loose_stone": 1, "wind": 25.0, "gusts": 15.0},
]
SEEDS = range(71, 71 + len(PLANTS))


def assemblies(name: str = "ours", plants: list[dict[str, Any]] = PLANTS, **tuning: Any) -> list[Assembly]:
    """The same controller on each plant."""
    controller = load_parameters(name, **tuning)
    policy = resolve_policy(None, controller)
    shared = {"plant": "mujoco", "motor_lag": 0.004, "stones": 3, "terrain": controller.terrain}
    on_flat = {} if controller.terrain == "stones" else {"stone_height": 0.0, "loose_stone": 0}
    return [Assembly(SimulationParameters(**{**shared, **plant, **on_flat}), controller, policy) for plant in plants]


def alone(assembly: Assembly, seed: int) -> tuple[list[Record], Outcome]:
    """Its ticks, and how it ended."""
    ticks: list[Record] = []
    simulation, controller = assembly.build()
    rollout(simulation, controller, seed, ticks.append)
    return ticks, simulation.outcome


def assert_same(one: Any, other: Any, but: set[str]) -> None:
    for name in one.__dataclass_fields__.keys() - but:
        mine, theirs = getattr(one, name), getattr(other, name)
        same = mine == theirs
        if isinstance(mine, np.ndarray):
            same = np.array_equal(mine, theirs, equal_nan=True)
            same = same and np.array_equal(np.signbit(mine)[mine == 0], np.signbit(theirs)[theirs == 0])
        assert same or (isinstance(mine, float) and mine != mine), f"{name}: {mine} alone, {theirs} in the batch"


@pytest.mark.parametrize(
    ("name", "tuning", "plants"),
    [
        ("ours", {"controller": "rl-cbf-clf-qp", "qp_solver": "daqp"}, PLANTS),
        ("ours", {"controller": "rl-cbf-clf-qp", "qp_solver": "osqp"}, PLANTS[:3]),
        ("ours", {"controller": "rl-cbf-clf-qp", "qp_solver": "daqp", "sigma": 5.0}, PLANTS[:3]),
        ("best", {"qp_solver": "daqp"}, PLANTS[:7]),
        ("ours", {"controller": "l1-clf-qp", "qp_solver": "daqp"}, PLANTS[:3]),
        ("ours", {"controller": "robust-cbf-clf-qp", "qp_solver": "daqp"}, PLANTS[:2]),
    ],
    ids=["paper", "osqp", "exploring", "best", "l1", "robust"],
)
def test_every_tick_is_that_of_the_walk_alone(name: str, tuning: dict[str, Any], plants: list[dict[str, Any]]) -> None:
    made = assemblies(name, plants, **tuning)
    walks = [alone(assembly, seed) for assembly, seed in zip(made, SEEDS, strict=False)]
    lengths = {len(ticks) for ticks, _ in walks}
    assert len(lengths) > 1  # some end earlier
    gait = load_gaits(made[0].controller.gait)
    simulation = BatchSimulation([make_simulation(assembly.simulation, gait) for assembly in made])
    policies: list[Policy] = [made[0].make_policy()] * len(made)
    controller = BatchController(Controller(made[0].controller, gait, policies[0]), policies)
    states = simulation.reset(list(SEEDS[: len(made)]))
    for i in range(len(made)):
        controller.reset(i, SEEDS[i])
    left, tick = list(range(len(made))), 0
    while left:
        output = controller.step(states)
        for row, i in enumerate(left):
            expected = walks[i][0][tick]
            assert_same(expected.state, states[row], but={"sensors"})
            assert_same(expected.output, output[row], but={"solve_seconds"})
        faulty = set(output.scene.faults)
        states, tick = simulation.step(output.torque), tick + 1
        go_on = [row for row, i in enumerate(left) if tick < len(walks[i][0])]
        for row, i in enumerate(left):
            assert states.running[row] == (row in go_on or row in faulty)
            if not states.running[row]:
                assert simulation.simulations[row].outcome is walks[i][1]
        left = [left[row] for row in go_on]
        if left and len(go_on) != len(states):
            simulation.keep(np.array(go_on))
            controller.keep(np.array(go_on))
            states = simulation.states


def test_a_run_in_a_batch_leaves_the_row_of_the_run_alone() -> None:
    made = assemblies(plants=PLANTS[:5], controller="rl-cbf-clf-qp", qp_solver="daqp")
    together = dict(walk_together(made[0].make_controller(), made, range(5), SEEDS[:5]))
    for i, assembly in enumerate(made):
        expected = walk(assembly, i, SEEDS[i])
        rows = [result.row.model_dump(exclude=TIMES) for result in (together[i], expected)]
        assert repr(rows[0]) == repr(rows[1])  # all digits, and NaN is NaN
        assert repr(together[i].violations) == repr(expected.violations)  # the sign of zero too
        assert len(together[i].tick_seconds) == expected.row.ticks


class Knowing(Assembly):
    """A method of one's own, whose controller knows the plant."""

    def make_policy(self) -> Policy:
        return Assembly(self.simulation, self.controller, "oracle").make_policy()


KINDS = [(Assembly, "zero", "best"), (Assembly, "oracle", "ours"), (Knowing, "zero", "ours")]


@pytest.mark.parametrize(("kind", "policy", "parameters"), KINDS)
def test_a_run_that_takes_over_a_controller_leaves_the_row_of_the_run_alone(
    kind: type[Assembly], policy: str, parameters: str
) -> None:
    """Its controller comes from a run on another plant, and has its memory, policy and solver."""
    tuning = load_parameters(parameters, controller="rl-cbf-clf-qp")
    plants = [SimulationParameters(mass_scale=scale, stones=2) for scale in (2.0, 0.7, 2.0)]
    made, rows = [kind(plant, tuning, policy) for plant in plants], list[str]()
    for forgets in (True, False):
        for run, assembly in enumerate(made):
            if forgets:
                forget_parts()
            rows.append(repr(walk(assembly, run, SEEDS[run]).row.model_dump(exclude=TIMES)))
    assert rows[:3] == rows[3:]


STONE = StonePreview(1, 0.3, 0.4)
HOSTILE: dict[str, dict[str, Any]] = {
    "q NaN": {"q": np.full(7, np.nan)},
    "dq inf": {"dq": np.full(7, np.inf)},
    "dq huge": {"dq": np.full(7, 1e60)},
    "no stone": {"preview": None},
    "l_min NaN": {"preview": replace(STONE, l_min=np.nan)},
    "l_max NaN": {"preview": replace(STONE, l_max=np.nan)},
    "height NaN": {"preview": replace(STONE, height=np.nan)},
    "height inf": {"preview": replace(STONE, height=np.inf)},
    "edges swapped": {"preview": replace(STONE, l_min=0.5)},
    "another stone": {"preview": replace(STONE, index=2)},
    "touchdowns": {"touchdowns": 1},
    "force NaN": {"foot_force": np.full((2, 2), np.nan)},
    "force huge": {"foot_force": np.full((2, 2), 1e200)},
    "torque unknown": {"applied": np.array([np.nan, 1.0, 2.0, 3.0])},
    "torque huge": {"applied": np.full(4, 1e30)},
    "a tick is missing": {"tick": 40},
}


@pytest.mark.parametrize(
    ("name", "tuning"),
    [
        ("best", {"qp_solver": "daqp"}),
        ("ours", {"controller": "rl-cbf-clf-qp", "qp_solver": "osqp"}),
        ("ours", {"controller": "cbf-clf-qp", "gait": "paper_stones", "adaptation": "identification"}),
        ("ours", {"controller": "l1-clf-qp"}),
    ],
    ids=["best", "osqp", "library", "l1"],
)
def test_what_is_wrong_with_one_robot_is_its_own_error(name: str, tuning: dict[str, Any]) -> None:
    """The error's words, or the tick, are those of the controller alone; the robots beside it never notice."""
    made = assemblies(name, PLANTS[:3], **tuning)
    walks = [[tick.state for tick in alone(*run)[0]][:12] for run in zip(made, SEEDS, strict=False)]
    controllers = [assembly.make_controller() for assembly in made]
    together, refused = BatchController(made[0].make_controller(), [controllers[0].policy] * 3), set[str]()
    for at, (kind, changes) in product((0, 9), HOSTILE.items()):
        for i, controller in enumerate(controllers):
            controller.reset(i)
            together.reset(i, i)
        errors: dict[int, str] = {}
        for tick in range(12):
            states = [walk[tick] for walk in walks]
            if tick == at:
                states[1] = replace(states[1], **changes)
            output = together.step(RobotStates.of(states))
            for i in {0, 1, 2} - errors.keys():
                try:
                    assert_same(controllers[i].step(states[i]), output[i], but={"solve_seconds"})
                except (ControllerError, np.linalg.LinAlgError) as error:
                    errors[i] = f"controller error: {error}"
                    refused.add(kind)
            assert output.scene.errors.items() >= {item for item in errors.items() if tick == at}, kind
            assert output.scene.errors.keys() <= errors.keys(), kind
    assert refused >= {"q NaN", "dq inf"}


@pytest.mark.parametrize("problem", PAPER)
def test_an_action_is_the_estimates_over_their_scales(problem: Problem) -> None:
    """V's also over |LgV| + 1."""
    parameters, rng = TrainingParameters(problem=problem), np.random.default_rng(3)
    n, m, robots = parameters.n, problem.inputs, 7
    alpha, beta, LgV = (rng.standard_normal((robots, *shape)) for shape in ((n, m), (n,), (m,)))
    size = np.ones((robots, n))
    if problem.has_clf:
        size[:, 0] = 1 + np.sqrt(np.square(LgV).sum(axis=1))
    alpha_scale, beta_scale = map(np.array, parameters.scales[:2])
    actions = np.hstack([(alpha / (alpha_scale * size)[..., None]).reshape(robots, -1), beta / (beta_scale * size)])
    found = LearnerUnits(parameters).estimates(actions, LgV)
    np.testing.assert_allclose(found.alpha, alpha, rtol=1e-12)
    np.testing.assert_allclose(found.beta, beta, rtol=1e-12)


def random_plant(parameters: SimulationParameters, seed: int) -> SimulationParameters:
    """`parameters` with a mass scale or a payload, and a power loss, a damping and a bend, each as likely as not."""
    rng = np.random.default_rng([seed, 1])
    if rng.random() < 0.5:
        masses = {"mass_scale": math.exp(rng.uniform(*np.log([0.5, 3.0]))), "payload": 0.0}
    else:
        masses = {"mass_scale": 1.0, "payload": rng.uniform(0.0, 72.0)}
    others = {
        "motor_loss": rng.uniform(0, 0.15),
        "joint_damping": rng.uniform(0, 1.0),
        "link_bend": rng.uniform(-0.05, 0.05),
    }
    return parameters.model_copy(update=masses | {name: value for name, value in others.items() if rng.random() < 0.5})


@pytest.mark.parametrize("robots", [1, 2])
def test_an_environments_former_plants_are_freed(robots: int) -> None:
    """By their last reference, with no collection: an engine's memory is large."""
    tuning = load_parameters("ours", controller="rl-cbf-clf-qp", qp_solver="daqp")
    plant = SimulationParameters(plant="mujoco", stones=1)
    env = VectorWalkingEnv(TrainingParameters(), tuning, plant, robots, random_plant)
    with pytest.raises(ResetNeeded, match="expected a reset"):
        env.step(env.action_space.sample())
    env.reset(seed=5)
    first = [weakref.ref(simulation.plant) for simulation in env._batch.simulations]
    gc.collect()
    gc.disable()
    try:
        rng = np.random.default_rng(0)
        for _ in range(150):
            env.step(rng.uniform(-0.2, 0.2, env.action_space.shape).astype(np.float32))
        assert [plant() for plant in first] == [None] * robots
    finally:
        gc.enable()


def test_the_vector_environment_is_one_robot_row_by_row() -> None:
    """And its reward is that of the transition which it tells."""
    parameters = TrainingParameters(sigma=2.0)
    tuning = load_parameters("ours", controller="rl-cbf-clf-qp", qp_solver="daqp")
    plant = SimulationParameters(plant="mujoco", stones=1, sensors="lab", push=3.0, push_interval=0.2)
    many, *ones = (VectorWalkingEnv(parameters, tuning, plant, robots, random_plant) for robots in (3, 1, 1, 1))
    observed, info = many.reset(seed=5)
    assert many.observation_space.contains(observed)
    for i, one in enumerate(ones):
        alone, about = one.reset(seed=5 + i)
        assert np.array_equal(alone[0], observed[i])
        assert np.array_equal(about["next_LgV"][0], info["next_LgV"][i])
    rng, ends = np.random.default_rng(0), 0
    for _ in range(90):
        actions = rng.uniform(-0.2, 0.2, many.action_space.shape).astype(np.float32)
        observed, rewards, failed, cut, info = many.step(actions)
        for i, one in enumerate(ones):
            alone, earned, terminated, truncated, about = one.step(actions[i : i + 1])
            assert (terminated[0], truncated[0], earned[0]) == (failed[i], cut[i], rewards[i])
            assert earned[0] == reward(info["transition"][i], parameters)
            assert np.array_equal(alone[0], observed[i])
            assert np.array_equal(about["next_LgV"][0], info["next_LgV"][i])
            if terminated[0] or truncated[0]:
                ends += 1
                assert np.array_equal(about["final_obs"][0], info["final_obs"][i])
    assert ends > 1


def test_gymnasium_makes_it_by_its_name_and_finds_no_fault() -> None:
    """One robot and two walk the same course from the same seed."""
    name = "rabbit_experiments.registered:Rabbit-v0"
    one, two = gymnasium.make(name, stones=2), gymnasium.make_vec(name, num_envs=2, stones=2)
    check_env(one.unwrapped)
    observed, (rows, _) = one.reset(seed=3)[0], two.reset(seed=3)
    action = np.full(one.action_space.shape, 0.1, np.float32)
    for _ in range(100):
        np.testing.assert_array_equal(observed, rows[0])
        observed, reward, failed, cut, _ = one.step(action)
        rows, rewards, *_ = two.step(np.stack([action, 0 * action]))
        assert reward == rewards[0]
        if failed or cut:
            break
    assert failed or cut


@pytest.mark.parametrize(
    ("plant", "text"), [({"terrain": "flat"}, "expected stones"), ({"tick_seconds": 0.005}, "expected the contr")]
)
def test_gymnasium_makes_no_plant_that_its_controller_does_not_fit(plant: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        make_vector(2, **plant)


def test_what_an_episode_read_last_is_no_part_of_what_was_given_before() -> None:
    """Who changes the one does not change the other: an episode may end in its first tick."""
    env = make_vector(1, stones=1)
    before, _ = env.reset(seed=5)
    while "final_obs" not in (infos := (stepped := env.step(np.full((1, 25), np.nan)))[4]):
        before = stepped[0]
    assert np.array_equal(infos["final_obs"], before)
    assert not np.shares_memory(infos["final_obs"], before)

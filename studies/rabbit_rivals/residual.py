"""The training of the policy within the step, in a session (`session.py`)."""

from pathlib import Path
from typing import Any

from rabbit_benchmark.cells import Terrain
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array
from rabbit_experiments.provenance import commit
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.residual_policy import READS, Memory, centred, observe
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import PROBE, RESIDUAL_READS, PolicyFile, PolicyMetadata, probe_outputs

from rabbit_rivals.over_plants import OverPlants, over_plants
from rabbit_rivals.session import Done, Options, learn

STONE, FAILURE, EFFORT = 1.0, -5.0, -0.004  # rewards: a step taken; an episode's bad end; times |a|^2 of a tick
LEARNERS: dict[str, dict[str, Any]] = {
    "ppo": {"hidden": 96, "rollout": 96, "settings": {"learning_rate": 4e-4}},
    "sac": {"hidden": 256, "rollout": 32, "settings": {"learning_rate": 5e-4}},
}


class Residuals(OverPlants):
    """Under the best controller with DAQP: an action moves the centre of its objective."""

    failure = FAILURE

    def __init__(self, terrain: Terrain, robots: int) -> None:
        parameters = load_parameters("best", terrain, qp_solver="daqp")
        controller = Controller(parameters, load_gaits(parameters.gait), ZeroPolicy(parameters.problem))
        self._memory, self._quantities = Memory.of(robots), len(controller.qp.names)
        super().__init__(terrain, robots, READS, controller)

    def begin_as(self, i: int, plant: SimulationParameters, seed: int) -> None:
        """See `WalkingEnv`."""
        super().begin_as(i, plant, seed)
        self._memory.forget(i)

    def read(self) -> Array:
        """See `OverPlants`."""
        return observe(self._memory, self.scene, self.controller.identified())

    def command(self, actions: Array) -> tuple[Array, Array]:
        """See `OverPlants`."""
        self._memory.said = actions
        torque = self.controller.decide(self.scene, centred(actions, self._quantities)).torque
        return torque, EFFORT * (actions**2).sum(axis=1)

    def step_reward(self, landing: Landing) -> float:
        """See `OverPlants`."""
        return STONE


def train(options: Options, out: Path) -> Path:
    """Train, or go on; returns the policy's file. Raises `SessionError`."""
    o = options

    def write(path: Path, done: Done) -> None:
        metadata = PolicyMetadata(
            problem=RL_CBF_CLF_QP.name,
            observation=RESIDUAL_READS,
            observation_center=(0.0,) * READS,
            observation_scale=(1.0,) * READS,
            hidden=(o.hidden, o.hidden),
            structured=False,
            alpha_scale=(),
            beta_scale=(),
            residual=True,
            adaptation="identification",
            learner=o.learner,
            plant={"plant": "mujoco"},
            training_seed=o.seed,
            episodes=done.episodes,
            transitions=done.ticks,
            commit=commit(),
            command=f"rabbit residual --learner {o.learner} --ticks {done.ticks} --seed {o.seed} "
            f"--robots {o.robots} --flat {o.flat:g} --out DIR",
        )
        PolicyFile(metadata, {**done.arrays, PROBE: probe_outputs(done.arrays)}).write(path)

    return learn(o, over_plants(Residuals, o.robots, o.flat), READS, write, out)

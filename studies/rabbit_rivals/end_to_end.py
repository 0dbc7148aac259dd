"""Training end to end, in a session (`session.py`): PPO, SAC or DAgger, whose actions are joint targets.

reward    for each landing a share of one by its place on the stone; a little for each tick on the reference; less
          for torque and for changes of the action; -1 for a fall, a miss or a foot in a gap
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_benchmark.cells import Terrain
from rabbit_benchmark.methods import variants
from rabbit_description.gait import load_gaits
from rabbit_description.state import SWAP_TORQUE, TORQUE_LIMIT, Array
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchScene
from rl_cbf_clf_controller.controller import Controller

from rabbit_rivals.joint_targets import (
    ACTIONS,
    READS,
    Memory,
    NetworkAbout,
    action_for,
    command,
    observe,
    reference_alone,
)
from rabbit_rivals.methods import PD
from rabbit_rivals.model_file import ModelFile
from rabbit_rivals.over_plants import OverPlants, over_plants
from rabbit_rivals.session import Done, Options, learn

ON_TARGET, PER_TICK = 0.1, 0.02  # rad, of y; reward of a tick without error
EFFORT, CHANGE = 0.004, 0.004  # of torques at their limit; of an action changed by one
BESIDE = 0.04  # m from the middle of a stone
LEARNERS: dict[str, dict[str, Any]] = {
    "ppo": {"hidden": 128, "rollout": 128, "settings": {"learning_rate": 3e-4}},
    "sac": {"hidden": 256, "rollout": 32, "settings": {"learning_rate": 5e-4}},
    "dagger": {"hidden": 256, "rollout": 32, "settings": {"learning_rate": 5e-4}},
}
(TEACHER,) = variants("oracle:gait=paper_stones:stone_tracking=1:qp_solver=daqp")  # on the reference of joint targets


class JointTargets(OverPlants):
    """An action is joint targets, which PD follows."""

    failure = -1.0

    def __init__(self, terrain: Terrain, robots: int) -> None:
        contender = PD.on(terrain)
        assert contender
        parameters = contender.assembly().controller
        self._memory, self._limit = Memory.of(robots), parameters.torque_limit
        controller = Controller(parameters, load_gaits(parameters.gait), reference_alone())
        super().__init__(terrain, robots, READS, controller)

    def read(self) -> Array:
        """See `OverPlants`."""
        return observe(self._memory, self.scene)

    def command(self, actions: Array) -> tuple[Array, Array]:
        """See `OverPlants`."""
        scene, last = self.scene, self._memory.frames[:, -1, -ACTIONS:]
        self.controller.go_on()
        torque = command(self._memory, scene, actions).clip(-self._limit, self._limit)
        y, change = scene.seen.eta[:, :ACTIONS], self._memory.action - last
        reward = PER_TICK * np.exp(-np.square(y).mean(axis=1) / ON_TARGET**2)
        reward -= EFFORT * np.square(torque / TORQUE_LIMIT).mean(axis=1) + CHANGE * np.square(change).mean(axis=1)
        return _other_order(scene, torque), reward

    def step_reward(self, landing: Landing) -> float:
        """See `OverPlants`."""
        if self.terrain == "flat":
            return 1.0
        beside = (landing.l - (landing.l_min + landing.l_max) / 2) / BESIDE
        return 0.0 if landing.missed else 0.5 + 0.5 * float(np.exp(-(beside**2)))


class Taught(JointTargets):
    """Beside each robot walks a teacher that knows its plant, and drives a share of the episodes, `taught`.

    `infos` has as `wanted` the action that gives the teacher's torque, NaN where the teacher refuses the state.
    """

    taught = 1.0

    def __init__(self, terrain: Terrain, robots: int) -> None:
        contender = TEACHER.on(terrain)
        assert contender
        self._assembly = contender.assembly()
        controller = self._assembly.make_controller()
        self._is_taught = np.zeros(robots, dtype=bool)
        self._teacher = BatchController(controller, [controller.policy] * robots)
        super().__init__(terrain, robots)

    def begin_as(self, i: int, plant: SimulationParameters, seed: int) -> None:
        """See `WalkingEnv`."""
        super().begin_as(i, plant, seed)
        self._teacher.policies[i] = replace(self._assembly, simulation=plant).make_policy()
        self._teacher.reset(i, seed)
        self._is_taught[i] = np.random.default_rng([seed, 2]).random() < self.taught

    def read(self) -> Array:
        """See `OverPlants`."""
        taught = self._teacher.step(self.states)
        self._wanted = action_for(self.scene, _other_order(self.scene, taught.torque))
        self._wanted[[*{*taught.scene.faults, *taught.scene.errors}]] = np.nan
        return super().read()

    def command(self, actions: Array) -> tuple[Array, Array]:
        """See `OverPlants`."""
        self.infos = {"wanted": self._wanted}
        drives = self._is_taught[:, None] & np.isfinite(self._wanted)
        return super().command(np.where(drives, self._wanted, actions))


def _other_order(scene: BatchScene, torque: Array) -> Array:
    """Torques (N, 4) from stance/swing to left/right order, or back."""
    return np.where(scene.stance[:, None], torque[:, SWAP_TORQUE], torque)


def train(options: Options, out: Path) -> Path:
    """Train, or go on; returns the policy's file. Raises `SessionError`."""
    o, kind = options, Taught if options.learner == "dagger" else JointTargets

    def write(path: Path, done: Done) -> None:
        about = NetworkAbout(
            learner=o.learner,
            hidden=(o.hidden, o.hidden),
            ticks=done.ticks,
            hours=round(done.hours, 3),
            seed=o.seed,
            command=f"rabbit rival end-to-end --learner {o.learner} --ticks {done.ticks} --seed {o.seed} --out DIR",
        )
        ModelFile(about, done.arrays).write(path)

    return learn(o, over_plants(kind, o.robots, o.flat), READS, write, out)

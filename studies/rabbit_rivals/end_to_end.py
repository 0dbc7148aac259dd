"""Training end to end, in a session (`rabbit_residual.session`): PPO, SAC or DAgger, whose actions are joint targets.

reward    for each landing a share of one by its place on the stone; a little for each tick on the reference; less
          for torque and for changes of the action; -1 for a fall, a miss or a foot in a gap
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_benchmark.cells import Terrain
from rabbit_benchmark.methods import variants
from rabbit_description.gait import load_gaits
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import SWAP_TORQUE, TORQUE_LIMIT, Array
from rabbit_residual import session
from rabbit_residual.fleet import KNOWN, Command, Fleet
from rabbit_residual.ppo import Ppo, PpoParameters
from rabbit_residual.sac import Sac, SacParameters
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchScene
from rl_cbf_clf_controller.controller import Controller

from rabbit_rivals.dagger import Dagger, DaggerParameters
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

ON_TARGET, PER_TICK = 0.1, 0.02  # rad, of y; reward of a tick without error
EFFORT, CHANGE = 0.004, 0.004  # of torques at their limit; of an action changed by one
BESIDE = 0.04  # m from the middle of a stone
LEARNERS = {
    "ppo": PpoParameters(hidden=128, learning_rate=3e-4),
    "sac": SacParameters(),
    "dagger": DaggerParameters(),
}
ROLLOUT = {"ppo": 128, "sac": 32, "dagger": 32}  # ticks of each robot
(TEACHER,) = variants("oracle:gait=paper_stones:stone_tracking=1:qp_solver=daqp")  # on the reference of joint targets


class JointTargetFleet(Fleet):
    """Under PD about joint targets."""

    failure = -1.0

    def __init__(self, terrain: Terrain, robots: int, act: session.Act, seed: list[int]) -> None:
        contender = PD.on(terrain)
        assert contender
        parameters = contender.assembly().controller
        self._act, self._memory, self._limit = act, Memory.of(robots), parameters.torque_limit
        controller = Controller(parameters, load_gaits(parameters.gait), reference_alone())
        super().__init__(terrain, robots, controller, seed)

    def command(self, states: RobotStates) -> Command:
        """See `Fleet`."""
        scene = self.controller.look(states)
        reads = observe(self._memory, scene)
        said = self.says(states, scene, reads)
        torque = command(self._memory, scene, said).clip(-self._limit, self._limit)
        y, change = scene.seen.eta[:, :ACTIONS], self._memory.action - reads[:, -ACTIONS:]
        reward = PER_TICK * np.exp(-np.square(y).mean(axis=1) / ON_TARGET**2)
        reward -= EFFORT * np.square(torque / TORQUE_LIMIT).mean(axis=1) + CHANGE * np.square(change).mean(axis=1)
        return Command(scene, reads, said, _other_order(scene, torque), reward)

    def says(self, states: RobotStates, scene: BatchScene, reads: Array) -> Array:
        """The actions (N, 4)."""
        return self._act(reads)

    def step_reward(self, simulation: Simulation) -> float:
        """See `Fleet`."""
        landing = simulation.landings[-1]
        if self.terrain == "flat":
            return 1.0
        beside = (landing.l - (landing.l_min + landing.l_max) / 2) / BESIDE
        return 0.0 if landing.missed else 0.5 + 0.5 * float(np.exp(-(beside**2)))


class TaughtFleet(JointTargetFleet):
    """Beside each robot walks a teacher that knows its plant, and drives a share of the episodes, `student.taught`.

    What a tick `said` is the action that gives the teacher's torque, NaN where the teacher refuses the state.
    """

    def __init__(self, student: Dagger, terrain: Terrain, robots: int, act: session.Act, seed: list[int]) -> None:
        contender = TEACHER.on(terrain)
        assert contender
        self._assembly = contender.assembly()
        controller = self._assembly.make_controller()
        self._student, self._is_taught = student, np.zeros(robots, dtype=bool)
        self._teacher = BatchController(controller, [controller.policy] * robots)
        super().__init__(terrain, robots, act, seed)

    def begin(self, robot: int, plant: Simulation, episode: int) -> None:
        """See `Fleet`."""
        super().begin(robot, plant, episode)
        self._teacher.policies[robot] = replace(self._assembly, simulation=plant.parameters).make_policy()
        self._teacher.reset(robot, episode)
        self._is_taught[robot] = self._rng.random() < self._student.taught

    def command(self, states: RobotStates) -> Command:
        """See `Fleet`."""
        return replace(super().command(states), said=self._wanted)

    def says(self, states: RobotStates, scene: BatchScene, reads: Array) -> Array:
        """The student's, or those that give the teacher's torque."""
        taught = self._teacher.step(states)
        self._wanted = action_for(scene, _other_order(scene, taught.torque))
        self._wanted[list({*taught.scene.faults, *taught.scene.errors})] = np.nan
        drives = self._is_taught[:, None] & np.isfinite(self._wanted)
        return np.where(drives, self._wanted, self._act(reads))


def _other_order(scene: BatchScene, torque: Array) -> Array:
    """Torques (N, 4) from stance/swing to left/right order, or back."""
    return np.where(scene.stance[:, None], torque[:, SWAP_TORQUE], torque)


class Options(session.Options):
    """A session."""

    learner: PpoParameters | SacParameters | DaggerParameters


def options(name: str, **given: Any) -> Options:
    """Of a session of `ppo`, `sac` or `dagger`."""
    return Options.model_validate({"learner": LEARNERS[name], "rollout": ROLLOUT[name], **given})


def _learner(o: Options) -> Ppo | Sac | Dagger:
    if isinstance(o.learner, DaggerParameters):
        return Dagger(READS, ACTIONS, o.learner, o.seed)
    if isinstance(o.learner, SacParameters):
        return Sac(READS, KNOWN, ACTIONS, o.learner, o.seed)
    return Ppo(READS, KNOWN, ACTIONS, o.learner, o.seed)


def train(options: Options, out: Path, tell: Callable[[str], None] = print) -> Path:
    """Train, or go on; returns the policy's file. Raises `SessionError`."""
    o, learner = options, _learner(options)
    fleet: Callable[..., Fleet] = partial(TaughtFleet, learner) if isinstance(learner, Dagger) else JointTargetFleet

    def write(path: Path, done: session.Done) -> None:
        name = type(learner).__name__.lower()
        about = NetworkAbout(
            learner=name,
            hidden=(o.learner.hidden, o.learner.hidden),
            ticks=done["ticks"],
            hours=round(done["hours"], 3),
            seed=o.seed,
            command=f"rabbit rival end-to-end --learner {name} --ticks {done['ticks']} --seed {o.seed} --out DIR",
        )
        ModelFile(about, learner.arrays()).write(path)

    return session.learn(options, learner, fleet, write, out, tell)

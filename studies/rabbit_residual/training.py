"""The training of the policy within the step, in a session (`session.py`)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rabbit_benchmark.cells import Terrain
from rabbit_description.gait import load_gaits
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import JOINTS, Array
from rabbit_experiments.provenance import commit
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.residual_policy import READS, ResidualPolicy
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import PROBE, RESIDUAL_READS, PolicyFile, PolicyMetadata, probe_outputs

from rabbit_residual import session
from rabbit_residual.fleet import KNOWN, Command, Fleet
from rabbit_residual.ppo import Ppo, PpoParameters
from rabbit_residual.sac import Sac, SacParameters

STONE, FAILURE, EFFORT = 1.0, -5.0, -0.004  # rewards: a step taken; an episode's bad end; times |a|^2 of a tick
LEARNERS = {"ppo": PpoParameters(), "sac": SacParameters()}
ROLLOUT = {"ppo": 96, "sac": 32}  # ticks of each robot


class Options(session.Options):
    """A session."""

    learner: PpoParameters | SacParameters


def options(name: str, **given: Any) -> Options:
    """Of a session of `ppo` or `sac`."""
    return Options.model_validate({"learner": LEARNERS[name], "rollout": ROLLOUT[name], **given})


class Exploring(ResidualPolicy):
    """What `act` says, cut to [-1, 1]; `reads` and `said`: of the last tick, not cut."""

    version = "exploring"

    def __init__(self, act: session.Act) -> None:
        super().__init__()
        self._act = act

    def says(self, reads: Array) -> Array:
        """See `ResidualPolicy`."""
        self.reads, self.said = reads, self._act(reads)
        return self.said.clip(-1, 1)


class ResidualFleet(Fleet):
    """Under the best controller with DAQP."""

    failure = FAILURE

    def __init__(self, terrain: Terrain, robots: int, act: session.Act, seed: list[int]) -> None:
        parameters = load_parameters("best", terrain, qp_solver="daqp")
        self._policy = Exploring(act)
        super().__init__(terrain, robots, Controller(parameters, load_gaits(parameters.gait), self._policy), seed)

    def command(self, states: RobotStates) -> Command:
        """See `Fleet`."""
        output, policy = self.controller.step(states), self._policy
        effort = (policy.said.clip(-1, 1) ** 2).sum(axis=1)
        return Command(output.scene, policy.reads, policy.said, output.torque, EFFORT * effort)

    def step_reward(self, simulation: Simulation) -> float:
        """See `Fleet`."""
        return STONE


def train(options: Options, out: Path, tell: Callable[[str], None] = print) -> Path:
    """Train, or go on; returns the policy's file. Raises `SessionError`."""
    p, sizes = options.learner, (READS, KNOWN, JOINTS)
    learner: Ppo | Sac = Sac(*sizes, p, options.seed) if isinstance(p, SacParameters) else Ppo(*sizes, p, options.seed)
    name = type(learner).__name__.lower()

    def write(path: Path, done: session.Done) -> None:
        arrays = learner.arrays()
        metadata = PolicyMetadata(
            problem=RL_CBF_CLF_QP.name,
            observation=RESIDUAL_READS,
            observation_center=(0.0,) * READS,
            observation_scale=(1.0,) * READS,
            hidden=(p.hidden, p.hidden),
            structured=False,
            alpha_scale=(),
            beta_scale=(),
            residual=True,
            adaptation="identification",
            learner=name,
            plant={"plant": "mujoco"},
            training_seed=options.seed,
            episodes=done["episodes"],
            transitions=done["ticks"],
            commit=commit(),
            command=f"rabbit residual --learner {name} --ticks {done['ticks']} --seed {options.seed} "
            f"--robots {options.robots} --flat {options.flat:g} --out DIR",
        )
        PolicyFile(metadata, {**arrays, PROBE: probe_outputs(arrays)}).write(path)

    return session.learn(options, learner, ResidualFleet, write, out, tell)

"""End-to-end control: a network commands joint targets, which PD follows. No model, no QP, no estimate.

The residual form. The gait gives the reference q_d(phase), the action moves the target away from it, and

    torque = KP (q_d + REACH action - q) + KD (q_d' - q') = KP (REACH action - y) - KD y'

with y = q - q_d, the outputs. Which leg stands, and the path of a step onto the stone that is seen, are the walking
controller's own. An action (4,) in [-1, 1] has the order stance hip, stance knee, swing hip, swing knee.

The network reads the last `FRAMES` ticks, from which a robot can be told: its masses, its motors.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.estimates import Estimates
from pydantic import Field
from rabbit_description.state import SWAP_TORQUE, Array, Leg, RobotState
from rl_cbf_clf_controller.batch_output import BatchScene
from rl_cbf_clf_controller.controller import Controller, checked, sound
from rl_cbf_clf_controller.controller_output import ControllerOutput, seen_fields
from rl_cbf_clf_controller.network import Actor
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.uncertainty import UNITS
from rl_cbf_clf_controller.weights import layer_shapes

from rabbit_rivals.model_file import About, ModelFile, read

KP, KD = 600.0, 30.0  # N m/rad, N m s/rad; with them alone the robot walks on flat ground at mass scales 1 and 2
REACH = 0.3  # rad; KP REACH is nearly the motors' limit of 200 N m
ACTIONS = 4
FEATURES, FRAMES = 26, 10
READS = FRAMES * FEATURES
NORMAL_FORCE = 300.0  # N
STONE, EDGE = 0.375, 0.05  # m
BOUND = 5.0  # of each number of a frame
NEVER = -2  # no tick
_CENTER, _SCALE = np.array([unit[1:] for unit in UNITS[:14]]).T


class NetworkAbout(About):
    """An actor from what is read to actions, and how it was trained."""

    learner: str
    hidden: tuple[int, int]
    ticks: int = Field(ge=0, description="of training")
    hours: float = Field(ge=0, description="of training on one core")
    seed: int
    command: str = Field(description="makes a file such as this again")

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        return layer_shapes(READS, *self.hidden, ACTIONS)


class NetworkPolicy(Policy):
    """What is read of N robots to actions. As an estimator it knows nothing: there is no QP."""

    def __init__(self, file: ModelFile[NetworkAbout]) -> None:
        self.version, self.act = file.version, Actor(file.arrays)

    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        """There are no estimates."""
        return Estimates.zero(*scene.seen.nominal_a.shape)


@dataclass
class Memory:
    """N robots' memory: the last `frames` (N, FRAMES, FEATURES), the oldest first, the last action, and its tick."""

    frames: Array
    action: Array
    tick: Array

    @classmethod
    def of(cls, n: int) -> "Memory":
        """A memory that remembers nothing."""
        return cls(np.zeros((n, FRAMES, FEATURES)), np.zeros((n, ACTIONS)), np.full(n, NEVER))


def observe(memory: Memory, scene: Any) -> Array:
    """What the network reads at a scene of N robots, (N, READS). The memory goes on to this tick.

    A frame, each number near one: y, y', the hip and the phase with their rates, the swing foot, the feet's normal
    forces, the stone, whether there is one, the last action. An episode begins as if it had stood like this before.
    """
    seen, goes_on = scene.seen, (memory.tick == scene.tick - 1)[:, None]
    on_stones = seen.stone[:, 1:2] > 0
    parts = [
        (scene.observation[:, : len(_CENTER)] - _CENTER) / _SCALE,
        seen.swing / (0.3, 0.05),
        scene.force[:, :, 1] / NORMAL_FORCE,
        np.where(on_stones, (seen.stone - (STONE, STONE, 0.0)) / EDGE, 0.0),
        on_stones,
        np.where(goes_on, memory.action, 0.0),
    ]
    frame = np.concatenate(parts, axis=1).clip(-BOUND, BOUND)[:, None]
    before = np.where(goes_on[:, None], memory.frames[:, 1:], frame)
    memory.frames, memory.tick = np.concatenate([before, frame], axis=1), scene.tick.copy()
    return memory.frames.reshape(len(frame), READS)


def command(memory: Memory, scene: Any, action: Array) -> Array:
    """The torques (N, 4), stance/swing order, not limited, N m, of actions (N, 4), which are cut to [-1, 1]."""
    memory.action = action.clip(-1, 1).astype(float)
    y, dy = scene.seen.eta[:, :ACTIONS], scene.seen.eta[:, ACTIONS:]
    return KP * (REACH * memory.action - y) - KD * dy


def action_for(scene: Any, torque: Array) -> Array:
    """The actions (N, 4), within [-1, 1], whose torques are the nearest to `torque` (N, 4), stance/swing order, N m."""
    y, dy = scene.seen.eta[:, :ACTIONS], scene.seen.eta[:, ACTIONS:]
    action: Array = ((torque + KP * y + KD * dy) / (KP * REACH)).clip(-1, 1)
    return action


class JointTargetController(Controller):
    """The walking controller with PD and a network in place of the QP."""

    policy: NetworkPolicy

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        super().reset(seed)
        self._memory = Memory.of(1)

    def step(self, state: RobotState) -> ControllerOutput:
        """The torque for one tick. mu is what it amounts to under the nominal model."""
        one, limit, nothing = self.see(state), self.parameters.torque_limit, self.qp.no_error()
        (wanted,), scene = command(self._memory, one, self.policy.act(observe(self._memory, one))), one[0]
        in_order = wanted.clip(-limit, limit)
        mu = Affine(scene.seen.outputs_a, scene.seen.outputs_b)(in_order)
        return ControllerOutput(
            **seen_fields(scene),
            barrier_names=self.barrier_names,
            torque=in_order[SWAP_TORQUE] if scene.stance is Leg.RIGHT else in_order,
            mu=mu,
            mu_qp=mu,
            omega=np.zeros(ACTIONS),
            quantities=self.qp.names,
            alpha=nothing.alpha,
            beta=nothing.beta,
            clf_slack=0.0,
            rescue_slack=0.0,
            active=(),
            saturated=bool(np.abs(wanted).max() > limit),
            solver="none",
            status="end-to-end",
            answered=True,
            solve_seconds=0.0,
            policy_version=self.policy.version,
            fault=one.faults.get(0, ""),
        )

    def see(self, state: RobotState) -> BatchScene:
        """Take a state in: the scene of this one robot."""
        scene = sound(self.robots.look(checked(state)))
        self.robots.go_on()
        return scene


def reference_alone() -> NetworkPolicy:
    """The network whose action is always zero: PD on the gait's reference."""
    about = NetworkAbout(learner="none", hidden=(1, 1), ticks=0, hours=0.0, seed=0, command="")
    return NetworkPolicy(ModelFile(about, {name: np.zeros(shape, np.float32) for name, shape in about.shapes.items()}))


def network_policy(path: str) -> NetworkPolicy:
    """The policy of a file; raises `PolicyFileError`."""
    return NetworkPolicy(read(Path(path), NetworkAbout))

"""End-to-end control: a network commands joint targets, which PD follows. No model, no QP, no estimate.

The residual form. The gait gives the reference q_d(phase), the action moves the target away from it, and

    torque = KP (q_d + REACH action - q) + KD (q_d' - q') = KP (REACH action - y) - KD y'

with y = q - q_d, the outputs. Which leg stands, and the path of a step onto the stone that is seen, are the walking
controller's own. An action (4,) in [-1, 1] has the order stance hip, stance knee, swing hip, swing knee.
"""

import itertools
from pathlib import Path

import numpy as np
from cbf_clf_qp.estimates import Estimates
from pydantic import Field
from rabbit_description.state import SWAP_TORQUE, Array, Leg, RobotState
from rl_cbf_clf_controller.controller import NO_NOISE, Controller
from rl_cbf_clf_controller.controller_output import ControllerOutput, seen_fields
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.uncertainty import UNITS

from rabbit_rivals.model_file import About, ModelFile, read

KP, KD = 600.0, 30.0  # N m/rad, N m s/rad; with them alone the robot walks on flat ground at mass scales 1 and 2
REACH = 0.3  # rad; KP REACH is nearly the motors' limit of 200 N m
ACTIONS = 4
FEATURES = 23
NORMAL_FORCE = 300.0  # N
_CENTER, _SCALE = np.array([unit[1:] for unit in UNITS[:14]]).T


class NetworkAbout(About):
    """A network from features to actions, tanh between its layers, and how it was trained."""

    learner: str
    hidden: tuple[int, ...] = Field(min_length=1, max_length=8)
    kp: float = Field(KP, gt=0, allow_inf_nan=False, description="N m/rad")
    kd: float = Field(KD, gt=0, allow_inf_nan=False, description="N m s/rad")
    reach: float = Field(REACH, gt=0, allow_inf_nan=False, description="rad")
    plant: dict[str, bool | int | float | str]
    steps: int = Field(ge=0, description="ticks of training")
    hours: float = Field(ge=0, description="of training on one core")
    seed: int
    command: str = Field(description="makes a file such as this again")

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        sizes = (FEATURES, *self.hidden, ACTIONS)
        found: dict[str, tuple[int, ...]] = {}
        for i, (before, after) in enumerate(itertools.pairwise(sizes)):
            found |= {f"{i}.weight": (after, before), f"{i}.bias": (after,)}
        return found


class NetworkPolicy(Policy):
    """Features to actions, in numpy. As an estimator it knows nothing: there is no QP."""

    def __init__(self, file: ModelFile[NetworkAbout]) -> None:
        self.about, self.version = file.about, file.version
        layers = range(len(file.about.hidden) + 1)
        self._layers = [(file.arrays[f"{i}.weight"], file.arrays[f"{i}.bias"]) for i in layers]

    def act(self, read: Array) -> Array:
        """The action (4,) in [-1, 1] for features (23,)."""
        for weight, bias in self._layers[:-1]:
            read = np.tanh(weight @ read + bias)
        weight, bias = self._layers[-1]
        action = weight @ read + bias
        return np.tanh(action) if self.about.learner == "sac" else np.clip(action, -1, 1)

    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        """None."""
        return Estimates.zero(*scene.seen.nominal_a.shape)


class JointTargetController(Controller):
    """The walking controller with PD and a network in place of the QP: `observe` a state, then command its `torque`."""

    policy: NetworkPolicy

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        super().reset(seed)
        self._action = np.zeros(ACTIONS)

    def observe(self, state: RobotState) -> tuple[Array, str]:
        """Features (23,), each near one: y, y', z and its rates, the swing foot, the feet's normal forces, the stone's
        middle, the last action; and why the episode must end, or nothing. Raises `ControllerError`.
        """
        self._check(state)
        fault = self._swap_legs(state)
        if not self._step.has_begun:
            self._begin_step(state)
        self.scene = scene = self.look(state)
        stone = state.preview
        aim = (stone.l_min + stone.l_max) / 2 if stone else self.steps.wanted[0]
        return np.concatenate(
            [
                (scene.observation[: len(_CENTER)] - _CENTER) / _SCALE,
                scene.seen.swing / (0.3, 0.05),
                scene.force[:, 1] / NORMAL_FORCE,
                [(aim - 0.375) / 0.05],
                self._action,
            ]
        ), fault

    def command(self, action: Array, kp: float = KP, kd: float = KD, reach: float = REACH) -> Array:
        """The torque (4,), stance/swing order, unlimited, N m, at the state that was observed last."""
        self._action = np.asarray(action, dtype=float)
        y, dy = np.split(self.scene.seen.eta, 2)
        return kp * (reach * self._action - y) - kd * dy

    def limited(self, wanted: Array) -> Array:
        """Within the motors' limit, left/right order."""
        limit = self.parameters.torque_limit
        torque = np.clip(wanted, -limit, limit)
        return torque[SWAP_TORQUE] if self._step.stance is Leg.RIGHT else torque

    def step(self, state: RobotState) -> ControllerOutput:
        """The torque for one tick. mu is what it amounts to under the nominal model."""
        read, fault = self.observe(state)
        about = self.policy.about
        wanted = self.command(self.policy.act(read), about.kp, about.kd, about.reach)
        torque = self.limited(wanted)
        scene, nothing = self.scene, self.qp.no_error()
        in_order = torque[SWAP_TORQUE] if scene.stance is Leg.RIGHT else torque
        mu = scene.output_dynamics(in_order)
        return ControllerOutput(
            **seen_fields(scene),
            torque=torque,
            mu=mu,
            mu_qp=mu,
            omega=NO_NOISE,
            quantities=self.qp.names,
            alpha=nothing.alpha,
            beta=nothing.beta,
            clf_slack=0.0,
            rescue_slack=0.0,
            active=(),
            saturated=bool(np.abs(wanted).max() > self.parameters.torque_limit),
            solver="none",
            status="end-to-end",
            answered=True,
            solve_seconds=0.0,
            policy_version=self.policy.version,
            fault=fault,
        )


def reference_alone() -> NetworkPolicy:
    """The network whose action is always zero: PD on the gait's reference."""
    nothing = {"plant": {}, "steps": 0, "hours": 0.0, "seed": 0, "command": ""}
    about = NetworkAbout.model_validate({"learner": "none", "hidden": (1,), **nothing})
    return NetworkPolicy(ModelFile(about, {name: np.zeros(shape) for name, shape in about.shapes.items()}))


def network_policy(path: str) -> NetworkPolicy:
    """From a file; raises `PolicyFileError`."""
    return NetworkPolicy(read(Path(path), NetworkAbout))

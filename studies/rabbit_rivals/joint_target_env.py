"""The walk as a `gymnasium.Env` whose action are joint targets: for end-to-end learners.

    observation   (23,) see `JointTargetController.observe`
    action        (4,) in [-1, 1], see `joint_targets`
    reward        for each landing a share of one by its place on the stone; a little for each tick on the reference;
                  less for torque and for changes of the action; -1 for a fall, a miss or a foot in a gap

The curriculum: stones get narrower, 15 cm to 5 cm around the same middle, when the last walks were long. One walk in
four is on flat ground.
"""

from collections import deque
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from rabbit_description.gait import load_gaits
from rabbit_description.state import TORQUE_LIMIT, RobotState
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Outcome, Simulation
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.scene import ControllerError

from rabbit_rivals.joint_targets import ACTIONS, FEATURES, JointTargetController

Float32 = NDArray[np.float32]

WIDTHS = (0.15, 0.10, 0.07, 0.05)  # m, of the curriculum's levels
MIDDLE = 0.375  # m, of the stones: the paper's
FLAT_SHARE = 0.25
LONG, WALKS = 12, 20  # stones on the average over so many walks: the next level
ON_TARGET, PER_TICK = 0.1, 0.02  # rad, of y; reward of a tick without error
EFFORT, CHANGE = 0.004, 0.004  # of torques at their limit; of an action changed by one


def walking_parameters(terrain: str) -> ControllerParameters:
    """What leads the feet: which leg stands, and the gait library's paths."""
    controller = {"stones": "cbf-clf-qp", "flat": "clf-qp"}[terrain]
    margin = {"stone_margin": 0.01} if terrain == "stones" else {}
    return load_parameters("ours", controller=controller, gait="paper_stones", **margin)


class JointTargetEnv(gymnasium.Env[Float32, Float32]):
    """One episode is one walk of 20 stones or steps; `level` is the curriculum's, `plant` what else is simulated."""

    def __init__(self, level: int = 0, **plant: Any) -> None:
        self.observation_space = Box(-np.inf, np.inf, (FEATURES,), np.float32)
        self.action_space = Box(-1.0, 1.0, (ACTIONS,), np.float32)
        self.level = level
        self._plant = plant
        self._lengths: deque[int] = deque(maxlen=WALKS)
        self._simulations: dict[float, Simulation] = {}
        self._gaits = load_gaits("paper_stones")
        self._controllers: dict[str, JointTargetController] = {}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """A new walk; its terrain, course and first state follow from the seed."""
        super().reset(seed=seed)
        width = 0.0 if self.np_random.random() < FLAT_SHARE else WIDTHS[self.level]
        self._width = width
        self._simulation, self._controller = self._parts(width)
        episode = int(self.np_random.integers(2**32))
        self._state: RobotState = self._simulation.reset(episode)
        self._controller.reset(episode)
        self._last = np.zeros(ACTIONS)
        read, _ = self._controller.observe(self._state)
        return read.astype(np.float32), {}

    def step(self, action: Float32) -> tuple[Float32, float, bool, bool, dict[str, Any]]:
        """One tick, 10 ms."""
        wanted = self._controller.command(action)
        torque = self._controller.limited(wanted)
        landed = len(self._simulation.landings)
        self._state = self._simulation.step(torque)
        fault, read = "", np.zeros(FEATURES)
        try:
            read, fault = self._controller.observe(self._state)
        except ControllerError as error:  # a walk that has ended may show no state
            fault = str(error)
        outcome = self._simulation.outcome
        walked = outcome is Outcome.WALKED
        failed = not walked and (outcome is not Outcome.RUNNING or bool(fault))
        reward = PER_TICK * np.exp(-np.square(self._controller.scene.seen.eta[:4]).mean() / ON_TARGET**2)
        reward -= EFFORT * np.square(torque / TORQUE_LIMIT).mean()
        reward -= CHANGE * np.square(action - self._last).mean()
        self._last = np.asarray(action, dtype=float)
        for landing in self._simulation.landings[landed:]:
            if not self._width:
                reward += 1.0
            elif landing.on_stone:
                beside = (landing.l - (landing.l_min + landing.l_max) / 2) / 0.04
                reward += 0.5 + 0.5 * np.exp(-(beside**2)) if not landing.missed else 0.0
        if failed or walked:
            self._count()
        reward -= float(failed)
        return read.astype(np.float32), float(reward), failed, walked, {}

    def _count(self) -> None:
        """A walk more; after enough long ones the next level."""
        if self._width:
            self._lengths.append(self._state.touchdowns)
        if len(self._lengths) == WALKS and np.mean(self._lengths) > LONG and self.level < len(WIDTHS) - 1:
            self.level += 1
            self._lengths.clear()

    def _parts(self, width: float) -> tuple[Simulation, JointTargetController]:
        """Plant and controller for stones of this width, for flat ground at 0."""
        if width not in self._simulations:
            terrain = "stones" if width else "flat"
            course = {"stone_width": width, "l_min_mean": MIDDLE - width / 2} if width else {}
            plant = SimulationParameters.model_validate({"terrain": terrain, **course, **self._plant})
            self._simulations[width] = Simulation(plant, self._gaits)
            tuning = walking_parameters(terrain)
            idle = ZeroPolicy(tuning.problem)
            self._controllers.setdefault(terrain, JointTargetController(tuning, self._gaits, idle))
        return self._simulations[width], self._controllers["stones" if width else "flat"]

"""A policy within the step: it says how far the outputs' accelerations shall be from those of the PD law.

The objective `pd_centred` asks for y'' = v_PD. With a residual r (m,) it asks for y'' = v_PD + r, as an output error
Delta = -r would have it (`cbf_clf_qp.qp`). No row of the QP changes, so CLF, barriers and friction cone hold whatever
the network says. r is the network's output in [-1, 1] times `SCALE`.

The network reads two frames, of this tick and of the one before. Among other things a frame has by how much the
outputs' last acceleration differed from the identified robot's: what no parameter explains.
"""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from cbf_clf_qp.estimates import Estimates
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import DOF, JOINTS, TICK_SECONDS, Array

from rl_cbf_clf_controller.network import Actor
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.weights import RESIDUAL_FRAME, PolicyFile

SCALE = 40.0  # rad/s^2
FRAME = len(RESIDUAL_FRAME)
READS = 2 * FRAME
STONE = 0.35  # m, subtracted from the edges of a stone
BOUND = 5.0  # of each number of a frame
NEVER = -2  # no tick


@dataclass
class Memory:
    """N robots' memory between two ticks: `frame`, the outputs' rates dy, what the policy said, and in which tick."""

    frame: Array
    dy: Array
    said: Array
    tick: Array
    stance: Array

    @classmethod
    def of(cls, n: int) -> "Memory":
        """A memory that remembers nothing."""
        dy, said = np.zeros((2, n, JOINTS))
        return cls(np.zeros((n, FRAME)), dy, said, np.full(n, NEVER), np.zeros(n, dtype=int))

    def forget(self, robot: int | slice) -> None:
        """An episode begins."""
        self.said[robot], self.tick[robot] = 0.0, NEVER

    def keep(self, rows: Array) -> None:
        """Go on with some of the robots, by number."""
        for name, values in vars(self).items():
            setattr(self, name, values[rows])


class ResidualPolicy(Policy):
    """A policy that is asked after the identified robot, and moves the objective's centre."""

    adaptation = "identification"
    tick_seconds = TICK_SECONDS  # with which it was trained

    def __init__(self) -> None:
        self._memory = Memory.of(1)

    @abstractmethod
    def says(self, reads: Array) -> Array:
        """The residuals over `SCALE`, (N, JOINTS) in [-1, 1], of what is read of N robots, (N, READS)."""

    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        """The estimates at a tick of one robot; `before`: of the identified robot."""
        return self.of_many(self._memory, of_one(scene), Estimates.of_many([before]))[0]

    def of_many(self, memory: Memory, scene: Scene, before: Estimates) -> Estimates:
        """The same of N robots."""
        memory.said = self.says(observe(memory, scene, before, self.tick_seconds))
        return centred(memory.said, before.beta.shape[1])

    def reset(self) -> None:
        self._memory = Memory.of(1)


class ResidualActor(ResidualPolicy):
    """That of a policy file."""

    def __init__(self, file: PolicyFile) -> None:
        super().__init__()
        self.file, self.version, self.tick_seconds = file, file.version, file.metadata.trained_tick
        self._actor = Actor(file.arrays)

    def says(self, reads: Array) -> Array:
        return self._actor(reads)


def of_one(scene: Scene) -> Scene:
    """A scene of one robot as one of N, which `observe` reads."""
    names = "x", "force", "observation", "tick", "torque", "stance", "step_index", "step_time"
    rows: dict[str, Any] = {name: np.asarray(getattr(scene, name))[None] for name in names}
    return replace(scene, seen=type(scene.seen)(scene.seen.row[None]), **rows)


def observe(memory: Memory, scene: Scene, others: Estimates, tick_seconds: float = TICK_SECONDS) -> Array:
    """What the network reads at a scene of N robots, (N, READS). The memory goes on to this tick.

    `others`: estimates of the model's errors.
    """
    seen, n, tick = scene.seen, len(scene.x), scene.tick
    y, dy, error = seen.eta[:, :JOINTS], seen.eta[:, JOINTS:], others.output_error
    held = np.nan_to_num((seen.outputs_a * scene.torque[:, None, :]).sum(axis=2) + seen.outputs_b)
    expected = held
    if error is not None:
        expected = held + (error[:, :, :JOINTS] * held[:, None, :]).sum(axis=2) + error[:, :, JOINTS]
    goes_on = (memory.tick == tick - 1)[:, None]
    same_step = goes_on & (memory.stance == scene.stance)[:, None] & np.isfinite(scene.torque)
    missed = np.where(same_step, (dy - memory.dy) / tick_seconds - expected, 0.0)
    on_stones = hasattr(seen, "B1_state")
    barriers = [seen.B1_state, seen.B2_state] if on_stones else [np.zeros((n, 2))] * 2
    stone = seen.stone - (STONE, STONE, 0.0) if on_stones else np.zeros((n, 3))
    parts = [
        10 * y,
        dy,
        seen.phase,
        3 * scene.x[:, 2:3],  # pitch
        scene.x[:, DOF : DOF + BASE],
        held / 50,
        missed / 100,
        scene.force.reshape(n, -1) / 600,
        5 * np.concatenate(barriers, axis=1),
        10 * stone,
        np.full((n, 1), float(on_stones)),
        memory.said,
        seen.swing,
        np.minimum(tick, 100)[:, None] / 100,
    ]
    frame = np.concatenate(parts, axis=1).clip(-BOUND, BOUND)
    before = np.where(goes_on, memory.frame, frame)
    memory.frame, memory.dy, memory.tick, memory.stance = frame, dy.copy(), tick.copy(), scene.stance.copy()
    return np.concatenate([frame, before], axis=1)


def centred(said: Array, quantities: int) -> Estimates:
    """The estimates that move the objective's centre by `SCALE` times `said` (N, m), and no row."""
    n, m = said.shape
    error = np.zeros((n, m, m + 1))
    error[:, :, m] = -SCALE * said
    return Estimates(np.zeros((n, quantities, m)), np.zeros((n, quantities)), error)

"""Episodes of a control task's true system, as `Simulation` has RABBIT's: what a controller sees, and how it ended."""

from collections.abc import Callable

import numpy as np
from cbf_clf_qp.functions import Array

from rabbit_description.state import RobotState
from rabbit_description.task import ControlTask, Given
from rabbit_description.task_state import layout_of, task_state


class TaskSimulation:
    """One system at a time.

    `true`: the plant's parameters by name, which may change between two ticks; `altered`: what an episode's commands
    become; `outcome`: running, done or failed; `reason`: of a failure, the limit that was passed.
    """

    def __init__(self, task: ControlTask) -> None:
        self.task, self.true = task, dict(task.true)
        self.layout, self.tick_seconds = layout_of(task), task.seconds
        self.altered: Callable[[Given], Given] = lambda given: given
        self.outcome, self.reason = "idle", ""

    def close(self) -> None:
        """Nothing is held."""

    def reset(self, seed: int) -> RobotState:
        """A new episode."""
        self._x, given, _ = self.task.beginning(seed)
        self._given = self.altered(given)
        self._tick, self._impacts, self.outcome, self.reason = 0, 0, "running", ""
        return self._state(np.full(len(self.layout.joints), np.nan))

    def step(self, u: Array) -> RobotState:
        """Go on one tick under the input `u` (m,); raises ValueError where it is not finite, or of another size."""
        if u.shape != (len(self.layout.joints),) or not np.isfinite(u).all():
            raise ValueError(f"u = {u}: expected {len(self.layout.joints)} finite numbers")
        task, true = self.task, self.task.parameters_at(self.true, self._commanded())
        moved = task.moved(self._x, true, u)
        self._x, self._tick, self._impacts = moved.x, self._tick + 1, self._impacts + moved.impacts
        if outcome := task.outcome(moved, true, self._tick, self._impacts):
            self.outcome = outcome
            self.reason = task.why_failed(moved, true, self._impacts) if outcome == "failed" else ""
        return self._state(u)

    @property
    def verdict(self) -> tuple[str, str]:
        """How the episode stands or ended, and why."""
        return self.outcome, self.reason

    def joint_rates(self, state: RobotState) -> Array:
        """That are damped where no answer comes: a task's inputs have none, so that its input is 0 then."""
        return np.zeros(len(state.applied))

    def _commanded(self) -> dict[str, float]:
        return dict(self._given(self._tick * self.task.seconds, self._impacts))

    def _state(self, applied: Array) -> RobotState:
        p = self.task.parameters_at({}, self._commanded())
        is_running = self.outcome == "running"
        return task_state(self.task, self._x, p, applied, self._tick, self._impacts, is_running)

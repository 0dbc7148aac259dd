"""Episodes of a control task's true system, as `Simulation` has RABBIT's: what a controller sees, and how it ended."""

from collections.abc import Callable, Sequence

import numpy as np
from cbf_clf_qp.batch_functions import BatchFunction
from cbf_clf_qp.functions import Array

from rabbit_description.state import RobotState
from rabbit_description.task import ControlTask, Given, Moved
from rabbit_description.task_state import layout_of, task_state


class TaskSimulation:
    """One system at a time.

    `true`: the plant's parameters by name, which may change between two ticks; `altered`: what an episode's commands
    become; `x` (n,): its state; `outcome`: running, done or failed; `reason`: of a failure, the limit that was passed.
    """

    def __init__(self, task: ControlTask) -> None:
        self.task, self.true = task, dict(task.true)
        self.layout, self.tick_seconds = layout_of(task), task.seconds
        self.altered: Callable[[Given], Given] = lambda commands: commands
        self.outcome, self.reason = "idle", ""

    def close(self) -> None:
        """Closes nothing: nothing is held."""

    def reset(self, seed: int) -> RobotState:
        """A new episode."""
        self.x, commands, _ = self.task.beginning(seed)
        self._commands = self.altered(commands)
        self._tick, self._impacts, self.outcome, self.reason = 0, 0, "running", ""
        return self._state(np.full(len(self.layout.joints), np.nan))

    def step(self, u: Array) -> RobotState:
        """Go on one tick under the input `u` (m,); raises ValueError where it is not finite, or of another size."""
        if u.shape != (len(self.layout.joints),) or not np.isfinite(u).all():
            raise ValueError(f"u = {u}: expected {len(self.layout.joints)} finite numbers")
        true = self.parameters
        return self.take(self.task.moved(self.x, true, u), true, u)

    @property
    def parameters(self) -> Array:
        """All of the plant at this tick, p (k,)."""
        return self.task.parameters_at(self.true, self._commanded())

    def take(self, moved: Moved, true: Array, u: Array) -> RobotState:
        """What a tick of the input `u` (m,) has become under the parameters `true`."""
        task = self.task
        self.x, self._tick, self._impacts = moved.x, self._tick + 1, self._impacts + moved.impacts
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
        return dict(self._commands(self._tick * self.task.seconds, self._impacts))

    def _state(self, applied: Array) -> RobotState:
        p = self.task.parameters_at({}, self._commanded())
        is_running = self.outcome == "running"
        return task_state(self.task, self.x, p, applied, self._tick, self._impacts, is_running)


class TaskSimulations:
    """Several at once; they move to the bit as they would alone. `states`: where they are."""

    def __init__(self, task: ControlTask, n: int) -> None:
        self.task, self.simulations = task, [TaskSimulation(task) for _ in range(n)]
        self._glide = None if task.plant else BatchFunction(task.glide)

    @property
    def running(self) -> Array:
        """Which go on, (N,)."""
        return np.array([state.running for state in self.states])

    def reset(self, seeds: Sequence[int]) -> None:
        """Begin an episode in each."""
        self.states = [one.reset(seed) for one, seed in zip(self.simulations, seeds, strict=True)]

    def step(self, u: Array) -> None:
        """Go on one tick under the inputs `u` (N, m)."""
        if self._glide is None:
            self.states = [one.step(row) for one, row in zip(self.simulations, u, strict=True)]
            return
        x, true = (np.array([getattr(one, name) for one in self.simulations]) for name in ("x", "parameters"))
        glided, self.states = self._glide(x, true, u), list[RobotState]()
        for i, one in enumerate(self.simulations):
            strikes = glided.strikes[i, 0]
            moved = self.task.moved(x[i], true[i], u[i]) if strikes else Moved(glided.x[i], u[i], 0)
            self.states.append(one.take(moved, true[i], u[i]))

    def keep(self, rows: Array) -> None:
        """Go on with some of them, by number."""
        self.simulations, self.states = ([of[row] for row in rows] for of in (self.simulations, self.states))

"""End to end on a control task of one's own: a network gives the input, and PPO trains it on the true plant.

    action      (m,) in [-1, 1], times the task's limit, or what the nominal controller uses where it has none
    reads       the task's observation, what is commanded, each barrier's value, the outputs y, y' of the CLF
    reward      PER_TICK / (1 + V / its median under the nominal controller); -1 where the episode has failed or a
                barrier is below its tolerance, which ends it

`rabbit rival task TASK` trains, and `rabbit evaluate --task TASK --controller ppo:FILE` rides what was trained.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from cbf_clf_qp.batch_functions import BatchFunction
from cbf_clf_qp.functions import Array
from gymnasium.spaces import Box
from pydantic import Field
from rabbit_description.task import ControlTask, Moved, OwnController, TaskError
from rabbit_experiments.vector_environment import EpisodesEnv
from rl_cbf_clf_controller.network import Actor
from rl_cbf_clf_controller.task_controller import NOMINAL, TaskController
from rl_cbf_clf_controller.weights import PolicyFileError, layer_shapes
from rl_trainer.task_episode import ride_of

from rabbit_rivals.learners import actor_arrays, make
from rabbit_rivals.model_file import About, ModelFile, read
from rabbit_rivals.session import Bar
from rabbit_rivals.vec_env import SideBySide

PER_TICK, BROKEN = 0.02, -1.0  # reward
RIDES = 3  # of the nominal controller, which show the units
USED, ROOM = 0.99, 2.0  # where inputs have no limit: this quantile of the nominal ones, and so many times of it
BOUND = 10.0  # of each number that is read
ROBOTS, ROLLOUT, HIDDEN = 32, 128, 64  # side by side; ticks of each between two updates; units of a layer


class TaskAbout(About):
    """What the network reads, in which units, and how it was trained."""

    task: str
    reads: tuple[str, ...]
    center: tuple[float, ...]
    scale: tuple[float, ...]
    inputs: tuple[float, ...] = Field(description="the greatest |u|")
    V: float = Field(description="of which the reward of a tick is half")
    hidden: tuple[int, int] = (HIDDEN, HIDDEN)
    ticks: int = Field(0, ge=0, description="of training")
    seed: int = 0

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        return layer_shapes(len(self.reads), *self.hidden, len(self.inputs))


def units_of(task: ControlTask) -> TaskAbout:
    """Mean and deviation of what is read, and the inputs, in rides of the nominal controller.

    Raises `TaskError` where there is no CLF to follow.
    """
    if "V" not in task.tick.names:
        raise TaskError(f"{task.name}: no Clf among its quantities; expected one, which says what is to be followed")
    controller = TaskController(task)
    moments = [moment for seed in range(RIDES) for moment in ride_of(controller, NOMINAL, seed).moments]
    seen = np.array([whole(task, m.output, m.p) for m in moments])
    deviation = seen.std(axis=0)
    used = ROOM * np.quantile(np.abs([m.u for m in moments]), USED, axis=0)
    eta = [f"eta{i + 1}" for i in range(len(moments[0].output.eta))]
    return TaskAbout(
        task=task.name,
        reads=(*task.observed, *task.commanded, *(barrier.name for barrier in task.barriers), *eta),
        center=seen.mean(axis=0).tolist(),
        scale=np.where(deviation > 0, deviation, 1.0).tolist(),
        inputs=(used if task.limit is None else np.full(used.shape, task.limit)).tolist(),
        V=float(np.median([m.output.V for m in moments])),
    )


def whole(task: ControlTask, seen: Any, p: Array) -> Array:
    """All that is read, (..., r), of what the tick has `seen` with parameters p (..., k)."""
    places = [i for i, name in enumerate(task.system.named) if name in task.commanded]
    return np.concatenate([seen.observation, p[..., places], seen.barriers, seen.eta], axis=-1)


def scaled(about: TaskAbout, reads: Array) -> Array:
    """What the network reads, in its units."""
    inputs: Array = ((reads - about.center) / about.scale).clip(-BOUND, BOUND)
    return inputs


def later_of_many(task: ControlTask, n: int) -> Callable[..., Array]:
    """The true states (n, x) a tick later, of states, parameters and inputs."""
    step, h = task.later_by.function, task.seconds / task.substeps
    symbols = [ca.MX.sym(name, step.numel_in(i)) for i, name in enumerate("xpu")]
    state = symbols[0]
    for _ in range(task.substeps):
        state = step(state, *symbols[1:], h)
    tick = ca.Function("tick", symbols, [state]).map(n)
    return lambda *rows: np.array(tick(*(row.T for row in rows))).T


class TaskVectorEnv(EpisodesEnv):
    """`robots` rides of a task side by side, on its true plant."""

    def __init__(self, task: ControlTask, robots: int) -> None:
        """Raises `TaskError` where the state jumps, or the plant is the task's own: neither is batched."""
        if task.impact or task.plant:
            raise TaskError(f"{task.name}: an impact, or a plant of its own; expected neither in a batch")
        self.task, self.about = task, units_of(task)
        n, k, m = (symbol.numel() for symbol in (task.system.x, task.system.p, task.system.u))
        reads = Box(-BOUND, BOUND, (len(self.about.reads),), np.float64)
        super().__init__(robots, reads, Box(-1.0, 1.0, (m,), np.float64))
        self._look_at, self._later = BatchFunction(task.tick.look), later_of_many(task, robots)
        self._x, self._p, self._ticks = np.zeros((robots, n)), np.zeros((robots, k)), np.zeros(robots, dtype=int)
        self._commands: list[Any] = [None] * robots

    def begin(self, robots: list[int], seeds: list[int]) -> None:
        """See `EpisodesEnv`."""
        for i, seed in zip(robots, seeds, strict=True):
            self._x[i], self._commands[i], _ = self.task.beginning(seed)
            self._ticks[i] = 0
            self._p[i] = self.task.parameters_at({}, self._commands[i](0.0, 0))

    def look(self) -> Array:
        """See `EpisodesEnv`."""
        return self._seen()[0]

    def advance(self, actions: Array) -> Array:
        """See `EpisodesEnv`."""
        task, u = self.task, actions.clip(-1, 1) * self.about.inputs
        true = self._parameters(task.true)
        self._x, self._ticks = self._later(self._x, true, u), self._ticks + 1
        now = zip(self._x, true, u, self._ticks.tolist(), strict=True)
        ends = [task.outcome(Moved(x, held, 0), p, ticks, 0) for x, p, held, ticks in now]
        self._p = self._parameters({})
        _, V, barriers = self._seen()
        failed = np.array([end == "failed" for end in ends]) | (barriers < -task.tolerance).any(axis=1)
        self._score = np.where(failed, BROKEN, PER_TICK / (1 + V / self.about.V)), failed
        ended: Array = failed | np.array([bool(end) for end in ends])
        return ended

    def score(self) -> tuple[Array, Array]:
        """See `EpisodesEnv`."""
        return self._score

    def _parameters(self, of_plant: Any) -> Array:
        at = zip(self._commands, (self._ticks * self.task.seconds).tolist(), strict=True)
        return np.array([self.task.parameters_at(of_plant, commands(time, 0)) for commands, time in at])

    def _seen(self) -> tuple[Array, Array, Array]:
        """What is read (N, r), V (N,), and the barriers' values (N, b)."""
        with np.errstate(all="ignore"):
            seen = self._look_at(self._x, self._p)
            reads = np.nan_to_num(scaled(self.about, whole(self.task, seen, self._p)))
        return reads, np.nan_to_num(seen.V[:, 0], nan=np.inf), seen.barriers


def train(task: ControlTask, ticks: int, seed: int) -> ModelFile[TaskAbout]:
    """The network after so many ticks of all robots together. Raises `TaskError`."""
    environment = TaskVectorEnv(task, ROBOTS)
    about, settings = environment.about, {"learning_rate": 4e-4, "gamma": 0.995}
    model = make("ppo", SideBySide([environment]), len(about.reads), seed, ROLLOUT, HIDDEN, **settings)
    with Bar(ticks) as bar:
        model.learn(ticks, bar)
    return ModelFile(about.model_copy(update={"ticks": model.num_timesteps, "seed": seed}), actor_arrays(model))


def controller_of(task: ControlTask, path: Path) -> OwnController:
    """The controller of a trained file; raises `TaskError`."""
    try:
        file = read(path, TaskAbout)
    except PolicyFileError as error:
        raise TaskError(str(error)) from error
    about, actor = file.about, Actor(file.arrays)
    if about.task != task.name:
        raise TaskError(f"{path}: trained for {about.task}; this task is {task.name}")

    def control(x: Array, p: Array) -> Array:
        return actor(scaled(about, whole(task, task.tick.look(x, p), p))) * about.inputs

    return control

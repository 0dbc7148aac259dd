"""One episode of a task under one of its controllers: nominal, oracle, a learned policy, or one that the task brings.

ride = ride_of(TaskController(task), "nominal", seed=1)        all ticks, and how it ended
"""

from dataclasses import dataclass, field

import numpy as np
from cbf_clf_qp.functions import Array
from rabbit_description.state import RobotState
from rabbit_description.task import ControlTask
from rabbit_description.task_simulation import TaskSimulation
from rabbit_description.task_state import p_of, x_of
from rl_cbf_clf_controller.task_controller import Controlling, TaskController

from rl_trainer.rollout import Moment, Record, rollout


@dataclass
class Ride:
    """An episode: its moments; `outcome` is done, failed, or no answer; `impacts`: how many there were.

    `last`: the state after the last tick, which no controller sees; None: not known. `reason`: of a failure, which
    limit was passed, by name and value; else why there was no answer.
    """

    task: ControlTask
    controller: str
    seed: int
    moments: list[Moment] = field(default_factory=list)
    outcome: str = "done"
    impacts: int = 0
    last: RobotState | None = None
    reason: str = ""

    @property
    def title(self) -> str:
        """The title of its pictures."""
        return f"{self.task.name}, {self.controller}, seed {self.seed}: {self.outcome}"

    @property
    def has_qp(self) -> bool:
        """Whether its controller solves a QP."""
        return any(moment.decided is not None for moment in self.moments)

    @property
    def barriers(self) -> Array:
        """A row of B's values for each state, that after the last tick too, each in its unit."""
        last = self.last
        after = [] if last is None else [self.task.tick.look(x_of(self.task, last), p_of(last)).barriers]
        return np.array([*(moment.output.barriers for moment in self.moments), *after])

    @property
    def margins(self) -> Array:
        """The margin of each barrier over the ride; -inf after a failure."""
        if self.outcome != "done":
            return np.full(len(self.task.barriers), -np.inf)
        return self.barriers.min(axis=0)

    def end(self, simulation: TaskSimulation, last: RobotState) -> None:
        """Ends the ride in this state."""
        self.impacts = last.touchdowns
        if last.running:  # the controller gave up
            self.outcome, self.reason = "no answer", self.moments[-1].output.fault
        else:
            self.last, (self.outcome, self.reason) = last, simulation.verdict

    @property
    def is_kept(self) -> bool:
        """Whether it ended well, and no barrier was below its tolerance."""
        return self.task.keeps(self.outcome, self.margins)


def ride_of(controller: TaskController, controlling: Controlling, seed: int, sigma: float = 0.0) -> Ride:
    """An episode under a policy or a controller by its name; `sigma`: the deviation of what exploration adds to mu."""
    simulation = TaskSimulation(controller.task)
    controller.policy, controller.sigma = controlling, sigma
    ride = Ride(controller.task, controller.version, seed)
    last = rollout(simulation, controller, seed, lambda record: ride.moments.append(moment_of(controller, record)))
    ride.end(simulation, last)
    return ride


def moment_of(controller: TaskController, record: Record) -> Moment:
    """What a tick was that the controller has just decided."""
    state = record.state
    decided = controller.estimates, controller.decided
    return Moment(state, record.output, x_of(controller.task, state), p_of(state), *decided)

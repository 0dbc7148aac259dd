"""Walks over random plants in which each step is made for a slope that is changed at random."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np
from pydantic import BaseModel, ConfigDict
from rabbit_benchmark.cells import Terrain, storm_plant
from rabbit_experiments.assembly import Assembly, AssemblyError, resolve_policy
from rabbit_experiments.cache import Cache
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_experiments.evaluation import SeededRun, episode, episode_seeds
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.rollout import Record

CHANGE = 2.0  # degrees, the largest
STEPS = 40
WALKS = 4  # of each plant
TERRAINS: tuple[Terrain, ...] = ("flat", "stones")


class Steps(BaseModel):
    """A walk's steps from the second on: the slope that each was made for, degrees, and its mean speed less that of
    its periodic gait, m/s."""

    model_config = ConfigDict(frozen=True)

    slopes: list[float]
    speeds: list[float]


@dataclass
class Explorer:
    """Changes each slope that the regulation chooses at random, as an observer; `seen` of the steps that ended."""

    controller: Controller
    rng: np.random.Generator
    seen: Steps = field(default_factory=lambda: Steps(slopes=[], speeds=[]))

    def __post_init__(self) -> None:
        self.draw()

    def draw(self) -> None:
        """What is added at the next touchdown."""
        self.controller.settings.slope_change[:] = self.rng.uniform(-CHANGE, CHANGE)

    def __call__(self, record: Record) -> None:
        if record.output.step_index > len(self.seen.slopes):
            steps = self.controller.steps
            self.seen.slopes.append(float(steps.slopes[1]))
            self.seen.speeds.append(float(steps.speed[0]))
            self.draw()


@dataclass(frozen=True)
class ExploringWalk(SeededRun):
    """A walk with random changes of the slope."""

    model = Steps

    def do(self) -> Steps:
        simulation, controller = self.assembly.build()
        with closing(simulation):
            if controller.shape.slopes == 1:
                raise AssemblyError("gait", f"{self.assembly.controller.gait}: expected a library with slopes")
            explorer = Explorer(controller, np.random.default_rng([self.seed, 1]))
            episode(simulation, controller, self.seed, explorer)
        return explorer.seen


def exploring_walks(plants: int, seed: int, tuning: ControllerParameters) -> list[list[ExploringWalk]]:
    """Walks by plant: so many of the storm, those of `seed` without pushes, half of them on flat ground."""
    courses = iter(episode_seeds(seed, plants * WALKS).values())
    walks = []
    for number in range(plants):
        terrain = TERRAINS[number % 2]
        changes = storm_plant(number, seed, terrain) | {"push": 0.0}
        about = {"motor_lag": EVALUATION_LAG, "stones": STEPS, "terrain": terrain}
        plant = SimulationParameters.model_validate(about | changes)
        parameters = tuning if terrain == "stones" else tuning.model_copy(update={"controller": "rl-clf-qp"})
        assembly = Assembly(plant, parameters, resolve_policy(None, parameters))
        title = f"plant {number}, {terrain}"
        walks.append([ExploringWalk(assembly, next(courses), title=title) for _ in range(WALKS)])
    return walks


def gathered(plants: Sequence[Sequence[ExploringWalk]], cache: Cache) -> list[list[Steps]]:
    """What was seen of each plant."""
    return [[cache.get(walk) for walk in walks] for walks in plants]

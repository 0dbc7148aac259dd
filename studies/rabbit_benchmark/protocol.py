"""The protocol: which seeds and courses every method gets, and the runs that follow from it."""

import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import ValidationError
from rabbit_description.gait import GaitError
from rabbit_description.state import TICK_SECONDS
from rabbit_description.validation import one_line
from rabbit_experiments.assembly import AssemblyError
from rabbit_experiments.evaluation import Walk, episode_seeds
from rabbit_experiments.provenance import plain, provenance
from rabbit_experiments.source_code import CodeError
from rl_cbf_clf_controller.parameters import ParameterError
from rl_cbf_clf_controller.weights import PolicyFileError

from rabbit_benchmark.cells import Cell
from rabbit_benchmark.methods import Method

SEEDS = {"development": 61001, "reported": 61003}  # nobody tunes on the second
STONES = 20  # of a course


@dataclass(frozen=True)
class Protocol:
    """Courses of a cell, and which `seeds` they have: a name of SEEDS or a number. Methods share courses, cells do not.

    With a lab's `sensors` every plant has them, also those of cells that do not ask for it.
    """

    courses: int = 10
    seeds: str = "development"
    stones: int = STONES
    sensors: Literal["exact", "lab"] = "exact"
    plant: Literal["pybullet", "mujoco"] = "pybullet"
    tick_seconds: float = TICK_SECONDS

    @property
    def seed(self) -> int:
        """The seed of plants and courses; raises `ValueError` where `seeds` is no name and no number."""
        return SEEDS[self.seeds] if self.seeds in SEEDS else int(self.seeds)

    def walks(self, method: Method, cell: Cell) -> list[Walk]:
        """A run for each course.

        Raises:
            CannotTake: the method has no controller for the cell, or one that does not fit.
        """
        contender = method.on(cell.terrain, cell.map)
        if contender is None:
            raise CannotTake(f"no controller for {cell.terrain}")
        seed = self.seed
        tick = {} if self.tick_seconds == TICK_SECONDS else {"tick_seconds": self.tick_seconds}
        courses = episode_seeds(seed + zlib.crc32(cell.name.encode()), cell.courses(self.courses))
        try:
            title = f"{method.name}, {cell.name}"
            walks = []
            for run, course in courses.items():
                plant = cell.plant(run, seed) | ({"sensors": "lab"} if self.sensors == "lab" else {})
                assembly = contender.assembly(tick, stones=self.stones, plant=self.plant, **plant)
                walks.append(Walk(assembly, course, run, title=title))
            walks[0].assembly.make_policy()
            provenance(plain(walks[0]))
        except (CodeError, AssemblyError, GaitError, ParameterError, PolicyFileError, ValidationError) as error:
            raise CannotTake(one_line(error)) from error
        return walks


class CannotTake(ValueError):
    """Why a method is not in a cell."""


Plan = dict[tuple[Method, Cell], list[Walk] | str]
Track = Callable[[Sequence[tuple[Method, Cell]]], Iterable[tuple[Method, Cell]]]


def plan(protocol: Protocol, methods: Sequence[Method], cells: Sequence[Cell], track: Track = iter) -> Plan:
    """Runs by method and cell, or the reason why there are none; `track` is given all pairs to show how far it is."""
    plan: Plan = {}
    for method, cell in track([(method, cell) for method in methods for cell in cells]):
        try:
            plan[method, cell] = protocol.walks(method, cell)
        except CannotTake as reason:
            plan[method, cell] = str(reason)
    return plan

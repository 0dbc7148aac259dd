"""Hindsight as a teacher: on each plant a student imitates the controller that walks on longest from where it stands.

Several robots of one plant walk the same course, all driven by the student, until tick k. Then each is taken over by
another candidate, which has watched from the start, so that it has identified what it could. The candidate whose robot
walks farthest is the teacher of that plant there: its torques are what the student should have done in the last
`WATCHED` ticks before k, and what it learns from the walk after k.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from rabbit_benchmark.cells import Terrain
from rabbit_benchmark.methods import variants
from rabbit_description.gait import load_gaits
from rabbit_description.state import SWAP_TORQUE, Array
from rabbit_experiments.assembly import Assembly, make_simulation
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Outcome
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchScene
from rl_cbf_clf_controller.controller import Controller

from rabbit_rivals.joint_targets import (
    ACTIONS,
    Memory,
    action_for,
    command,
    observe,
)
from rabbit_rivals.plants import draw_plant

CANDIDATES = (  # the first of those that walk equally far is the teacher
    *(
        "oracle:gait=paper_stones:stone_tracking=1:qp_solver=daqp",
        "oracle-slopes:qp_solver=daqp",
        "best",
        "nominal-tuned:qp_solver=daqp",
    ),
    *("best-unlearned", "best:eps=0.03"),
)
STONES, WATCHED = 10, 40  # of an episode; ticks before k
LEAST = 20  # ticks after k that the teacher must walk
MOST = 1_000_000  # more than the ticks of any walk, for each of its steps
HIDDEN, RATE, BATCH, EVERY = 256, 5e-4, 512, 128  # of the network; ticks walked between two minibatches
Act = Callable[[Array], Array]  # what is read (N, READS) to actions (N, 4)


@dataclass(frozen=True)
class Lessons:
    """What a round teaches: what is read (n, READS) and what should be done (n, 4).

    `teachers`: on how many plants each candidate was the teacher; `plants`; `walked`: plants that some candidate walks;
    `ticks` of all robots; `stood`: plants on which the student still stood when it was taken over.
    """

    reads: Array
    actions: Array
    teachers: Array
    plants: int
    walked: int
    ticks: int
    stood: int


def walk_round(terrain: Terrain, plants: int, act: Act, latest: int, rng: np.random.Generator) -> Lessons:
    """Walk so many plants, taken over by each candidate at a tick that is drawn up to `latest`."""
    many = len(CANDIDATES)
    seeds = [int(seed) for seed in rng.integers(2**32, size=plants)]
    drawn = [draw_plant(terrain, np.random.default_rng([seed, 1]), STONES) for seed in seeds]
    walk = Round(terrain, drawn, seeds, rng.integers(0, latest + 1, size=plants))
    while walk.robots.size:
        walk.tick(act)
    last, steps = (values.reshape(plants, many) for values in (walk.lasted, walk.steps))  # ticks of those that fell
    teacher = np.where(steps == STONES, MOST, MOST // STONES * steps + last).argmax(axis=1)
    stood = last.max(axis=1) > walk.taken_over[::many]
    teaches = last.max(axis=1) >= walk.taken_over[::many] + LEAST
    rows = (np.arange(plants) * many + teacher)[teaches]
    kept = [(reads[np.isin(robots, rows)], wanted[np.isin(robots, rows)]) for robots, reads, wanted in walk.seen]
    reads, actions = (np.concatenate(parts) for parts in zip(*kept, strict=True))
    known = np.isfinite(actions).all(axis=1)
    return Lessons(
        reads[known],
        actions[known],
        np.bincount(teacher[teaches], minlength=many),
        plants,
        int((steps == STONES).any(axis=1).sum()),
        walk.ticks,
        int(stood.sum()),
    )


class Round:
    """The robots of several plants, one for each candidate; `robots`: those that still walk, by number.

    `lasted`, `steps`: how many ticks and steps each walked; `seen`: of a tick the robots, what was read, and what their candidates wanted.
    """

    def __init__(
        self, terrain: Terrain, plants: list[SimulationParameters], seeds: list[int], taken_over: Array
    ) -> None:
        n, (assembly, controller) = len(plants) * (many := len(CANDIDATES)), made("pd", terrain)
        gait, self._limit = load_gaits(assembly.controller.gait), assembly.controller.torque_limit
        of_robot, self.taken_over = np.repeat(seeds, many).tolist(), np.repeat(taken_over, many)
        self._reader = BatchController(controller, [controller.policy] * n)
        self._simulation = BatchSimulation([make_simulation(plant, gait) for plant in plants for _ in CANDIDATES])
        self._simulation.reset(of_robot)
        for i, seed in enumerate(of_robot):
            self._reader.reset(i, seed)
        self._candidates = [candidate(method, terrain, plants, seeds) for method in CANDIDATES]
        self._memory = Memory.of(n)
        self.robots, self.lasted, self.steps = np.arange(n), np.zeros(n, dtype=int), np.zeros(n, dtype=int)
        self.seen, self.ticks = list[tuple[Array, Array, Array]](), 0

    def tick(self, act: Act) -> None:
        """A tick of all that still walk."""
        states, robots = self._simulation.states, self.robots
        scene = self._reader.look(states)
        reads = observe(self._memory, scene)
        asked, ends = np.zeros((len(robots), ACTIONS)), np.zeros(len(robots), dtype=bool)
        for column, batch in enumerate(self._candidates):
            rows = np.flatnonzero(robots % len(CANDIDATES) == column)
            if rows.size:
                output = batch.step(states.kept(rows))
                asked[rows] = output.torque
                for i in {*output.faults, *output.errors}:
                    asked[rows[i]], ends[rows[i]] = np.nan, True
        is_over = states.tick >= self.taken_over[robots]
        wanted = action_for(scene, other_order(scene, asked))
        walked = other_order(scene, command(self._memory, scene, act(reads)).clip(-self._limit, self._limit))
        torque = np.where(is_over[:, None], np.nan_to_num(asked), walked)
        self._memory.action = np.where(is_over[:, None], np.nan_to_num(wanted), self._memory.action)
        near = states.tick >= self.taken_over[robots] - WATCHED
        self.seen.append((robots[near], reads[near].astype(np.float32), wanted[near].astype(np.float32)))
        ends &= is_over
        ends[[*{*scene.faults, *scene.errors}]] = True
        self._keep(np.flatnonzero(~ends))
        if self.robots.size:
            running = self._simulation.step(torque[~ends]).running
            self.ticks += len(running)
            self.lasted[self.robots] += 1
            self._keep(np.flatnonzero(running))

    def _keep(self, rows: Array) -> None:
        """Go on with these of them."""
        if len(rows) == len(self.robots):
            return
        left = np.delete(np.arange(len(self.robots)), rows)
        for row in left.tolist():
            simulation = self._simulation.simulations[row]
            has_walked = simulation.outcome is Outcome.WALKED
            steps = int(self._simulation.states.touchdowns[row])
            self.steps[self.robots[row]] = STONES if has_walked else min(steps, STONES - 1)
            simulation.close()
        for column, batch in enumerate(self._candidates):
            of = np.flatnonzero(self.robots % len(CANDIDATES) == column)
            kept = np.flatnonzero(np.isin(of, rows))
            if kept.size and kept.size < of.size:
                batch.keep(kept)
        self.robots = self.robots[rows]
        if rows.size:
            self._simulation.keep(rows)
            self._reader.keep(rows)
            for name in ("frames", "action", "tick"):
                setattr(self._memory, name, getattr(self._memory, name)[rows])


def candidate(method: str, terrain: Terrain, plants: list[SimulationParameters], seeds: list[int]) -> BatchController:
    """A controller beside the robots of its column, one of each plant."""
    assembly, one = made(method, terrain)
    knows = assembly.policy == "oracle"
    policies = [replace(assembly, simulation=plant).make_policy() if knows else one.policy for plant in plants]
    batch = BatchController(one, policies)
    for i, seed in enumerate(seeds):
        batch.reset(i, seed)
    return batch


@cache
def made(method: str, terrain: Terrain) -> tuple[Assembly, Controller]:
    """A candidate's assembly and its controller."""
    contender = variants(method)[0].on(terrain)
    assert contender
    assembly = contender.assembly()
    return assembly, assembly.make_controller()


def other_order(scene: BatchScene, torque: Array) -> Array:
    """Torques (N, 4) from stance/swing to left/right order, or back."""
    return np.where(scene.stance[:, None], torque[:, SWAP_TORQUE], torque)

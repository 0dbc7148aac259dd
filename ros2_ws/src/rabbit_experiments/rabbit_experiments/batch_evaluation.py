"""Seeded runs walked side by side in MuJoCo: a run leaves to the bit what it leaves alone, but for the times.

A time is a robot's share of what all of them took.
"""

import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller

from rabbit_experiments.assembly import Assembly, make_simulation
from rabbit_experiments.metrics import BatchColumns, RunResult, RunTally

if TYPE_CHECKING:
    from rabbit_sim.batch_simulation import BatchSimulation


class Run:
    """One of them: its `place` among all, its tally, and its times."""

    def __init__(self, place: int, number: int, seed: int, assembly: Assembly) -> None:
        self.place, self.seed = place, seed
        self.tally = RunTally(number, assembly.controller)
        self.seconds, self.controller, self.plant = 0.0, list[float](), list[float]()


def walk_together(
    one: Controller, assemblies: Sequence[Assembly], numbers: Sequence[int], seeds: Sequence[int]
) -> Iterator[tuple[int, RunResult]]:
    """Walks under copies of `one`, of assemblies that differ in their plants alone.

    `numbers` of the runs, `seeds` of the episodes.

    Yields place and result of a run as it ends. Raises ValueError for a plant that is not MuJoCo's.
    """
    from rabbit_sim.batch_simulation import BatchSimulation  # needs MuJoCo, which not everybody has

    first, gait = assemblies[0], load_gaits(assemblies[0].controller.gait)
    simulation = BatchSimulation([make_simulation(assembly.simulation, gait) for assembly in assemblies])
    policies = [assembly.make_policy() if first.policy == "oracle" else one.policy for assembly in assemblies]
    controller = BatchController(one, policies)
    runs = list(map(Run, range(len(seeds)), numbers, seeds, assemblies))
    states = simulation.reset(seeds)
    for run in runs:
        controller.reset(run.place, run.seed)
    columns = BatchColumns(one)
    while runs:
        start = time.perf_counter()
        output = controller.step(states)
        share, go_on = (time.perf_counter() - start) / len(runs), np.ones(len(runs), dtype=bool)
        rows = columns.of_all(output, simulation.true_force)
        for row, run in enumerate(runs):
            if row not in output.errors:
                run.tally.add(rows[row], columns)
            run.controller.append(share)
        for row, why in (output.faults | output.errors).items():
            runs[row].tally.fault, go_on[row] = why, False
        yield from ended(runs, simulation, go_on)
        runs = kept(runs, simulation, controller, go_on)
        if not runs:
            return
        begun = time.perf_counter()
        states = simulation.step(output.torque[go_on])
        now = time.perf_counter()
        for run in runs:
            run.plant.append((now - begun) / len(runs))
            run.seconds += (now - start) / len(runs)
        go_on = states.running.copy()
        yield from ended(runs, simulation, go_on)
        runs, states = kept(runs, simulation, controller, go_on), simulation.states


def ended(runs: Sequence[Run], simulation: "BatchSimulation", go_on: Array) -> Iterator[tuple[int, RunResult]]:
    """The results of those that do not go on."""
    for row in (~go_on).nonzero()[0].tolist():
        run, robot = runs[row], simulation.simulations[row]
        times = run.controller, run.plant, run.seconds
        yield run.place, run.tally.result(run.seed, robot.outcome, robot.landings, *times)
        robot.close()


def kept(runs: list[Run], simulation: "BatchSimulation", controller: BatchController, go_on: Array) -> list[Run]:
    """Those that go on, alone in simulation and controller."""
    if go_on.all():
        return runs
    rows = go_on.nonzero()[0]
    if rows.size:
        simulation.keep(rows)
        controller.keep(rows)
    return [runs[row] for row in rows]

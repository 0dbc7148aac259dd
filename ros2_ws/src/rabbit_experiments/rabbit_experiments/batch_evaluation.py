"""Seeded runs walked side by side: a run leaves to the bit what it leaves alone, but for the times.

A time is a robot's share of what all of them took.
"""

from collections.abc import Iterator, Sequence

from rabbit_description.gait import load_gaits
from rabbit_description.state import Array
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchOutput
from rl_cbf_clf_controller.controller import Controller
from rl_trainer.rollout import Shares, rollout_together

from rabbit_experiments.assembly import Assembly, make_simulation
from rabbit_experiments.metrics import BatchColumns, RunResult, RunTally


def walk_together(
    one: Controller, assemblies: Sequence[Assembly], numbers: Sequence[int], seeds: Sequence[int]
) -> Iterator[tuple[int, RunResult]]:
    """Walks under copies of `one`, of assemblies that differ in their plants alone.

    `numbers` of the runs, `seeds` of the episodes. Yields place and result of a run as it ends.
    """
    from rabbit_sim.batch_simulation import BatchSimulation  # needs MuJoCo, which not everybody has

    first, gait = assemblies[0], load_gaits(assemblies[0].controller.gait)
    simulation = BatchSimulation([make_simulation(assembly.simulation, gait) for assembly in assemblies])
    policies = [assembly.make_policy() if first.policy == "oracle" else one.policy for assembly in assemblies]
    columns, shares = BatchColumns(one), Shares()
    tallies = [RunTally(run, first.controller) for run in numbers]

    def observe(places: Array, output: BatchOutput) -> None:
        rows = columns.of_all(output, simulation.true_force)
        for row, place in enumerate(places.tolist()):
            if row not in output.errors:
                tallies[place].add(rows[row], columns)

    for ended in rollout_together(simulation, BatchController(one, policies), seeds, observe, shares):
        place, robot, tally = ended.place, ended.simulation, tallies[ended.place]
        tally.fault = ended.fault  # all runs began with the first tick, so all shares are this one's
        times = [*shares.controller], [*shares.plant], sum(shares.whole)
        yield place, tally.result(seeds[place], robot.outcome, robot.landings, *times)
        robot.close()

"""A walk in process, by what decides it."""

from rabbit_experiments.assembly import Assembly
from rabbit_sim.simulation import Simulation
from rl_trainer.rollout import Record, rollout


def walked(parts: Assembly, seed: int) -> tuple[list[Record], Simulation]:
    """All its ticks; the simulation, which is closed and knows how it ended."""
    simulation, controller = parts.build()
    records: list[Record] = []
    rollout(simulation, controller, seed, records.append)
    simulation.close()
    return records, simulation

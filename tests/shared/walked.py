"""A walk in process, by what decides it."""

from dataclasses import replace
from typing import Any

from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.parameters import load_parameters
from rl_trainer.rollout import Record, rollout


def make_assembly(controller: str = "clf-qp", policy: str = "zero", **plant: object) -> Assembly:
    """Our parameters; the terrain is the controller's own, of four stones or steps."""
    parameters = load_parameters("ours", controller=controller)
    settings = {"motor_lag": EVALUATION_LAG, "terrain": parameters.terrain, "stones": 4, **plant}
    return Assembly(SimulationParameters.model_validate(settings), parameters, resolve_policy(policy, parameters))


def with_law(parts: Assembly, **changes: Any) -> Assembly:
    """The same with other parameters of the controller."""
    return replace(parts, controller=parts.controller.model_copy(update=changes))


def walked(parts: Assembly, seed: int) -> tuple[list[Record], Simulation]:
    """All its ticks; the simulation, which is closed and knows how it ended."""
    simulation, controller = parts.build()
    records: list[Record] = []
    rollout(simulation, controller, seed, records.append)
    simulation.close()
    return records, simulation

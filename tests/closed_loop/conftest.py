"""Short walks in process, each determined by its seed."""

from collections.abc import Callable

import pytest
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters

MakeAssembly = Callable[..., Assembly]


def assembly(controller: str = "clf-qp", policy: str = "zero", **plant: object) -> Assembly:
    """Our parameters; the terrain is the controller's own."""
    parameters = load_parameters("ours", controller=controller)
    terrain = parameters.terrain
    settings = {"motor_lag": EVALUATION_LAG, "terrain": terrain, "stones": 4, **plant}
    return Assembly(SimulationParameters.model_validate(settings), parameters, policy)


@pytest.fixture
def make_assembly() -> MakeAssembly:
    """`assembly`."""
    return assembly

"""A row of the page is the tick it is made of, and what it draws lies where the plant has it."""

import numpy as np
import pytest
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array
from rabbit_experiments.walk_records import about_walk
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.simulation import Simulation
from rabbit_viewer.page.rows import RowMaker
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.oracle import OraclePolicy, TruePlant
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_trainer.rollout import Record, rollout

CONTROLLER = ControllerParameters(controller="cbf-clf-qp")
PLANT = SimulationParameters(stones=3, stone_height=0.004)
Walked = tuple[list[Record], Simulation]


@pytest.fixture(scope="module")
def walked() -> Walked:
    """Three stones."""
    gait = load_gaits(CONTROLLER.gait)
    simulation = Simulation(PLANT, gait)
    records: list[Record] = []
    rollout(simulation, Controller(CONTROLLER, gait, ZeroPolicy(CONTROLLER.problem)), 1, records.append)
    simulation.close()
    return records, simulation


def maker_of(output: ControllerOutput, plant: SimulationParameters, policy: str, knows_plant: bool = False) -> RowMaker:
    about = about_walk(CONTROLLER, plant, policy, 1, "walked")
    return RowMaker(about, output.quantities, output.barrier_names, knows_plant)


def rows_of(records: list[Record]) -> tuple[Array, tuple[str, ...]]:
    """All rows (n, columns), and the columns."""
    maker = maker_of(records[0].output, PLANT, "zero")
    return np.array([maker.row(record.state, record.output) for record in records]), maker.columns


def test_stones_lie_where_the_plant_placed_them(walked: Walked) -> None:
    records, simulation = walked
    rows, columns = rows_of(records)
    edges = rows[:, [columns.index(name) for name in ("stone_near", "stone_far", "stone_top")]]
    seen = np.unique(edges[np.isfinite(edges[:, 0])], axis=0)
    np.testing.assert_allclose(seen, simulation.stones[1:], atol=5e-4)  # the foot goes on within its touchdown's tick


def test_with_exact_estimates_the_true_error_is_the_estimated_one() -> None:
    """Of the tick before, as everything that a tick says of the model's error."""
    gait = load_gaits(CONTROLLER.gait)
    plant = PLANT.model_copy(update={"mass_scale": 1.5})
    simulation, records = Simulation(plant, gait), list[Record]()
    oracle = OraclePolicy(TruePlant(perturbed_urdf(plant)))
    rollout(simulation, Controller(CONTROLLER, gait, oracle), 1, records.append)
    simulation.close()
    maker = maker_of(records[0].output, plant, "oracle", knows_plant=True)
    errors = [each.output.alpha @ each.output.mu + each.output.beta for each in records]
    rows = np.array([maker.row(r.state, r.output, true=error) for r, error in zip(records, errors, strict=True)])
    column = dict(zip(maker.columns, rows.T, strict=True))
    for name in records[0].output.quantities:
        np.testing.assert_array_equal(column[f"true_{name}"], column[f"estimated_{name}"])
    assert np.isfinite(column["true_V"]).mean() > 0.9

"""What a film shows after a recorded walk's end: the same robot, limp, by the laws of mechanics."""

from functools import cache
from typing import Any

import numpy as np
import pinocchio
import pytest
from rabbit_description.state import Array
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import record_walk
from rabbit_experiments.walk_records import ARRAYS, PLANT, WalkRecords
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import gravity
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_viewer.geometry import feet, torso_points
from rabbit_viewer.limp_fall import COMPUTED_FROM, LYING, with_fall
from rl_cbf_clf_controller.parameters import load_parameters

HEAVY: dict[str, Any] = {"mass_scale": 2.0, "stones": 6}
FALLS = {
    "stones": HEAVY,
    "flat": HEAVY | {"terrain": "flat", "mass_scale": 3.0},
    "hill": HEAVY | {"terrain": "flat", "mass_scale": 3.0, "slope": 8.0},
    "mujoco": HEAVY | {"plant": "mujoco"},
}


@cache
def fallen(case: str) -> WalkRecords:
    """The nominal robot falls."""
    plant = SimulationParameters.model_validate(FALLS[case])
    own = load_parameters("ours", controller="clf-qp" if plant.terrain == "flat" else "cbf-clf-qp")
    return record_walk(Assembly(plant, own, "zero"), seed=1)


def energy(walk: WalkRecords) -> Array:
    """Of each tick's state in the true robot, J."""
    plant = SimulationParameters.model_validate(walk.about[PLANT])
    model = pinocchio.buildModelFromXML(perturbed_urdf(plant))
    model.gravity.linear = np.array([*gravity(plant.slope)]) @ [[1, 0, 0], [0, 0, 1]]
    data = model.createData()
    states = zip(walk.q, walk.dq, strict=True)
    return np.array([pinocchio.computeMechanicalEnergy(model, data, q, dq) for q, dq in states])


@pytest.mark.parametrize("case", FALLS)
def test_a_limp_robot_falls_to_the_ground_and_gains_no_energy(case: str) -> None:
    walk = fallen(case)
    longer, end = with_fall(walk), len(walk.tick)
    assert longer.about[COMPUTED_FROM] == end
    for name in ARRAYS.keys() - {"landings"}:
        np.testing.assert_array_equal(getattr(longer, name)[:end], getattr(walk, name), err_msg=name)
    np.testing.assert_array_equal(np.diff(longer.tick), 1)
    assert not longer.torque[end:].any()
    assert np.isnan(longer.V[end:]).all()
    limp = energy(longer)[end:]  # the first of them is where the last recorded torque has brought it
    assert np.diff(limp).max() < 0.2  # J, of some 100: a contact's spring gives back what it took
    assert limp[-1] < limp[0]
    assert torso_points(longer.q[-1:])[0, :, 1].min() < LYING
    assert feet(longer.q[end:])[:, :, 1].min() > -0.01 or walk.about["terrain"] == "stones"  # gaps have no ground

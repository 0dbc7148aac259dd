"""Walks with a lab's sensors alone: the state estimator is consistent, and the robot walks on what it says."""

import pytest
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.estimation_errors import estimated_walk, summarise
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

CONTROLLER = ControllerParameters(
    controller="rl-cbf-clf-qp",
    adaptation="identification",
    objective="pd_centred",
    gait="paper_stones",
    stone_margin=0.01,
)


@pytest.mark.parametrize(("plant", "scale"), [("pybullet", 1.0), ("mujoco", 2.0), ("rigid", 2.0)])
def test_the_filter_knows_how_far_off_it_is(plant, scale):
    """A consistent filter's mean NEES and NIS are 1; bounds of the mean over walks: `rabbit estimator`."""
    plant = SimulationParameters(sensors="lab", plant=plant, mass_scale=scale, motor_lag=0.004, stones=8)
    found = summarise([estimated_walk(Assembly(plant, CONTROLLER, "zero"), seed) for seed in (1, 2)])
    assert found["outcomes"] == {"walked": 2}
    assert 0.4 < found["nees"] < 1.6  # of two walks, each with sensors' errors that stay as they are
    assert 0.5 < found["nis"] < 1.2
    for name, error in found["rms"].items():
        assert error < 2 * found["claimed"][name]

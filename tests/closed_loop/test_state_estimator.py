"""Walks with a lab's sensors alone: the state estimator is consistent, and the robot walks on what it says."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from rabbit_description.gait import load_gaits
from rabbit_estimation.estimation_errors import estimated_walk, summarise
from rabbit_experiments.assembly import Assembly, make_estimator
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Outcome, Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_trainer.rollout import rollout

OURS = {"controller": "rl-cbf-clf-qp", "adaptation": "identification", "objective": "pd_centred"}
CONTROLLER = ControllerParameters(**OURS, gait="paper_stones", stone_margin=0.01)


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


def with_glitch(estimator, at, joint, glitch):
    """The estimator's `update`, told of another angle in one tick."""

    def update(state):
        if state.tick == at:
            angles = state.sensors.joint_angles + glitch * (np.arange(4) == joint)
            state = replace(state, sensors=replace(state.sensors, joint_angles=angles))
        return estimator.update(state)

    return update


@pytest.mark.parametrize("glitch", [0.05, 0.3, 3.0])
def test_a_glitch_of_an_encoder_does_not_fell_the_robot(glitch):
    """Soon after the start, in the middle of steps, and around the first two touchdowns, in ticks 46 and 109."""
    plant = SimulationParameters(sensors="lab", mass_scale=2, motor_lag=0.004, stones=3)
    gait = load_gaits(CONTROLLER.gait)
    for number, tick in enumerate((5, 25, 45, 46, 52, 80, 109, 110)):
        estimate = with_glitch(make_estimator(plant), tick, number % 4, glitch)
        with closing(Simulation(plant, gait, estimate)) as simulation:
            rollout(simulation, Controller(CONTROLLER, gait, ZeroPolicy(CONTROLLER.problem)), number)
            assert simulation.outcome is Outcome.WALKED, tick

"""What the best controller walks: slopes, heights, friction and delays that its model does not have."""

from dataclasses import replace

import pytest
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.evaluation import walk
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_trainer.rollout import rollout

SEED = 3
BEST = load_parameters("best")
WITHOUT_SLOPES = load_parameters("best", gait="paper_stones")


def stones(controller: ControllerParameters, **plant: object) -> Assembly:
    """A course of ten at mass scale 2."""
    plant = {"mass_scale": 2.0, "motor_lag": 0.004, "terrain": "stones", "stones": 10, **plant}
    return Assembly(SimulationParameters.model_validate(plant), controller, resolve_policy(None, controller))


@pytest.mark.parametrize("plant", [{"slope": 2.0}, {"stone_height": 0.02}], ids=str)
def test_best_walks_where_gaits_for_level_ground_fall(plant: dict[str, float]) -> None:
    assert walk(stones(BEST, **plant), 0, SEED).row.success
    assert not walk(stones(WITHOUT_SLOPES, **plant), 0, SEED).row.success


def test_late_torques_need_the_prediction() -> None:
    """With it at least 8 of 10 courses are walked; without it at most half, if the robot found is always believed."""
    believing = load_parameters("best", prediction=False, doubt_eps=0.0)
    for controller, least, most in ((BEST, 8, 10), (believing, 0, 5)):
        walked = sum(walk(stones(controller, torque_delay=0.008), 0, SEED + run).row.success for run in range(10))
        assert walked in range(least, most + 1)


@pytest.mark.parametrize("slope", [-2.7, 1.5])
def test_best_walks_a_slope_that_its_sensors_see_as_other_heights(slope: float) -> None:
    """A lab's sensors measure the pitch from the vertical, so each landing is lower or higher than the gait's."""
    on_flat = load_parameters("best", controller="rl-clf-qp")
    assert walk(stones(on_flat, terrain="flat", slope=slope, sensors="lab"), 0, SEED).row.success


def settled(slope: float) -> float:
    """The slope, degrees, that steps on flat ground of such a `slope` are made for in the end, with exact estimates."""
    unadapted = {"adaptation": "none", "prediction": False, "doubt_eps": 0.0}
    controller = load_parameters("best", controller="rl-clf-qp", **unadapted)
    parts = replace(stones(controller, terrain="flat", slope=slope, stones=30, mass_scale=1.0), policy="oracle")
    simulation, built = parts.build()
    found: list[float] = []
    rollout(simulation, built, SEED, lambda record: found.append(float(built.steps.slopes[0])))
    simulation.close()
    return sum(found[-500:]) / 500


def test_the_slope_of_the_steps_follows_the_true_one() -> None:
    """But for an offset, which is what speed the motors' lag and the ground's give cost on level ground."""
    level = settled(0.0)
    assert abs(level) < 1.0
    for slope in (1.5, -3.0):
        assert settled(slope) - level == pytest.approx(slope, abs=0.3)

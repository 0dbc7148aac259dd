"""The model of the speed from step to step: the fit finds known coefficients, and walks explore."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy_steps
import pytest
from rabbit_description.gait import load_gaits
from rabbit_experiments.assembly import AssemblyError
from rabbit_gait_design.speed_model.fit import errors, fitted, rows, without_mean
from rabbit_gait_design.speed_model.walks import CHANGE, Explorer, Steps, exploring_walks
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.speed_regulation import MOST

TRUTH = np.array([0.6, -0.05, 0.15, -0.03])


def linear_walk(rng: np.random.Generator, constant: float, noise: float, seeming: float, steps: int = 40) -> Steps:
    """Speeds that follow the model but for the noise, and are seen with an error of `seeming`, both m/s."""
    slopes = rng.uniform(-3, 3, steps)
    speeds = [0.0, 0.0, 0.0]
    for k in range(3, steps):
        regressors = np.array([speeds[-1], slopes[k], slopes[k - 1], slopes[k - 2]])
        speeds.append(float(TRUTH @ regressors + constant + noise * rng.standard_normal()))
    seen = np.array(speeds) + seeming * rng.standard_normal(steps)
    return Steps(slopes=slopes.tolist(), speeds=seen.tolist())


def linear_plants(noise: float, seed: int, plants: int = 40, seeming: float = 0.0) -> list[list[Steps]]:
    rng = np.random.default_rng(seed)
    constants = rng.uniform(-0.3, 0.3, plants)
    return [[linear_walk(rng, constant, noise, seeming) for _ in range(4)] for constant in constants]


def test_without_noise_the_coefficients_are_found_exactly() -> None:
    model = fitted(linear_plants(0.0, 1))
    np.testing.assert_allclose(model.coefficients, TRUTH, atol=1e-9)
    assert errors(TRUTH, linear_plants(0.0, 2))[0] == pytest.approx(0.0, abs=1e-9)


def test_with_noise_the_intervals_hold_the_truth_about_as_often_as_they_say() -> None:
    """Of 4 x 25 intervals of 95% some 95; fewer than 85 would be 4.6 standard deviations away."""
    models = [fitted(linear_plants(0.03, seed, seeming=0.05)) for seed in range(25)]
    held = [np.abs(model.coefficients - TRUTH) < model.half_widths for model in models]
    assert np.sum(held) >= 85
    error, spread = errors(TRUTH, linear_plants(0.03, 99))
    assert error == pytest.approx(0.03, rel=0.05)
    assert error < spread


def test_errors_of_the_speeds_do_not_bias_what_is_found() -> None:
    """As large as the noise, they take least squares' A down from 0.6; the instruments know nothing of them."""
    plants = linear_plants(0.05, 3, plants=200, seeming=0.05)
    x, y, _ = (np.concatenate(each) for each in zip(*without_mean(plants), strict=True))
    assert np.linalg.lstsq(x, y, rcond=None)[0][0] < 0.5
    np.testing.assert_allclose(fitted(plants).coefficients, TRUTH, atol=0.03)


def test_a_walk_s_last_step_and_the_first_ones_are_left_out() -> None:
    walk = Steps(slopes=[1, 2, 3, 4, 5, 6, 7, 8], speeds=[10, 20, 30, 40, 50, 60, 70, 80])
    x, y, z = rows([walk])
    np.testing.assert_array_equal(x, [[50, 6, 5, 4], [60, 7, 6, 5]])
    np.testing.assert_array_equal(y, [60, 70])
    np.testing.assert_array_equal(z, [[6, 5, 4, 3, 2], [7, 6, 5, 4, 3]])


def test_slopes_that_explore_stay_within_the_library_and_are_seen() -> None:
    gaits = load_gaits("slopes")
    steps, (q, dq), slopes = numpy_steps.Steps(gaits, load_parameters("best"), read_robot()), gaits.x_start, [0.0]
    controller: Any = SimpleNamespace(settings=SimpleNamespace(slope_change=np.zeros(1)))
    explorer = Explorer(controller, np.random.default_rng(1))
    for index, haste in enumerate(np.random.default_rng(2).uniform(0.7, 1.3, 200), 1):
        steps.slope_change = float(controller.settings.slope_change[0])
        steps.begin(np.concatenate([q, haste * dq]), 0.45)
        controller.steps = SimpleNamespace(slopes=steps.kept("slopes"), speed=steps.kept("speed"))
        explorer(SimpleNamespace(output=SimpleNamespace(step_index=index)))
        slopes.append(steps.slope)
    assert np.abs(slopes).max() <= gaits.slopes[-1]
    changes = np.diff(slopes)
    assert np.abs(changes).max() <= MOST + CHANGE + 1e-12
    assert np.std(changes) > CHANGE / np.sqrt(3)
    assert explorer.seen.slopes == slopes[:-1]
    assert explorer.seen.speeds == [steps.kept("speed")[0]] * 200, "each step is as long and takes as long"


def test_a_walk_explores_and_a_gait_without_slopes_is_refused() -> None:
    tuning = load_parameters("best")
    walks = exploring_walks(2, 5, tuning)
    assert [each[0].assembly.simulation.terrain for each in walks] == ["flat", "stones"]
    assert {walk.assembly.simulation.push for each in walks for walk in each} == {0.0}
    steps = walks[0][0].do()
    assert len(steps.slopes) == len(steps.speeds) >= 1
    assert walks[0][0].do() == steps, "the same seed, the same walk"
    with pytest.raises(AssemblyError, match="expected a library with slopes"):
        exploring_walks(1, 5, tuning.model_copy(update={"gait": "stones_0350_080"}))[0][0].do()

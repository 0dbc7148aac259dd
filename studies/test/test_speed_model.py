"""The model of the speed from step to step: the fit finds known coefficients, and walks explore."""

import numpy as np
import pytest
from rabbit_experiments.assembly import AssemblyError
from rabbit_gait_design.speed_model.fit import errors, fitted, without_mean
from rabbit_gait_design.speed_model.walks import Steps, exploring_walks
from rl_cbf_clf_controller.parameters import load_parameters

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

"""Ways to differentiate, against polynomials and against what white noise must become."""

import numpy as np
import pytest
from rabbit_description.gait import load_gait
from rabbit_description.state import TICK_SECONDS, Array
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import RecordedWalk
from rabbit_reproduce.differentiation import (
    CUTOFF,
    METHODS,
    Derivative,
    Step,
    difference,
    low_passed,
    rates,
    savitzky_golay,
    steps,
)
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

TICKS = np.arange(40) * TICK_SECONDS
RNG = np.random.default_rng(1)


def polynomial(*coefficients: float) -> Array:
    """The same in all six columns."""
    return np.repeat(np.polyval(coefficients, TICKS)[:, None], 6, axis=1)


@pytest.mark.parametrize("method", [difference, savitzky_golay])
def test_the_mean_slope_of_a_parabola_is_exact(method: Derivative) -> None:
    """Over a tick it is 2 a t + b at the tick's middle."""
    middle = (TICKS[1:] + TICKS[:-1]) / 2
    np.testing.assert_allclose(method(polynomial(3, -2, 1))[:, 0], 6 * middle - 2, atol=1e-9)


def test_the_low_pass_lags_behind_a_ramp_and_catches_up() -> None:
    """Its slope is 1 - exp(-cutoff (k + 1) dt) of the ramp's in tick k, as the first-order filter's step response."""
    ticks = np.arange(len(TICKS) - 1)
    np.testing.assert_allclose(low_passed(polynomial(1, 5))[:, 0], 1 - np.exp(-CUTOFF * TICK_SECONDS * (ticks + 1)))


@pytest.mark.parametrize("method", METHODS.values())
def test_a_constant_has_no_slope(method: Derivative) -> None:
    np.testing.assert_allclose(method(polynomial(7)), 0, atol=1e-9)


def test_white_noise_through_one_difference_and_through_the_parabola() -> None:
    """Deviations sqrt(2) / dt; and of the mean of two slopes of (-2 -1 0 1 2) / 10 dt: (-2 -3 -1 1 3 2) / 20 dt."""
    noise = RNG.standard_normal((20_000, 6))
    for method, gain in ((difference, np.sqrt(2)), (savitzky_golay, np.sqrt(4 + 9 + 1 + 1 + 9 + 4) / 20)):
        assert np.std(method(noise)) * TICK_SECONDS == pytest.approx(gain, rel=0.02)


def test_errors_of_a_step_are_those_of_the_ticks_kept_and_grow_with_the_noise() -> None:
    """V-dot's is LgV times that of y''; without noise one difference has none."""
    z, noise = RNG.standard_normal((2, 30, 6))
    LgV = np.tile((1.0, 0, 0, 0), (30, 1))
    step = Step(z, noise[None], LgV, np.ones((29, 3)), np.arange(29) >= 4)
    assert not step.errors(difference, 0.0, 0).any()
    once, twice = (step.errors(difference, sigma, 0) for sigma in (0.1, 0.2))
    assert once.shape == (25, 3)
    np.testing.assert_allclose(twice, 2 * once, atol=1e-9)
    np.testing.assert_allclose(once[:, 0], 0.1 * difference(noise)[4:, 0], atol=1e-9)
    np.testing.assert_allclose(once[:, 1:], 0.1 * difference(noise)[4:, 4:], atol=1e-9)


def test_what_noise_makes_of_the_rates_is_what_the_true_rates_make() -> None:
    """They are linear in the angles' rates, with no constant term: the robot's own give what the controller read."""
    law, plant = ControllerParameters(controller="cbf-clf-qp"), SimulationParameters(stones=2, stone_height=0.02)
    walk = RecordedWalk(Assembly(plant, law, "oracle"), 7).do()
    gait = load_gait(law.gait)
    rate = rates(walk, gait)
    (first, second) = steps(walk, gait, 1)
    z = np.array([rate(tick, dq[2:]) for tick, dq in enumerate(walk.dq[: len(first.z) + len(second.z)])])
    np.testing.assert_allclose(z, np.concatenate([first.z, second.z]), atol=1e-9)

"""The gauge of the rates' noise: white noise on a smooth motion is found, and nothing is said before it is known."""

from itertools import pairwise

import numpy as np
import pytest
from rl_cbf_clf_controller.identification import RATE_NOISE
from rl_cbf_clf_controller.rate_noise import CORRELATED, FIRST_DIFFERENCES, RateNoise

TICK = 0.01  # s


def fed(rates: np.ndarray, *, pause_every: int = 10**9) -> RateNoise:
    noise = RateNoise()
    for number, (start, end) in enumerate(pairwise(rates)):
        if number % pause_every == 0:
            noise.interrupt()
        noise.add(start, end)
    return noise


@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.2])
def test_white_noise_on_a_swing_of_the_torso_is_found(sigma: float) -> None:
    time = TICK * np.arange(4000)
    rates = 1.5 * np.sin(2 * np.pi * 2.0 * time) + sigma * np.random.default_rng(0).standard_normal(len(time))
    for pause_every in (10**9, 20):
        variance = fed(rates, pause_every=pause_every).variance
        assert variance is not None
        found = np.sqrt((variance - RATE_NOISE**2) / CORRELATED)
        assert found == pytest.approx(sigma, abs=0.012), "of the swing itself 0.01 rad/s is left"


def test_it_waits_for_its_first_differences() -> None:
    noise = RateNoise()
    for end in range(1, FIRST_DIFFERENCES + 1):
        noise.add(end - 1.0, float(end))
        assert noise.variance is None
    noise.add(FIRST_DIFFERENCES, FIRST_DIFFERENCES + 1.0)
    assert noise.variance == pytest.approx(RATE_NOISE**2), "even acceleration is no noise"


def test_a_pause_is_no_noise_and_a_reset_forgets() -> None:
    noise = RateNoise()
    for start in (0.0, 5.0, -5.0):
        noise.interrupt()
        for at in range(4):
            noise.add(start + at, start + at + 1)
    assert noise.variance == pytest.approx(RATE_NOISE**2)
    noise.reset()
    assert noise.variance is None

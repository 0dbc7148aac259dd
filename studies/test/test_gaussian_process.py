"""Posterior and likelihood against closed forms; what must hold of a kernel that is affine in the input."""

import numpy as np
import pytest
from rabbit_rivals.gaussian_process import Kernel, Posterior, kernel_of, negative_log_likelihood, spread

N, D, M = 40, 3, 2


def data(noise: float = 0.1):
    rng = np.random.default_rng(4)
    x, w = rng.normal(size=(N, D)), rng.normal(size=(N, M))
    z = np.sin(x[:, 0]) + w[:, 0] * np.cos(x[:, 1]) - 0.5 * w[:, 1]
    return Kernel(np.array([1.0, 0.8, 0.5]), np.array([1.0, 2.0, 1.5]), noise), x, w, z


def test_with_all_transitions_it_is_the_exact_posterior() -> None:
    kernel, x, w, z = data()
    at, v = np.array([0.3, -0.2, 0.5]), np.array([1.0, 0.4, -0.7])
    inverse = np.linalg.inv(kernel(x, w, x, w) + kernel.noise**2 * np.eye(N))
    row = kernel(at[None], v[None, 1:], x, w)[0]
    mean, covariance = Posterior(kernel, x, w, z, np.arange(N)).at(at)
    assert v @ mean == pytest.approx(row @ inverse @ z, abs=1e-4)
    prior = kernel.variance(v[None, 1:])[0]
    assert v @ covariance @ v == pytest.approx(prior - row @ inverse @ row, abs=1e-4)


def test_a_few_inducing_transitions_still_know_all_and_far_away_the_prior_holds() -> None:
    kernel, x, w, z = data()
    posterior = Posterior(kernel, x, w, z, spread(kernel, x, w, 15))
    for at in np.random.default_rng(1).normal(size=(20, D)):
        _, covariance = posterior.at(at)
        assert np.linalg.eigvalsh(covariance).min() > 0
        assert np.linalg.eigvalsh(np.diag(kernel.signal**2) - covariance).min() > -1e-9
    mean, covariance = posterior.at(np.full(D, 50.0))
    assert mean == pytest.approx(np.zeros(M + 1), abs=1e-9)
    assert covariance == pytest.approx(np.diag(kernel.signal**2))


def test_the_gradient_of_the_likelihood_is_its_slope() -> None:
    _, x, w, z = data()
    at = np.log([1.0, 0.8, 0.5, 1.0, 2.0, 1.5, 0.2])
    _, gradient = negative_log_likelihood(at, x, w, z)
    for i, step in enumerate(1e-5 * np.eye(len(at))):
        above, below = (negative_log_likelihood(at + sign * step, x, w, z)[0] for sign in (1, -1))
        assert gradient[i] == pytest.approx((above - below) / 2e-5, rel=1e-4, abs=1e-4)
    assert kernel_of(at, M).noise == pytest.approx(0.2)

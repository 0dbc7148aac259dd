"""Estimates: sums, and shapes that do not fit."""

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates

N, M = 5, 4


def drawn(seed: int) -> Estimates:
    rng = np.random.default_rng(seed)
    return Estimates(rng.normal(size=(N, M)), rng.normal(size=N), rng.normal(size=(M, M + 1)))


def test_errors_add_up() -> None:
    first, second, mu = drawn(1), drawn(2), np.array([1.0, -2.0, 3.0, 0.5])
    both = first + second
    assert both.error(mu) == pytest.approx(first.error(mu) + second.error(mu))
    assert both.output_error == pytest.approx(first.output_error + second.output_error)
    assert (first + Estimates(second.alpha, second.beta)).output_error is None
    for name, value in vars(first + Estimates.zero(N, M)).items():
        assert value == pytest.approx(getattr(first, name))


def test_shapes_fit_together() -> None:
    with pytest.raises(ValueError, match=r"alpha \(4, 5\), beta \(5,\)"):
        Estimates(np.zeros((4, 5)), np.zeros(5))

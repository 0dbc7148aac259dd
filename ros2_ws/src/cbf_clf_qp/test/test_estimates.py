"""Estimates: there and back, sums, and shapes that do not fit."""

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates

N, M = 5, 4


def drawn(seed: int) -> Estimates:
    rng = np.random.default_rng(seed)
    return Estimates(rng.normal(size=(N, M)), rng.normal(size=N), rng.normal(size=(M, M + 1)))


def test_a_vector_holds_them_all() -> None:
    """All alphas, then all betas, then the error of the outputs, where it is known."""
    given = drawn(0)
    unknown = Estimates(given.alpha, given.beta)
    assert given.flat == pytest.approx([*given.alpha.ravel(), *given.beta, *np.ravel(given.output_error)])
    for each in (given, unknown):
        found = Estimates.from_flat(each.flat, N, M)
        for name in ("alpha", "beta", "output_error"):
            expected = getattr(each, name)
            assert getattr(found, name) == (None if expected is None else pytest.approx(expected))


def test_errors_add_up() -> None:
    first, second, mu = drawn(1), drawn(2), np.array([1.0, -2.0, 3.0, 0.5])
    both = first + second
    assert both.error(mu) == pytest.approx(first.error(mu) + second.error(mu))
    assert both.output_error == pytest.approx(first.output_error + second.output_error)
    assert (first + Estimates(second.alpha, second.beta)).output_error is None
    assert (first + Estimates.zero(N, M)).flat == pytest.approx(first.flat)


def test_zeros_are_ones_own() -> None:
    """What one changes is not another's."""
    Estimates.zero(N, M).alpha[0, 0] = 1
    assert not Estimates.zero(N, M).flat.any()


@pytest.mark.parametrize("size", [0, 24, 26, 44])
def test_a_vector_of_another_length_is_refused(size: int) -> None:
    with pytest.raises(ValueError, match="expected 25, or 45 with an output error"):
        Estimates.from_flat(np.zeros(size), N, M)


def test_shapes_fit_together() -> None:
    with pytest.raises(ValueError, match=r"alpha \(4, 5\), beta \(5,\)"):
        Estimates(np.zeros((4, 5)), np.zeros(5))

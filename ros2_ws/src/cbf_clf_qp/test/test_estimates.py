"""Estimates: there and back, sums, and shapes that do not fit."""

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates

N, M = 5, 4


def drawn(seed: int) -> Estimates:
    rng = np.random.default_rng(seed)
    return Estimates(rng.normal(size=(N, M)), rng.normal(size=N), rng.normal(size=(M, M + 1)))


def test_a_vector_holds_them_all() -> None:
    """All alphas, then all betas, then the error of the outputs."""
    given = drawn(0)
    found, flat = Estimates.from_packed(given.packed, M), Estimates.from_flat(given.flat, M)
    for name in ("alpha", "beta"):
        assert getattr(found, name) == pytest.approx(getattr(given, name))
        assert getattr(flat, name) == pytest.approx(getattr(given, name))
    assert found.output_error == pytest.approx(given.output_error)
    assert flat.output_error is None
    assert flat.packed == pytest.approx([*given.flat, *np.zeros(M * (M + 1))])
    assert Estimates.from_flat(np.arange(25.0), M).beta == pytest.approx(np.arange(20, 25))


def test_errors_add_up() -> None:
    first, second, mu = drawn(1), drawn(2), np.array([1.0, -2.0, 3.0, 0.5])
    both = first + second
    assert both.error(mu) == pytest.approx(first.error(mu) + second.error(mu))
    assert both.affine(mu) == pytest.approx(both.error(mu))
    assert both.output_error == pytest.approx(first.output_error + second.output_error)
    assert (first + Estimates(second.alpha, second.beta)).output_error is None
    assert (first + Estimates.zero(N, M)).packed == pytest.approx(first.packed)


def test_zeros_are_ones_own() -> None:
    """What one changes is not another's."""
    Estimates.zero(N, M).alpha[0, 0] = 1
    assert Estimates.zero(N, M).packed == pytest.approx(np.zeros((N + M) * (M + 1)))


@pytest.mark.parametrize("size", [0, 24])
def test_a_vector_of_another_length_is_refused(size: int) -> None:
    with pytest.raises(ValueError, match="expected 5 values for each quantity"):
        Estimates.from_flat(np.zeros(size), M)


def test_shapes_fit_together() -> None:
    with pytest.raises(ValueError, match=r"alpha \(4, 5\), beta \(5,\)"):
        Estimates(np.zeros((4, 5)), np.zeros(5))

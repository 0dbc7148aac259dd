"""Estimates as the one vector that is published: there and back."""

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from rl_cbf_clf_controller.controller_output import flat, from_flat

N, M = 5, 4


def test_a_vector_holds_them_all():
    """All alphas, then all betas, then the error of the outputs, where it is known."""
    rng = np.random.default_rng(0)
    given = Estimates(rng.normal(size=(N, M)), rng.normal(size=N), rng.normal(size=(M, M + 1)))
    unknown = Estimates(given.alpha, given.beta)
    assert flat(given) == pytest.approx([*given.alpha.ravel(), *given.beta, *np.ravel(given.output_error)])
    for each in (given, unknown):
        found = from_flat(flat(each), N, M)
        for name in ("alpha", "beta", "output_error"):
            expected = getattr(each, name)
            assert getattr(found, name) == (None if expected is None else pytest.approx(expected))


def test_it_is_in_the_papers_order():
    estimates = from_flat(np.arange(25.0), N, M)
    np.testing.assert_array_equal(estimates.alpha[1], [4, 5, 6, 7])
    np.testing.assert_array_equal(estimates.beta, [20, 21, 22, 23, 24])
    np.testing.assert_array_equal(flat(estimates), np.arange(25.0))


@pytest.mark.parametrize("size", [0, 24, 26, 44])
def test_a_vector_of_another_length_is_refused(size):
    with pytest.raises(ValueError, match="expected 25, or 45 with an output error"):
        from_flat(np.zeros(size), N, M)

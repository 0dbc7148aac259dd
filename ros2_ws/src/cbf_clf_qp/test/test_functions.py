"""Functions for numpy: what is left out, names; estimates: sums, and shapes that do not fit."""

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import NumpyFunction
from cbf_clf_qp.estimates import Estimates


def test_inputs_left_out_are_zero() -> None:
    """Also where an earlier call gave them; and a result is not the next one's."""
    a, b = ca.SX.sym("a", 2), ca.SX.sym("b", 2, 2)
    function = NumpyFunction.of("f", {"a": a, "b": b}, {"sum": a + b @ ca.SX([1, 10]), "b": b})
    given, matrix = np.array([1.0, 2.0]), np.array([[3.0, 4.0], [5.0, 6.0]])
    first = function(given, matrix)
    assert function(given).sum == pytest.approx([1, 2])
    assert (first.sum, first.b) == (pytest.approx([44, 67]), pytest.approx(matrix))
    assert function(given, matrix).sum == pytest.approx([44, 67])
    with pytest.raises(ValueError, match="b has 2 numbers; expected 4"):
        function(given, given)
    with pytest.raises(ValueError, match="3 inputs; expected a, b"):
        function(given, matrix, given)
    with pytest.raises(AttributeError, match="no value difference: expected one of sum, b"):
        _ = first.difference


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

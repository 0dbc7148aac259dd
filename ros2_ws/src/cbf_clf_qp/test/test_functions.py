"""Functions for numpy: what is left out, names; building in several threads."""

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import NumpyFunction


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

"""Functions for numpy: what is left out, names; building in several threads."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import NumpyFunction
from cbf_clf_qp.functions import one_at_a_time

THREADS = 4


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


def test_ticks_may_be_built_in_several_threads() -> None:
    """Functions of CasADi, which is not made for it."""

    def build(number: int) -> float:
        return float(squared(number)(np.array([3.0])).y[0])

    @one_at_a_time
    def squared(number: int) -> NumpyFunction:
        x = ca.SX.sym("x")
        return NumpyFunction.of("f", {"x": x}, {"y": x**2 + number})

    with ThreadPoolExecutor(THREADS) as pool:
        assert list(pool.map(build, range(200))) == [9.0 + i for i in range(200)]

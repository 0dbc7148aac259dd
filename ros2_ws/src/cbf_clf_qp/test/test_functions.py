"""Functions for numpy: what is left out, names; building in several threads."""

import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

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


def test_one_thread_builds_at_a_time_and_none_waits_for_ever() -> None:
    """What builds may build other things within."""
    together, building = Barrier(THREADS), [0]

    @one_at_a_time
    def built(depth: int) -> int:
        assert building[0] == 0 or depth == 0, "two threads build at a time"
        building[0] += 1
        time.sleep(0.01)
        found = built(depth - 1) if depth else 0
        building[0] -= 1
        return found + 1

    def build(_: int) -> int:
        together.wait()
        return built(1)

    with ThreadPoolExecutor(THREADS) as pool:
        assert [each.result(timeout=30) for each in [pool.submit(build, i) for i in range(THREADS)]] == [2] * THREADS


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

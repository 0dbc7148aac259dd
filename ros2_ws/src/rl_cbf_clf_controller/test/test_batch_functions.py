"""N systems at once: each row is what the system alone gets, whatever the others are."""

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import NumpyFunction
from rl_cbf_clf_controller.batch_functions import BatchFunction


def test_estimates_add_up_robot_by_robot() -> None:
    one = Estimates(np.ones((2, 3)), np.arange(2.0), np.ones((3, 4)))
    unknown = Estimates(np.zeros((2, 3)), np.zeros(2))
    both = Estimates.of_many([one, one]) + Estimates.of_many([one, Estimates.zero(2, 3)])
    assert both[0].beta == pytest.approx([0.0, 2.0])
    assert both[1].output_error == pytest.approx(np.ones((3, 4)))
    assert (both + Estimates.of_many([unknown, one])).output_error is None


def test_any_number_of_calls_has_the_bits_of_each_alone() -> None:
    """Every kind of operation, constants as outputs, inputs that are left out, and no trace of the call before."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    found = {"a": ca.vertcat(ca.sin(x[0]) / x[1], ca.exp(-(x[2] ** 2)), x[0] ** 3, 2 * x[1], ca.tanh(x[2]) + y)}
    found |= {"b": ca.vertcat(ca.fmax(x[0], y), ca.if_else(x[0] > x[1], x[2], -x[2]), ca.fabs(x[1]), 7, y)}
    found |= {"c": ca.vertcat(ca.logic_or(x[0] > 0, x[1] > 0), ca.sign(x[2]), ca.sqrt(ca.fabs(x[0])), 1 / x[1])}
    alone = NumpyFunction.of("f", {"x": x, "y": y}, found)
    at_once, rng = BatchFunction(alone), np.random.default_rng(0)
    for n in (1, 2, 3, 5, 8, 64, 7):
        xs, ys = rng.normal(size=(n, 3)), rng.normal(size=(n, 1))
        for given in ((xs, ys), (xs,)):
            rows = at_once(*given).row
            assert np.array_equal(rows, [alone(*each).row for each in zip(*given, strict=True)])

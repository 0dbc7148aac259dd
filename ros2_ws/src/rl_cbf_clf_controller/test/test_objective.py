"""What the QP minimises; torque is finite and within its limit, whatever finite state comes in."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.answer import Answering
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.qp import build_qp
from cbf_clf_qp.quantity import at_most
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rabbit_description import DEFAULT_GAIT
from rabbit_description.gait import load_gait
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.recipes import MU_WEIGHT, pd_centred
from rl_cbf_clf_controller.scene import ControllerError
from walking_states import make_controller, state_of

GAIT = load_gait(DEFAULT_GAIT)


def controller(policy=None, **changes):
    return make_controller(policy, controller="rl-cbf-clf-qp", **changes)


def test_without_a_binding_row_mu_follows_the_pd_law():
    """(I + mu_weight) mu = v_PD where no error is known."""
    built = controller(objective="pd_centred", torque_limit=1e4, force_rows=False, barrier_rows=False)
    beside = replace(state_of(*GAIT.x_start), q=GAIT.x_start[0] + np.array([0, 0, 0, 0.02, -0.03, 0.04, 0.05]))
    output, p = built.step(beside), built.parameters
    y, dy = np.split(output.eta, 2)
    wanted = -y / p.eps**2 - np.sqrt(3) * dy / p.eps
    assert output.active == ()
    assert output.mu == pytest.approx(wanted / (1 + MU_WEIGHT), rel=1e-5, abs=1e-6)


class Untold(Policy):
    """Estimates of rows alone."""

    version = "untold"

    def estimate(self, scene, before):
        return Estimates(np.zeros((5, 4)), np.zeros(5))


def test_the_pd_centred_objective_needs_the_output_error():
    for adaptation in ("none", "identification"):
        assert controller(Untold(), adaptation=adaptation).step(state_of(*GAIT.x_start)).policy_version == "untold"
        with pytest.raises(ControllerError, match="objective pd_centred: expected a structured policy"):
            controller(Untold(), adaptation=adaptation, objective="pd_centred").step(state_of(*GAIT.x_start))


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_pd_centred_is_least_squares(solver):
    """|E mu + Delta - v_PD|^2 + weight |mu|^2 + cost |C mu + c|^2 by numpy's own solution of it; the one row is far."""
    m, eps, weight, cost = 3, 0.3, 0.1, 0.2
    y, dy, D1, D2 = *(ca.SX.sym(name, m) for name in ("y", "dy", "D1")), ca.SX.sym("D2", m, m)
    C, c = np.random.default_rng(2).normal(size=(m, m)), np.array([1.0, -2.0, 3.0])
    objective = pd_centred(y, dy, eps, Affine(D2, D1), Affine(ca.DM(C), ca.DM(c)), (weight, cost))
    far = at_most(("far",), ca.SX.eye(m)[:1, :], ca.SX(1e6), 1e3)
    layout, data = build_qp([far], objective, Affine.identity(m))
    answer, rng = Answering({"y": y, "dy": dy, "D2": D2, "D1": D1}, data, layout, solver), np.random.default_rng(1)
    for _ in range(20):
        y_0, dy_0, delta_1 = rng.normal(size=(3, m))
        E = np.eye(m) + (delta_2 := 0.4 * rng.normal(size=(m, m)))
        v = -y_0 / eps**2 - np.sqrt(3) * dy_0 / eps
        system = np.vstack([E, np.sqrt(weight) * np.eye(m), np.sqrt(cost) * C])
        wanted = np.concatenate([v - delta_1, np.zeros(m), -np.sqrt(cost) * c])
        expected = np.linalg.lstsq(system, wanted, rcond=None)[0]
        assert answer(y_0, dy_0, delta_2, delta_1).mu == pytest.approx(expected, abs=1e-7)


numbers = st.floats(allow_nan=False, allow_infinity=False)
states = st.tuples(*(arrays(float, n, elements=st.just(0.0) | numbers) for n in (7, 7, 4, 4)))
FAST = GAIT.x_start[0], np.full(7, 1e154), np.zeros(4), np.zeros(4)


make = cache(make_controller)


def hostile(numbers, tick=0):
    q, dq, force, applied = numbers
    return state_of(q, dq, tick, foot_force=force.reshape(2, 2), applied=applied)


@pytest.mark.parametrize(("objective", "sigma"), [("paper", 0.0), ("pd_centred", 20.0)])
@settings(max_examples=150, deadline=None, derandomize=True)
@given(states)
@example(FAST)
def test_a_torque_is_finite_and_within_its_limit(objective, sigma, numbers):
    controller = make(objective=objective, sigma=sigma, torque_limit=150.0)
    controller.reset(0)
    for tick in range(2):
        try:
            acted = controller.act(hostile(numbers, tick))
        except (ControllerError, np.linalg.LinAlgError):
            return  # which ends the episode with its words
        assert np.abs(acted.torque).max() <= 150.0
        assert np.isfinite([*acted.torque, *acted.mu, *acted.mu_qp]).all()


def test_a_joint_that_is_too_fast_ends_the_episode():
    acted = controller(objective="paper").act(hostile(FAST))
    assert acted.fault.split(":")[0] in ("no solver answered", "torque not finite")

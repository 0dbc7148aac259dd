"""What the QP minimises: the PD-centred objective has its own least-squares solution where no row binds."""

import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.objective import pd_centred, pd_input
from cbf_clf_qp.qp import Decision, build_qp
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.solvers import make_solver
from rabbit_description.gait import DEFAULT_GAIT, load_gait
from rabbit_description.state import RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import Policy, ZeroPolicy
from rl_cbf_clf_controller.scene import ControllerError

GAIT = load_gait(DEFAULT_GAIT)
NO_ROW = Rows.at_most(("CLF",), np.ones((1, 4)), np.array([1e6]), 5.0)


def controller(policy=None, **changes):
    parameters = load_parameters("ours", controller="rl-cbf-clf-qp", **changes)
    return Controller(parameters, GAIT, policy or ZeroPolicy(parameters.problem))


def start():
    q, dq = GAIT.x_start
    return RobotState(0, q, dq, np.zeros((2, 2)), np.array([True, False]), 0, StonePreview(1, 0.35, 0.40))


def solved(rows, objective):
    qp = build_qp(rows, objective)
    return Decision(qp, make_solver("osqp").solve(qp).x).mu


def random_problem():
    rng = np.random.default_rng(4)
    return rng.normal(0, 50, 4), Affine(rng.normal(0, 0.3, (4, 4)), rng.normal(0, 30, 4))


def test_without_a_binding_row_the_outputs_accelerate_as_the_pd_law_says():
    wanted, error = random_problem()
    mu = solved([NO_ROW], pd_centred(wanted, error, 1e-12))
    assert mu + error(mu) == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize("weight", [0.01, 3.0])
def test_the_gradient_vanishes(weight):
    wanted, error = random_problem()
    mu = solved([NO_ROW], pd_centred(wanted, error, weight))
    E = np.eye(4) + error.a
    assert E.T @ (E @ mu + error.b - wanted) + weight * mu == pytest.approx(0, abs=1e-8)


def test_with_one_binding_row_the_multiplier_has_the_closed_form():
    """min |E mu - c|^2 + w |mu|^2 with a'mu <= b: mu = mu_0 - H^-1 a (a'mu_0 - b) / (a'H^-1 a)."""
    wanted, error = random_problem()
    E, weight, a = np.eye(4) + error.a, 0.01, np.array([1.0, -2.0, 0.5, 3.0])
    inverse = np.linalg.inv(E.T @ E + weight * np.eye(4))
    free = inverse @ E.T @ (wanted - error.b)
    b = a @ free - 20.0
    row = Rows.at_most(("CLF",), a[None], np.array([b]), np.inf)
    expected = free - inverse @ a * 20.0 / (a @ inverse @ a)
    assert solved([row], pd_centred(wanted, error, weight)) == pytest.approx(expected, abs=1e-5)


def test_the_pd_law_is_the_gain_of_the_riccati_equation():
    """v_PD = -(1/eps) G' P_eps eta, with P_eps of the gains 1/2, sqrt(3)/2, whose Lyapunov and Riccati P agree."""
    rng, eps = np.random.default_rng(0), 0.05
    y, dy = rng.normal(size=4), rng.normal(size=4)
    clf = ResClf(4, eps, (0.5, np.sqrt(3) / 2))
    assert pd_input(y, dy, eps) == pytest.approx(-clf.G.T @ clf.P_eps @ np.concatenate([y, dy]) / eps)


def test_the_papers_objective_is_the_default_and_is_told():
    output = controller().step(start())
    assert (output.objective, output.adaptation) == ("paper", "none")
    assert controller(objective="pd_centred").step(start()).objective == "pd_centred"
    built = controller()
    built.step(start())
    assert built.recipe.objective(built.terms, built.decided.estimates) is None


class Untold(Policy):
    """Estimates of rows alone."""

    version = "untold"

    def estimate(self, terms, before):
        return Estimates(np.zeros((5, 4)), np.zeros(5))


def test_the_pd_centred_objective_needs_the_output_error():
    for adaptation in ("none", "identification"):
        assert controller(Untold(), adaptation=adaptation).step(start()).policy_version == "untold"
        with pytest.raises(ControllerError, match="objective pd_centred: expected a structured policy"):
            controller(Untold(), adaptation=adaptation, objective="pd_centred").step(start())


def test_the_zero_policy_tells_no_error():
    error = Estimates.zero(1, 4).output_error
    assert not error.a.any()
    assert not error.b.any()

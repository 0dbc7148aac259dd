"""The RES-CLF against the Lyapunov equation, its bounds and its closed loop."""

import numpy as np
import pytest
from cbf_clf_qp.res_clf import ResClf

SETTINGS = [(0.05, (0.5, 3**0.5 / 2)), (0.07, (1.0, 1.8)), (0.3, (2.0,)), (0.5, (1.0, 3.0, 3.0))]


@pytest.fixture(params=SETTINGS, ids=str)
def clf(request):
    return ResClf(3, *request.param)


def etas(clf):
    return np.random.default_rng(1).standard_normal((50, clf.F.shape[0]))


def test_lyapunov_equation(clf):
    A = clf.F + clf.G @ clf.K
    degree = clf.F.shape[0] // 3
    E = np.kron(np.diag(clf.eps ** -np.arange(degree - 1, -1, -1.0)), np.eye(3))
    residual = A.T @ clf.P_eps + clf.P_eps @ A + E @ E / clf.eps
    assert residual == pytest.approx(0, abs=1e-9 * np.abs(clf.P_eps).max() / clf.eps)


def test_derivative_is_the_gradient_along_the_dynamics(clf):
    for eta in etas(clf):
        w = np.array([1.0, -2.0, 3.0])
        eta_dot = clf.F @ eta + clf.G @ w
        assert clf.derivative(eta)(w)[0] == pytest.approx(2 * eta @ clf.P_eps @ eta_dot, rel=1e-9, abs=1e-9)


def test_feedback_meets_the_condition_at_every_eta(clf):
    for eta in etas(clf):
        scale = abs(clf.bound(eta))
        assert clf.derivative(eta)(clf.K @ eta)[0] <= clf.bound(eta) + 1e-9 * scale


def test_value_is_sandwiched_as_a_res_clf(clf):
    c1 = np.linalg.eigvalsh(clf.P_eps).min()
    degree = clf.F.shape[0] // 3
    c2 = ResClf(3, 1.0, -clf.K[0, ::3] * clf.eps ** np.arange(degree, 0, -1)).P_eps
    for eta in etas(clf):
        size = eta @ eta
        assert c1 * size <= clf.value(eta) * (1 + 1e-9)
        assert clf.value(eta) <= np.linalg.eigvalsh(c2).max() / clf.eps ** (2 * degree - 2) * size * (1 + 1e-9)


def test_known_solution():
    clf = ResClf(1, 1.0, (0.5, 3**0.5 / 2))
    assert clf.P_eps == pytest.approx(np.array([[3**0.5, 1], [1, 3**0.5]]))
    assert clf.clf_rate == pytest.approx(1 / (3**0.5 + 1))


def test_unstable_gains_are_refused():
    with pytest.raises(ValueError, match="do not stabilise"):
        ResClf(4, 0.1, (1.0, -0.1))

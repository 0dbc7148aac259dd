"""The RES-CLF against its decay and its bounds; V-dot; the QP of one row in closed form."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.constraints import Clf, ResClf
from cbf_clf_qp.quantity import HARD
from cbf_clf_qp.tick import Tick

SETTINGS = [(0.05, (0.5, 3**0.5 / 2)), (0.07, (1.0, 1.8)), (0.3, (2.0,)), (0.5, (1.0, 3.0, 3.0))]


class Numbers:
    """A ResClf's matrices and functions as numbers, for three outputs."""

    def __init__(self, eps: float, gains: tuple[float, ...]) -> None:
        self.eps, self.degree, clf = eps, len(gains), ResClf(3, eps, gains)
        self.F, self.G, self.P, self.K = (ca.DM(matrix).full() for matrix in (clf.F, clf.G, clf.P, clf.K))
        self.rate = float(clf.rate)
        eta, w = ca.SX.sym("eta", 3 * self.degree), ca.SX.sym("w", 3)
        self.V = ca.Function("V", [eta], [clf.value(eta)])
        self.V_dot = ca.Function("V_dot", [eta, w], [clf.derivative(eta)(w)])


@pytest.fixture(params=SETTINGS, ids=str)
def clf(request: Any) -> Numbers:
    return Numbers(*request.param)


def etas(clf: Numbers) -> Any:
    return np.random.default_rng(1).standard_normal((50, 3 * clf.degree))


def test_feedback_decays_by_Q(clf: Numbers) -> None:
    """V-dot = -eta' Q eta at y^(r) = K eta, the Lyapunov equation with Q = E^2 / eps; it meets the condition."""
    E = np.kron(np.diag(clf.eps ** -np.arange(clf.degree - 1, -1, -1.0)), np.eye(3))
    for eta in etas(clf):
        V, V_dot = float(clf.V(eta)), float(clf.V_dot(eta, clf.K @ eta))
        assert V_dot == pytest.approx(-eta @ E @ E @ eta / clf.eps, rel=1e-8)
        assert V_dot <= -clf.rate * V * (1 - 1e-9)


def test_value_is_sandwiched_as_a_res_clf(clf: Numbers) -> None:
    """c1 |eta|^2 <= V <= c2 / eps^(2 r - 2) |eta|^2, c2 at eps = 1."""
    c1 = np.linalg.eigvalsh(clf.P).min()
    E = np.kron(np.diag(clf.eps ** np.arange(clf.degree - 1, -1, -1.0)), np.eye(3))
    c2 = np.linalg.eigvalsh(E @ clf.P @ E).max()
    for eta in etas(clf):
        assert c1 * (eta @ eta) <= float(clf.V(eta)) * (1 + 1e-9)
        assert float(clf.V(eta)) <= c2 / clf.eps ** (2 * clf.degree - 2) * (eta @ eta) * (1 + 1e-9)


def test_known_solution() -> None:
    clf = ResClf(1, 1.0, (0.5, 3**0.5 / 2))
    assert ca.DM(clf.P).full() == pytest.approx(np.array([[3**0.5, 1], [1, 3**0.5]]))
    assert float(clf.rate) == pytest.approx(1 / (3**0.5 + 1))


@pytest.mark.parametrize(("eps", "gains"), [(0.1, (1.0, -0.1)), (0.0, (1.0, 2.0)), (float("nan"), (1.0,))])
def test_gains_that_do_not_stabilise_are_refused(eps: float, gains: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r"do not stabilise|eps = "):
        ResClf(4, eps, gains)


def test_V_dot_is_the_systems(make_plant: Any) -> None:
    """By the chain of integrators as along the system."""
    plant, rng = make_plant("segway"), np.random.default_rng(2)
    quantity = Clf(plant.symbols["theta"] - 0.1, eps=0.3).on(plant.system)
    of_system = plant.system.derivative(quantity.reads["V"])
    for x in rng.normal(size=(20, 3)):
        u = 50 * rng.normal(size=1)
        found, expected = (plant.number(y, x, u) for y in (quantity.value(plant.system.u), of_system))
        assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", ["cart", "pendulum", "segway", "double_pendulum"])
@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_one_row_in_closed_form(make_plant: Any, name: str, solver: str) -> None:
    """The least mu with LfV + LgV mu <= -rate V is -LgV' (rate V + LfV)+ / |LgV|^2; with slack p, d in units of mu,
    it is shorter by 1 + 1/p. y^(r) = mu is what u gives."""
    plant, rng = make_plant(name), np.random.default_rng(3)
    y = {"cart": "x", "pendulum": "theta", "segway": "theta", "double_pendulum": "q"}[name]
    for weight in (HARD, 10.0):
        clf = Clf(plant.symbols[y], eps=0.2, gains=(1.0, 1.8), slack_weight=weight)
        tick = Tick(plant.system, [clf], solver=solver)
        rate = float(ResClf(1, 0.2, (1.0, 1.8)).rate)
        for x in rng.normal(size=(10, plant.system.x.numel())):
            read, decided = tick.look(x, tick.p(**plant.values)), tick(x, **plant.values)
            lack = max(0.0, rate * read.V[0] + read.LfV[0])
            hard = -read.LgV * lack / (read.LgV @ read.LgV)
            expected = hard if weight == HARD else hard / (1 + 1 / weight)
            assert decided.solved
            assert decided.mu == pytest.approx(expected, rel=1e-6, abs=1e-6)
            y_r = np.atleast_1d(plant.number(plant.system.derivatives("y", plant.symbols[y], 2)[2], x, decided.u))
            assert y_r == pytest.approx(decided.mu, rel=1e-9, abs=1e-9)

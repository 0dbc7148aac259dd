"""An uncertain cruise control whose answer is known in closed form: CLF, CBF, QP and estimates without a robot.

    car:      m dv/dt = u - m drag v,   true mass `scale` times the nominal one
    output:   y = v - v_desired,        relative degree 1;  CLF V = P y^2, CBF B = v_limit - v
    nominal:  u = m (mu + drag v)  gives  dy/dt = mu;  on the true car  dy/dt = mu + alpha mu + beta
              with alpha = 1/scale - 1 and beta = alpha drag v

    min mu^2   s.t.   CLF: 2 P y (mu + alpha mu + beta) <= -rate/eps V,   CBF: -(mu + alpha mu + beta) + k B >= 0

While the CLF row alone is active its answer is mu = (-rate/(2 eps) y - beta) / (1 + alpha).
"""

import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.qp import Decision, build_qp
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.solvers import make_solver

MASS, DRAG, V_DESIRED, V_LIMIT, BARRIER_RATE = 1650.0, 0.05, 24.0, 22.0, 5.0  # kg, 1/s, m/s, m/s, 1/s
DT, SECONDS = 0.01, 8.0


class CruiseControl:
    """The nominal car's CBF-CLF-QP with an estimate of the model error in it."""

    def __init__(self) -> None:
        self.clf = ResClf(outputs=1, eps=0.5, gains=(1.0,))
        self._solver = make_solver("osqp")

    def mu(self, v: float, estimate: Affine) -> float:
        """The QP's auxiliary input, m/s^2; `estimate` is (alpha, beta)."""
        y = np.array([v - V_DESIRED])
        dy = Affine(np.eye(1), np.zeros(1)) + estimate
        V_dot = self.clf.derivative(y).after(dy)
        clf = Rows.at_most(("CLF",), V_dot.a, self.clf.bound(y) - V_dot.b, slack_weight=10.0, rescue=False)
        cbf = Rows.at_least(("CBF",), -dy.a, dy.b - BARRIER_RATE * (V_LIMIT - v), slack_weight=np.inf)
        qp = build_qp([clf.normalised(), cbf])
        return float(Decision(qp, self._solver.solve(qp).x).mu[0])


def true_error(v: float, scale: float) -> Affine:
    """What a perfect learner would say of a car `scale` times as heavy."""
    alpha = 1 / scale - 1
    return Affine(np.array([[alpha]]), np.array([alpha * DRAG * v]))


def drive(scale: float, perfect: bool, seconds: float = SECONDS) -> list[float]:
    """Speeds from rest under the true car, with a perfect estimate or none, m/s."""
    control, v, speeds = CruiseControl(), 10.0, []
    for _ in range(round(seconds / DT)):
        estimate = true_error(v, scale) if perfect else true_error(v, 1.0)
        u = MASS * (control.mu(v, estimate) + DRAG * v)
        v += DT * (u / (scale * MASS) - DRAG * v)
        speeds.append(v)
    return speeds


if __name__ == "__main__":
    for scale in (0.5, 1.0, 2.0):
        for perfect in (False, True):
            top = max(drive(scale, perfect))
            verdict = "keeps the limit" if top <= V_LIMIT else "OVER THE LIMIT"
            print(f"mass x{scale}: {'perfect' if perfect else 'no':>7} estimate: top speed {top:6.2f} m/s, {verdict}")

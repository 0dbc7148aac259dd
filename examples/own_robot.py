"""A robot of your own from a URDF: a two-link arm reaches for a shelf it must not hit, half as heavy as believed.

The library's terms take any control-affine system. Here pinocchio reads a URDF given below, the outputs are the joint
angles minus a goal (relative degree 2), the barrier keeps the hand below z = 0.5 m, the true arm is half as heavy.

    y-ddot = M^-1 (u - h)  is affine in u;  u = h + M mu (nominal);  true: y-ddot = mu + alpha mu + beta
"""

import numpy as np
import pinocchio as pin
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.ecbf import Barriers, ecbf_bound, ecbf_gains
from cbf_clf_qp.io_linearization import precontrol
from cbf_clf_qp.qp import Decision, build_qp
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.solvers import make_solver

LINK = """<link name="{0}"><inertial><origin xyz="0.25 0 0"/><mass value="{1}"/>
<inertia ixx="0.01" iyy="{2}" izz="{2}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>
<axis xyz="0 -1 0"/><limit lower="-9" upper="9" effort="99" velocity="99"/></joint>"""
SHELF, GOAL, DT = 0.5, np.array([1.2, 0.2]), 0.001  # m, rad, s; the hand at the goal would be at z = 0.96 m


class Arm:
    """Joint accelerations and the hand's height of the two-link arm; `scale` multiplies all masses."""

    def __init__(self, scale: float) -> None:
        links = "".join(LINK.format(name, 2 * scale, 0.05 * scale) for name in ("upper", "fore"))
        joints = JOINT.format("shoulder", "base", "upper", 0) + JOINT.format("elbow", "upper", "fore", 0.5)
        self._model = pin.buildModelFromXML(f'<robot name="arm"><link name="base"/>{links}{joints}</robot>')
        self._data = self._model.createData()

    def acceleration(self, q: np.ndarray, dq: np.ndarray) -> Affine:
        """q-ddot (2), affine in the torque."""
        pin.computeAllTerms(self._model, self._data, q, dq)
        mass = np.triu(self._data.M) + np.triu(self._data.M, 1).T
        inverse = np.linalg.inv(mass)
        return Affine(inverse, -inverse @ self._data.nle)


def shelf_barrier(q: np.ndarray, dq: np.ndarray) -> Barriers:
    """B = SHELF - z of the hand, z = 0.5 sin q1 + 0.5 sin(q1 + q2)."""
    angles, rates = np.array([q[0], q[0] + q[1]]), np.array([dq[0], dq[0] + dq[1]])
    cosines = 0.5 * np.cos(angles)
    jacobian = -np.array([[cosines.sum(), cosines[1]]])
    B = np.array([SHELF - 0.5 * np.sin(angles).sum()])
    return Barriers(B, jacobian @ dq, jacobian, np.array([0.5 * np.sin(angles) @ rates**2]))


def reach(oracle: bool, seconds: float = 2.0) -> float:
    """The hand's greatest height on the true, light arm, m; `oracle` puts the true error in the QP."""
    nominal, true, clf, solver = Arm(1.0), Arm(0.5), ResClf(2, 0.2, (1.0, 2.0)), make_solver("osqp")
    q, dq, K_b, highest = np.array([-0.5, 0.3]), np.zeros(2), ecbf_gains((15.0, 15.0)), -1.0
    for _ in range(round(seconds / DT)):
        control = precontrol(nominal.acceleration(q, dq))
        believed = (true if oracle else nominal).acceleration(q, dq).after(control)
        eta, barrier = np.concatenate([q - GOAL, dq]), shelf_barrier(q, dq)
        V_dot, ddB = clf.derivative(eta).after(believed), barrier.second_derivative(believed)
        rows = [
            Rows.at_most(("CLF",), V_dot.a, clf.bound(eta) - V_dot.b, 10.0, rescue=False).normalised(),
            Rows.at_least(("CBF",), ddB.a, ecbf_bound(barrier, K_b) - ddB.b, 1e6).normalised(),
        ]
        qp = build_qp(rows)
        torque = control(Decision(qp, solver.solve(qp).x).mu)
        dq = dq + DT * true.acceleration(q, dq)(torque)
        q = q + DT * dq
        highest = max(highest, SHELF - shelf_barrier(q, dq).B[0])
    return highest


if __name__ == "__main__":
    for oracle in (False, True):
        height = reach(oracle)
        verdict = "stays below" if height < SHELF + 5e-4 else "HITS"
        print(f"{'true' if oracle else 'nominal'} rows: hand up to {height:.4f} m, {verdict} the shelf at {SHELF} m")

"""Input-output linearisation with the nominal model [eq:io_input_model].

From y-ddot = Lf2h + LgLfh u:   u(mu) = LgLfh^-1 mu + u_star,   u_star = -LgLfh^-1 Lf2h.
"""

from cbf_clf_qp.affine import Affine


def precontrol(output_dynamics: Affine) -> Affine:
    """The torque u (m,) affine in mu (m,) that gives the r-th output derivative the value mu.

    Raises:
        numpy.linalg.LinAlgError: the decoupling matrix is singular.
    """
    return output_dynamics.inverse()

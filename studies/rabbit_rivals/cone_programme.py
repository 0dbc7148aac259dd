"""The programme of a tick with second order cones: rows that hold with a margin of so many standard deviations.

    minimise   x'x + q'x                                         x = (mu, scaled slacks), see `cbf_clf_qp.qp`
    subject to A_i x + |factor_i [1, mu]| <= upper_i             cones; in the QP's own scaling of each row
               lower_j <= A_j x <= upper_j                       the other rows

|factor_i [1, mu]|^2 is the squared margin, quadratic in mu. Without factors it is the QP. Solved by Clarabel.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from cbf_clf_qp.functions import Array
from cbf_clf_qp.qp import UNBOUNDED, Layout
from scipy import sparse

COST = 1e-3  # of mu'mu: slacks of last resort reach 1e5, and Clarabel takes their rows for infeasible otherwise
SOLVED = ("Solved", "AlmostSolved")


def solve(qp: Any, layout: Layout, factors: Mapping[int, Array]) -> tuple[Array, bool, str]:
    """x of a programme with a `factor` (k, m + 1) for each row that has a margin; whether it is solved; the status.

    `qp` has q, lower, upper and A, as `cbf_clf_qp.qp.build_qp` has them.

    Raises:
        ModuleNotFoundError: Clarabel is not installed.
    """
    import clarabel

    inputs, variables = layout.inputs, len(qp.q)
    plain = [i for i in range(len(qp.A)) if i not in factors]
    above = [i for i in plain if qp.upper[i] < UNBOUNDED]
    below = [i for i in plain if qp.lower[i] > -UNBOUNDED]
    blocks, bounds = [qp.A[above], -qp.A[below]], [qp.upper[above], -qp.lower[below]]
    cones: list[Any] = [clarabel.NonnegativeConeT(len(above) + len(below))]
    for i, factor in factors.items():  # (upper - A x, factor [1, mu]) is in the cone
        block = np.zeros((len(factor) + 1, variables))
        block[0], block[1:, :inputs] = qp.A[i], -factor[:, 1:]
        blocks.append(block)
        bounds.append(np.concatenate([[qp.upper[i]], factor[:, 0]]))
        cones.append(clarabel.SecondOrderConeT(len(factor) + 1))
    A, b = sparse.csc_matrix(np.concatenate(blocks)), np.concatenate(bounds)
    hessian = sparse.identity(variables, format="csc") * (2 * COST)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    for settings.equilibrate_enable in (False, True):  # the rows have norm one; where that fails, it may help
        answer = clarabel.DefaultSolver(hessian, COST * qp.q, A, b, cones, settings).solve()
        x, status = np.array(answer.x), str(answer.status)
        is_solved = status in SOLVED and bool(np.isfinite(x).all())
        if is_solved:
            break
    return x, is_solved, status

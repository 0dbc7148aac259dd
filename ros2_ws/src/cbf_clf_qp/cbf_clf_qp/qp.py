"""The quadratic programme of a tick, built from rows; solving it is in `solvers.py`.

    minimise   |root mu - center|^2 + sum_i w_i s_i^2      the paper's: root = I, center = 0; see `objective.py`
    subject to lower_i <= A_i mu - s_i <= upper_i          s_i = 0 where row i is hard

The solver's variable is root mu, so that its Hessian is 2 I whatever the objective. For conditioning each slack is
scaled to unit cost and every row then divided by its norm, so the solver sees rows of norm one; `unpack` gives mu and
the slacks back in the rows' own units.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cbf_clf_qp.affine import Array
from cbf_clf_qp.objective import Objective
from cbf_clf_qp.rows import Rows

ROUNDING = 1e-6  # less is the solver's tolerance


@dataclass(frozen=True)
class QuadraticProgram:
    """min x'x + q'x subject to `lower <= A x <= upper`, over x = (root mu, scaled slacks), shape (n,).

    `names`, `rescue` (k,) describe the rows; `slack_scale` (k,) is a row's slack over its variable, 0 for hard rows;
    mu = `unroot` times the first `inputs` variables, or these themselves.
    """

    q: Array
    A: Array
    lower: Array
    upper: Array
    names: tuple[str, ...]
    slack_scale: Array
    rescue: Array
    inputs: int
    unroot: Array | None = None

    @property
    def pattern(self) -> Array:
        """Where `A` may be non-zero, the same at every tick of a controller."""
        pattern = self.A != 0
        pattern[:, : self.inputs] = True
        return pattern


@dataclass(frozen=True)
class Decision:
    """`mu` (m,), the slack of each row in its own units (k,), and which rows hold with equality (k,)."""

    mu: Array
    slack: Array
    active: Array


def build_qp(rows: Sequence[Rows], objective: Objective | None = None) -> QuadraticProgram:
    """Stack the rows of all constraints into one programme; the paper's objective if none is given."""
    A = np.concatenate([block.A for block in rows])
    inputs = A.shape[1]
    unroot = np.linalg.inv(objective.root) if objective else None
    if unroot is not None:
        A = A @ unroot
    weight = np.concatenate([block.slack_weight for block in rows])
    soft = np.isfinite(weight)
    scale = np.zeros(len(weight))
    scale[soft] = weight[soft] ** -0.5
    norms = np.sqrt((A * A).sum(axis=1) + scale * scale)
    norms[norms == 0] = 1.0
    q = np.zeros(inputs + int(soft.sum()))
    if objective:
        q[:inputs] = -2 * objective.center
    return QuadraticProgram(
        q=q,
        A=np.hstack([A, np.diag(-scale)[:, soft]]) / norms[:, None],
        lower=np.concatenate([block.lower for block in rows]) / norms,
        upper=np.concatenate([block.upper for block in rows]) / norms,
        names=tuple(name for block in rows for name in block.names),
        slack_scale=scale,
        rescue=np.concatenate([np.full(len(block.names), block.rescue) for block in rows]),
        inputs=inputs,
        unroot=unroot,
    )


def unpack(qp: QuadraticProgram, x: Array) -> Decision:
    """mu, slacks and active rows of a solution."""
    soft = qp.slack_scale > 0
    slack = np.zeros(len(qp.names))
    slack[soft] = qp.slack_scale[soft] * x[qp.inputs :]
    slack[slack < ROUNDING] = 0.0
    value = qp.A @ x
    active = (value > qp.upper - ROUNDING) | (value < qp.lower + ROUNDING)
    mu = x[: qp.inputs] if qp.unroot is None else qp.unroot @ x[: qp.inputs]
    return Decision(mu=mu, slack=slack, active=active)

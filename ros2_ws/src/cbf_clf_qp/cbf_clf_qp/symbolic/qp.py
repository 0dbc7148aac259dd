"""The quadratic programme of a tick, built from rows as expressions; solving it is in `solvers.py`.

    minimise   |root mu - center|^2 + sum_i w_i s_i^2      the paper's: root = I, center = 0; see `objective.py`
    subject to lower_i <= A_i mu - s_i <= upper_i          s_i = 0 where row i is hard

The solver's variable is x = (root mu, scaled slacks), so that its Hessian is 2 I whatever the objective:

    minimise   x'x + q'x     subject to     lower <= A x <= upper

For conditioning each slack is scaled to unit cost and every row then divided by its norm. `reading` gives mu and the
slacks back in their own units.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cbf_clf_qp.symbolic.affine import Affine
from cbf_clf_qp.symbolic.functions import Array
from cbf_clf_qp.symbolic.objective import Objective
from cbf_clf_qp.symbolic.rows import Rows

ROUNDING = 1e-6  # a slack or a margin below this is the solver's tolerance
UNBOUNDED = 1e30  # what the solvers take for infinity
TINY = 1e-9  # norm of a row with no input in it


@dataclass(frozen=True, eq=False)
class Layout:
    """What of a programme is the same at every tick.

    `names` (k,) of the rows over mu (`inputs`,); `soft`: indices of those with a slack; `rescues` (k,): whether that is
    one of last resort. `rows`, `columns`: where A may be non-zero, column by column.
    """

    names: tuple[str, ...]
    inputs: int
    soft: Array
    rescues: Array
    rows: Array
    columns: Array

    @classmethod
    def of(cls, blocks: Sequence[Rows], inputs: int) -> "Layout":
        """Of blocks of rows."""
        names = tuple(name for block in blocks for name in block.names)
        soft = np.flatnonzero([not block.is_hard for block in blocks for _ in block.names])
        pattern = np.zeros((len(names), inputs + len(soft)), dtype=bool)
        pattern[:, :inputs] = True
        pattern[soft, inputs + np.arange(len(soft))] = True
        columns, rows = pattern.T.nonzero()
        rescues = np.array([block.rescue and not block.is_hard for block in blocks for _ in block.names])
        return cls(names, inputs, soft, rescues, rows, columns)

    @property
    def shape(self) -> tuple[int, int]:
        """Of A."""
        return len(self.names), self.inputs + len(self.soft)


def build_qp(blocks: Sequence[Rows], objective: Objective | None, inputs: int) -> tuple[Layout, dict[str, ca.SX]]:
    """The programme's data by name: q (n,), lower, upper (k,), A (k, n); and what `reading` needs of them.

    `is_valid`: 1 where the data are finite and no row's bounds are out of order or out of reach, else 0.
    mu = `unroot` times the first variables; a slack = `slack_scale` times its variable.
    """
    layout = Layout.of(blocks, inputs)
    of_mu = ca.vertcat(ca.SX(0, inputs), *(block.A for block in blocks))
    weights = ca.vertcat(*(block.slack_weight * ca.SX.ones(len(block.names)) for block in blocks if not block.is_hard))
    scale = ca.SX.zeros(layout.shape[0])
    scale[layout.soft.tolist()] = weights**-0.5
    in_mu = ca.vertcat(*(float(block.in_mu) * ca.SX.ones(len(block.names)) for block in blocks))
    norms = ca.sqrt(ca.sum2(of_mu**2))
    units = ca.if_else(in_mu, at_least(norms, TINY), 1)  # of the slacks, in units of the row
    q, unroot = ca.SX.zeros(layout.shape[1]), ca.SX.eye(inputs)
    if objective:
        unroot = ca.inv_minor(objective.root)
        of_mu = of_mu @ unroot
        q[:inputs] = -2 * objective.center
        norms = ca.sqrt(ca.sum2(of_mu**2))
    norms = at_least(ca.sqrt(norms**2 + (units * scale) ** 2), TINY)
    slacks = ca.diag(-scale * units)[:, layout.soft.tolist()]
    A = ca.densify(ca.horzcat(of_mu, slacks)) / ca.repmat(norms, 1, layout.shape[1])
    lower = ca.vertcat(*(block.lower for block in blocks)) / norms
    upper = ca.vertcat(*(block.upper for block in blocks)) / norms
    sound = ca.vertcat(lower <= upper, lower <= UNBOUNDED, upper >= -UNBOUNDED, ca.fabs(ca.sum2(A)) <= UNBOUNDED)
    is_valid = ca.mmin(ca.vertcat(sound, ca.fabs(ca.sum1(q) + ca.sum1(ca.vec(unroot))) <= UNBOUNDED))
    lower = ca.if_else(is_valid, within_reach(lower), -UNBOUNDED)  # so that a solver does not stop at a NaN
    upper = ca.if_else(is_valid, within_reach(upper), UNBOUNDED)
    data = {"q": q, "lower": lower, "upper": upper, "A": A}
    return layout, data | {"is_valid": is_valid, "unroot": unroot, "slack_scale": scale}


def reading(data: dict[str, ca.SX], control: Affine, x: ca.SX, y: ca.SX, layout: Layout) -> dict[str, ca.SX]:
    """What an answer `x` (n,) with multipliers `y` (k,) says; `residual`: how far it is from the KKT conditions.

    `violation` (k,): of each row over mu and its slack, over the row's norm; `margin` (k,): to its nearer bound.
    """
    A, lower, upper = data["A"], data["lower"], data["upper"]
    value, gradient = A @ x, 2 * x + data["q"] + A.T @ y
    margin = ca.fmin(upper - value, value - lower)
    violation = at_least(-margin, 0)
    mu = data["unroot"] @ x[: layout.inputs]
    slack = ca.SX.zeros(layout.shape[0])
    slack[layout.soft.tolist()] = data["slack_scale"][layout.soft.tolist()] * x[layout.inputs :]
    return {
        "mu": mu,
        "u": control(mu),
        "slack": ca.if_else(slack < ROUNDING, 0, slack),
        "margin": margin,
        "is_valid": data["is_valid"],
        "residual": ca.sqrt(ca.sumsqr(gradient) + ca.sumsqr(violation)) / (1 + ca.norm_2(x)),
    }


def at_least(value: ca.SX, least: float) -> ca.SX:
    """The larger one; of NaN, NaN."""
    return ca.if_else(value < least, least, value)


def within_reach(value: ca.SX) -> ca.SX:
    """A bound that the solvers understand; of NaN, NaN."""
    return ca.if_else(value > UNBOUNDED, UNBOUNDED, ca.if_else(value < -UNBOUNDED, -UNBOUNDED, value))

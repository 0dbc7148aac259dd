"""The quadratic programme of a tick, built from rows; solving it is in `solvers.py`.

    minimise   |root mu - center|^2 + sum_i w_i s_i^2      the paper's: root = I, center = 0; see `objective.py`
    subject to lower_i <= A_i mu - s_i <= upper_i          s_i = 0 where row i is hard

The solver's variable is root mu, so that its Hessian is 2 I whatever the objective. For conditioning each slack is
scaled to unit cost and every row then divided by its norm, so the solver sees rows of norm one; `Decision` gives mu
and the slacks back in their own units.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import compress

import numpy as np

from cbf_clf_qp.affine import Array
from cbf_clf_qp.objective import Objective
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.symbols import all_at_most, at_least, inverse

ROUNDING = 1e-6  # less is the solver's tolerance
UNBOUNDED = 1e30  # what the solvers take for infinity
TINY = 1e-9  # norm of a row with no input in it


@dataclass(frozen=True, eq=False)
class Layout:
    """What of a programme is the same at every tick of a controller; one object, so that a solver knows it again.

    `names` (k,) of the rows over mu (`inputs`,); `slack_scale` (k,) is a row's slack over its variable, 0: a hard row;
    `soft`: the other rows; `slack_kinds` (2, k): 1 where it is the problem's own, 1 where it is of last resort.
    `is_normalised` (k,): the slack is in units of mu. `A` (k, n) has the slacks' columns; `order`: where in A.ravel()
    the entries are that may be non-zero, column by column.
    """

    names: tuple[str, ...]
    slack_kinds: Array
    slack_scale: Array
    is_normalised: Array
    inputs: int
    A: Array
    soft: Array
    order: Array

    @classmethod
    @cache
    def of(cls, blocks: tuple[tuple[tuple[str, ...], float, bool, bool], ...], inputs: int) -> "Layout":
        """Of blocks of rows: names, slack weight, whether the slack is of last resort, whether it is in units of mu."""
        weight, rescue, in_mu = (np.concatenate([np.full(len(b[0]), b[i]) for b in blocks]) for i in (1, 2, 3))
        soft = np.isfinite(weight).nonzero()[0]
        scale = np.zeros(len(weight))
        scale[soft] = weight[soft] ** -0.5
        A = np.hstack([np.zeros((len(weight), inputs)), np.diag(-scale)[:, soft]])
        pattern = A != 0
        pattern[:, :inputs] = True
        columns, rows = pattern.T.nonzero()
        names = tuple(name for block in blocks for name in block[0])
        kinds = np.array([~rescue, rescue], dtype=float)
        return cls(names, kinds, scale, in_mu, inputs, A, soft, rows * A.shape[1] + columns)


@dataclass(frozen=True)
class QuadraticProgram:
    """min x'x + q'x subject to `lower <= A x <= upper`, over x = (root mu, scaled slacks), shape (n,).

    No bound is beyond `UNBOUNDED`. `entries`: those of A that may be non-zero, in the layout's `order`. `checks` (2,):
    1 where the data are finite and no row's bounds are out of order or out of reach; 1 where x = -q/2, the minimum
    without rows, meets them all; else 0. mu = `unroot` times the first variables, or these themselves.
    """

    q: Array
    lower: Array
    upper: Array
    entries: Array
    checks: Array
    layout: Layout
    unroot: Array | None = None

    @property
    def A(self) -> Array:
        """The rows (k, n)."""
        dense = np.zeros(self.layout.A.size, self.entries.dtype)
        dense[self.layout.order] = self.entries
        return dense.reshape(self.layout.A.shape)

    @property
    def free(self) -> Array:
        """The minimum without rows (n,)."""
        return self.q * -0.5


@dataclass
class Decision:
    """What a solution `x` of a programme says."""

    qp: QuadraticProgram
    x: Array

    @property
    def mu(self) -> Array:
        """The input (m,)."""
        rooted = self.x[: self.qp.layout.inputs]
        return rooted if self.qp.unroot is None else self.qp.unroot @ rooted

    @cached_property
    def slack(self) -> Array:
        """Of each row in its own units (k,), 0 for a hard one."""
        layout = self.qp.layout
        slack = np.zeros(len(layout.names))
        slack[layout.soft] = layout.slack_scale[layout.soft] * self.x[layout.inputs :]
        slack[slack < ROUNDING] = 0.0
        return slack

    @cached_property
    def slack_sums(self) -> Array:
        """(2,): of the problem's own slacks, and of those of last resort."""
        return self.qp.layout.slack_kinds @ self.slack

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the rows that hold with equality."""
        value = self.qp.A.dot(self.x)
        active = np.minimum(self.qp.upper - value, value - self.qp.lower) < ROUNDING
        return tuple(compress(self.qp.layout.names, active.tolist()))


def build_qp(rows: Sequence[Rows], objective: Objective | None = None) -> QuadraticProgram:
    """Stack the rows of all constraints into one programme; the paper's objective if none is given."""
    of_mu = np.concatenate([block.A for block in rows])
    inputs = of_mu.shape[1]
    blocks = tuple((block.names, block.slack_weight, block.rescue, block.is_normalised) for block in rows)
    layout = Layout.of(blocks, inputs)
    q, unroot = np.zeros(layout.A.shape[1]), None
    norms = np.sqrt(np.einsum("ij,ij->i", of_mu, of_mu))
    units = np.where(layout.is_normalised, at_least(norms, TINY), 1.0)  # of the slacks, in units of the row
    if objective:
        unroot = inverse(objective.root)
        of_mu = of_mu @ unroot
        q = np.concatenate([-2 * objective.center, q[inputs:]])
        norms = np.sqrt(np.einsum("ij,ij->i", of_mu, of_mu))
    norms = at_least(np.sqrt(norms**2 + (units * layout.slack_scale) ** 2), TINY)
    A = np.hstack([of_mu, layout.A[:, inputs:] * units[:, None]]) / norms[:, None]
    lower = np.concatenate([block.lower for block in rows]) / norms
    upper = np.concatenate([block.upper for block in rows]) / norms
    value = A @ (q * -0.5)
    in_order, in_reach = all_at_most(lower, upper), all_at_most(-UNBOUNDED, np.concatenate([upper, -lower]))
    is_finite = all_at_most(np.abs(value), UNBOUNDED)
    is_free = all_at_most(lower, value) * all_at_most(value, upper)
    checks = np.array([in_order * in_reach * is_finite, is_free])
    lower, upper = at_least(lower, -UNBOUNDED), -at_least(-upper, -UNBOUNDED)
    return QuadraticProgram(q, lower, upper, A.ravel()[layout.order], checks, layout, unroot)

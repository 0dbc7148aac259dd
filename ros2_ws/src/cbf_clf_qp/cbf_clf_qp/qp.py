"""The quadratic programme of a tick, built from rows as expressions; solving it is in `answer.py`.

    minimise   |objective(mu)|^2 + sum_i w_i s_i^2         s_i = 0 where row i is hard
    subject to lower_i <= A_i mu - s_i <= upper_i

The objective is affine in mu, root mu - center with a regular root. Its square is

    none       mu' mu                            the paper's: the least correction of the pre-control
    nearest    |weights (u(mu) - wanted)|^2      a safety filter: the least change of a wanted input

The solver's variable is x = (root mu, scaled slacks), so that its Hessian is 2 I whatever the objective:

    minimise   x'x + q'x     subject to     lower <= A x <= upper

For conditioning each slack is scaled to unit cost and every row then divided by its norm. `reading` gives mu and the
slacks back in their own units.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cbf_clf_qp.affine import Affine, inverse
from cbf_clf_qp.functions import Array
from cbf_clf_qp.quantity import Number, Rows

ROUNDING = 1e-6  # a slack or a margin below this is the solver's tolerance
UNBOUNDED = 1e30  # what the solvers take for infinity
TINY = 1e-9  # norm of a row with no input in it
CLOSEST = 1e-6  # bounds that are closer to each other, over 1 + |x|, count as so far apart


def nearest(control: Affine, wanted: ca.SX, weights: Number = 1.0) -> Affine:
    """The input u = `control`(mu) that is nearest to `wanted` (m,), each component times its weight."""
    scale = ca.diag(weights * ca.SX.ones(wanted.numel()))
    return Affine(scale @ control.a, scale @ (control.b - wanted))


@dataclass(frozen=True, eq=False)
class Layout:
    """What of a programme is the same at every tick.

    `names` (k,) of the rows over mu (`inputs`,); `rescues` (k,): whether a row has a slack of last resort; `of_slacks`
    (k, n - m): 1 where a column of A is the slack of a row.
    """

    names: tuple[str, ...]
    inputs: int
    rescues: Array
    of_slacks: Array

    @property
    def hard(self) -> list[int]:
        """Which rows have no slack, by number."""
        numbers: list[int] = np.flatnonzero(~self.of_slacks.any(axis=1)).tolist()
        return numbers

    @property
    def of_A(self) -> ca.Sparsity:
        """Where A (k, n) may have other numbers than zero."""
        pattern = np.hstack([np.ones((len(self.names), self.inputs)), self.of_slacks])
        return ca.sparsify(ca.DM(pattern)).sparsity()


def build_qp(blocks: Sequence[Rows], objective: Affine | None, control: Affine) -> tuple[Layout, dict[str, ca.SX]]:
    """The programme's data by name: q (n,), lower, upper (k,), A (k, n); what `reading` needs of them and of u.

    `is_valid`: 1 where the data are finite and no row's bounds are out of order or out of reach, else 0.
    mu = `unroot` times the first variables; a slack = `slack_scale` times its variable, a row = `row_scale` times
    that of A x.
    """
    inputs, named = control.a.shape[1], [(block, name) for block in blocks for name in block.names]
    scale = ca.vertcat(*(ca.SX(block.slack_weight) for block, _ in named)) ** -0.5  # 0 where a row is HARD
    is_soft = np.array([not scale[i].is_zero() for i in range(len(named))], dtype=bool)
    rescues = is_soft & np.array([block.rescue for block, _ in named], dtype=bool)
    layout = Layout(tuple(name for _, name in named), inputs, rescues, np.eye(len(named))[:, is_soft])
    objective = objective or Affine.identity(inputs)
    unroot = inverse(objective.a)
    of_mu = ca.vertcat(ca.SX(0, inputs), *(block.A for block in blocks))
    in_mu = ca.vertcat(*(ca.SX(block.in_mu) for block, _ in named))
    units = ca.if_else(in_mu, ca.fmax(ca.sqrt(ca.sum2(of_mu**2)), TINY), 1)  # of the slacks, in units of the row
    A = ca.horzcat(of_mu @ unroot, ca.diag(-scale * units) @ ca.sparsify(ca.DM(layout.of_slacks)))
    size = ca.densify(ca.fmax(ca.sqrt(ca.sum2(A**2)), TINY))  # norms of the rows
    A = A / ca.repmat(size, 1, A.size2())
    q = ca.vertcat(2 * objective.b, ca.SX.zeros(layout.of_slacks.shape[1]))
    lower, upper = (ca.vertcat(*bounds) / size for bounds in zip(*((b.lower, b.upper) for b in blocks), strict=True))
    finite = (ca.vec(value) for value in (q, A, unroot, control.a, control.b))
    sound = ca.vertcat(lower <= upper, lower <= UNBOUNDED, upper >= -UNBOUNDED)
    is_valid = ca.mmin(ca.vertcat(sound, is_bounded(ca.vertcat(*finite))))
    lower = ca.if_else(is_valid, ca.fmax(lower, -UNBOUNDED), -UNBOUNDED)  # so that a solver does not stop at a NaN
    upper = ca.if_else(is_valid, ca.fmin(upper, UNBOUNDED), UNBOUNDED)
    data = {"q": q, "lower": lower, "upper": upper, "A": ca.densify(A), "is_valid": is_valid}
    data |= {"unroot": unroot, "slack_scale": scale, "row_scale": size, "control_a": control.a, "control_b": control.b}
    return layout, data


def reading(data: dict[str, ca.SX], x: ca.SX, y: ca.SX, layout: Layout) -> dict[str, ca.SX]:
    """What an answer `x` (n,) with multipliers `y` (k,), positive at an upper bound, says.

    `residual`: of the KKT conditions 2 x + q + A'y = 0 and A x = (A x + y, cut to the bounds), which is all that they
    ask of rows and multipliers; over 1 + |x|, and of a row over the distance between its bounds where that is smaller.
    At least what `broken` says of the hard rows; inf where the data are not valid. `margin` (k,): to a row's nearer
    bound, over the row's norm; `row_margin`: in the row's own units. `multiplier` (k,): by how much the minimum falls
    as the bound is moved, per unit of the row. `slack_sums` (2,): of the soft rows, and of the slacks of last resort.
    """
    A, lower, upper, size = ca.project(data["A"], layout.of_A), data["lower"], data["upper"], 1 + ca.norm_2(x)
    value, gradient = A @ x, 2 * x + data["q"] + A.T @ y
    rows = value - ca.fmin(ca.fmax(value + y, lower), upper)
    widths = ca.fmin(ca.fmax(upper - lower, CLOSEST * size), size)
    residual = ca.sqrt(ca.sumsqr(gradient / size) + ca.sumsqr(rows / widths))
    residual = ca.fmax(residual, broken(value, lower, upper, layout))
    rooted, slacks = ca.vertsplit(x, [0, layout.inputs, x.numel()])
    mu, slack = data["unroot"] @ rooted, data["slack_scale"] * (layout.of_slacks @ slacks)
    slack = ca.if_else(slack < ROUNDING, 0, slack)
    is_rescue = ca.DM(layout.rescues)
    return {
        "residual": ca.if_else(data["is_valid"], residual, ca.inf),
        **{name: data[name] for name in ("is_valid", "control_a", "control_b")},
        "mu": mu,
        "u": data["control_a"] @ mu + data["control_b"],
        "slack": slack,
        "slack_sums": ca.vertcat(ca.dot(1 - is_rescue, slack), ca.dot(is_rescue, slack)),
        "margin": (margin := ca.fmin(upper - value, value - lower)),
        "row_margin": data["row_scale"] * margin,
        "multiplier": y / data["row_scale"],
        "x": x,
        "y": y,
    }


def broken(value: ca.SX, lower: ca.SX, upper: ca.SX, layout: Layout) -> ca.SX:
    """By how much an answer breaks the hard rows at most, of rows whose `value` is A x: 0 where it keeps them.

    Each by its own scale, whatever the slacks of the others: over the distance between its bounds, and over 1 + |bound|
    where there is one bound. Bounds that are closer than `CLOSEST` times this count as so far apart.
    """
    if not layout.hard:
        return ca.SX(0)
    value, lower, upper = (column[layout.hard] for column in (value, lower, upper))
    size, has_both = 1 + ca.fmin(ca.fabs(lower), ca.fabs(upper)), ca.fmax(-lower, upper) < UNBOUNDED
    widths = ca.if_else(has_both, ca.fmax(upper - lower, CLOSEST * size), size)
    return ca.fmax(0, ca.mmax(ca.fmax(value - upper, lower - value) / widths))


def is_bounded(values: ca.SX) -> ca.SX:
    """1 where no number of `values` (n,), nor their sum, is beyond `UNBOUNDED`, else 0."""
    return ca.fabs(ca.sum1(values)) <= UNBOUNDED

"""Why a tick decided as it did: the rows in numbers, rows that exclude each other, the limit that would be needed.

    row i:   lower_i <= A_i mu - slack_i <= upper_i        hard, of last resort, or soft (the paper's d)

A soft row may always give way, so it excludes nothing. The other rows exclude each other where no mu meets them all
without slack. How far they are from that is a linear programme, each row divided by its norm:

    gap = min t >= 0   subject to   lower_i - t <= A_i mu <= upper_i + t

A least set of such rows is found by deletion (Chinneck and Dravnieks 1991): leave out one row after another, for good
where the rest still has a gap. What is left has a gap, and none without any one of its rows. The limit of the input is
left out first, then rows that cost little, so these are in the set only where they must be. Over m inputs it has m + 1
rows at most (Helly).

Nothing here knows a robot. Of any tick of `cbf_clf_qp`:

    print(*explain(tick, x, tick.p(wall=0.9)).lines(), sep="\\n")
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Array, NumpyFunction, Values, one_at_a_time
from cbf_clf_qp.qp import ROUNDING, TINY, UNBOUNDED
from cbf_clf_qp.quantity import Rows
from cbf_clf_qp.tick import Tick

GAP = 1e-6  # of rows that exclude each other, over 1 + |mu|; a smaller one is a solver's tolerance
BROKEN = 0.01  # a row that was measured to be beyond its bound by less, of its sizes, is kept
CHANGED = 0.1  # a share of the estimates that changes by less, over the larger one, is not told
Words = Mapping[str, tuple[str, str]]  # by a row's name: what it is for, and its unit


@dataclass(frozen=True)
class Row:
    """A row `lower <= value <= upper` of the QP in its own units, at the mu that was found.

    Its value is what the nominal model says and the share of the estimates, alpha mu + beta: what is promised.
    `measured`: what it became over the tick, NaN where nobody knows. `gives_way`: by how much the value is beyond its
    bound. `slack`, `multiplier`: as `Decided` has them. `kind`: hard, last resort or soft. `normal` (m,), `bounds`
    (2,): the row over the inputs w of `Explanation`, bounds[0] <= normal w <= bounds[1].
    """

    name: str
    kind: str
    lower: float
    upper: float
    nominal: float
    estimated: float
    measured: float
    gives_way: float
    slack: float
    multiplier: float
    is_active: bool
    normal: Array
    bounds: Array

    @property
    def value(self) -> float:
        """Promised: in all."""
        return self.nominal + self.estimated

    @property
    def is_broken(self) -> bool:
        """Whether the row was kept as promised, but for rounding, and not as measured."""
        beyond = max(self.measured - self.upper, self.lower - self.measured)
        return beyond > BROKEN * (abs(self.value) + abs(self.measured)) >= self.gives_way

    @property
    def asks(self) -> str:
        """What the row asks, as in `at least 54.5`."""
        if np.isinf(self.lower) or np.isinf(self.upper):
            return self.asks_on(np.isinf(self.lower))
        is_even = abs(self.lower + self.upper) <= ROUNDING * abs(self.upper)
        return f"±{number(self.upper)}" if is_even else f"{number(self.lower)} to {number(self.upper)}"

    def asks_on(self, upper_side: bool) -> str:
        """What it asks on one side."""
        return f"at most {number(self.upper)}" if upper_side else f"at least {number(self.lower)}"

    @property
    def state(self) -> str:
        """What the row does in this tick."""
        return "gives way" if self.gives_way else "active" if self.is_active else ""


@dataclass(frozen=True)
class Explanation:
    """A tick's `rows`; `excluding`: a least set of rows that exclude each other, by name what each asks in it.

    `factor`: on the limit of the input, the least with which all rows could be met, but for soft ones; inf where no
    input could, None where there is no limit. `w` (m,): the input u, or mu where u does not determine it.
    """

    rows: tuple[Row, ...]
    excluding: dict[str, str]
    factor: float | None
    w: Array

    def inputs_that_matter(self) -> list[int]:
        """The two inputs, or the only one, that move the rows in question most.

        Rows in question are those that exclude each other, else those that are active, but for the input's limit.
        """
        rows = [row for row in self.rows if row.kind != "hard"]
        chosen = [row for row in rows if row.name in self.excluding] or [row for row in rows if row.state] or rows
        weights = sum(np.abs(row.normal) / max(TINY, float(np.linalg.norm(row.normal))) for row in chosen)
        return sorted(np.argsort(-weights * np.ones(len(self.w)), kind="stable")[:2].tolist())

    def lines(self, words: Words | None = None) -> list[str]:
        """All of it in words."""
        words, table, is_measured = words or {}, [], any(np.isfinite(row.measured) for row in self.rows)
        for row in self.rows:
            numbers = [row.nominal, row.estimated, row.value, row.gives_way, abs(row.multiplier)]
            numbers[3:3] = [row.measured, row.measured - row.value] if is_measured else []
            cells = "".join(f"{number(value):>11}" for value in numbers)
            kind, (meaning, unit) = f"{row.kind}, {row.state}".rstrip(", "), meaning_of(row.name, words)
            table.append(f"{row.name:8}{f'{row.asks} {unit}':24}{cells}  {kind:22}  {meaning}".rstrip())
        measured = ("measured", "off by") if is_measured else ()
        names = "model", "estimates", "promised", *measured, "gives way", "multiplier"
        head = "".join(f"{name:>11}" for name in names)
        told = [f"{'row':8}{'asks':24}{head}", *table, ""]
        return [*told, *self._broken(words), *self._excluding(words), *self._needed(words), *self._paying()]

    def _excluding(self, words: Words) -> list[str]:
        asked = [f"  {in_words(name, asks, words)}" for name, asks in self.excluding.items()]
        n = len(asked)
        if n == 0:
            return ["No rows exclude each other: in the model some input meets all rows that are not soft."]
        if n == 1:
            return ["No input meets this row:", *asked]
        return [f"No input meets these {n} rows together; without any one of them some input meets the others:", *asked]

    def _needed(self, words: Words) -> list[str]:
        if self.factor is None:
            return []
        if np.isinf(self.factor):
            return ["No input would do, however large: its limit is not what excludes."]
        last = self.rows[-1]
        size = f"±{number(last.upper * self.factor)} {meaning_of(last.name, words)[1]}".rstrip()
        size = f"within {size}, {number(self.factor)} times its limit,"
        if self.excluding:
            return [f"With an input {size} no slack of last resort would be needed."]
        if self.factor < GAP:
            return ["In the model all of them are met even without an input."]
        return [f"In the model an input {size} could meet them."]

    def _paying(self) -> list[str]:
        excuse = "" if self.excluding else ", which cost less than an input that meets it"
        whys = {
            "soft": "it is soft, and this cost less than a larger mu",
            "last resort": f"its slack of last resort{excuse}",
        }
        paying = [row for row in self.rows if row.gives_way]
        told = [f"{row.name} gives way by {number(row.gives_way)}: {whys[row.kind]}." for row in paying]
        return told or ["No row gives way in the model."]

    def _broken(self, words: Words) -> list[str]:
        told = []
        for row in self.rows:
            off = f"{number(row.measured - row.value)} {meaning_of(row.name, words)[1]}".rstrip()
            numbers = f"promised {number(row.value)}, measured {number(row.measured)}, off by {off}"
            told += [f"{row.name} was kept in the model, not by the robot: {numbers}."] * row.is_broken
        return told


@one_at_a_time
def explain(
    tick: Tick,
    x: Array,
    p: Array,
    estimates: Estimates | None = None,
    decided: Decided | None = None,
    measured: Array | None = None,
) -> Explanation:
    """Explain what a tick `decided` at the state `x` (n,) with parameters `p`, by default what it decides there now.

    `measured`: the tick's quantities (k,) as measured over it, if they are known. Raises ValueError where no solver
    answered.
    """
    nothing = tick.no_error()
    estimates = estimates or nothing
    decided = decided or tick.decide(x, p, estimates)
    if not decided.solved:
        raise ValueError(f"no solver answered: {decided.status}")
    values, mu, layout = decided.values, decided.mu, tick.layout
    rows, by_model = (_RowsOverMu(tick.programme(x, p, errors), layout.inputs) for errors in (estimates, nothing))
    sign, constant, did = _constants(tick, x, p, rows, measured)
    at_mu = rows.A @ mu
    share = sign * (at_mu - by_model.A @ mu - rows.bound + by_model.bound)
    lower, upper = np.sort(sign * ([rows.lower, rows.upper] + constant), axis=0)
    beyond = np.where(values.slack > 0, np.maximum(at_mu - rows.upper, rows.lower - at_mu), 0.0)
    is_soft = layout.of_slacks.any(axis=1) & ~layout.rescues
    kinds = np.where(is_soft, "soft", np.where(layout.rescues, "last resort", "hard"))
    control = Affine(values.control_a, values.control_b)
    if len(control.b) != len(mu):
        control = Affine(np.eye(len(mu)), np.zeros(len(mu)))
    normals = np.linalg.solve(control.a.T, rows.A.T).T
    bounds = np.array([rows.lower, rows.upper]) + normals @ control.b
    names, active = _told_apart(layout.names), values.margin < ROUNDING * (1 + np.linalg.norm(mu))
    numbers = lower, upper, sign * (at_mu + constant) - share, share, did, beyond, values.slack, values.multiplier
    columns = names, kinds.tolist(), *(column.tolist() for column in (*numbers, active)), normals, bounds.T
    told = tuple(Row(*line) for line in zip(*columns, strict=True))
    programme = _Feasibility(rows, mu, limits=range(len(told) - tick.limits, len(told)))
    chosen = sorted(np.flatnonzero(~is_soft).tolist(), key=(np.abs(values.multiplier) * rows.norm).item)
    excluding = {names[i]: told[i].asks_on(side * sign[i] > 0) for i, side in programme.least_set(chosen).items()}
    return Explanation(told, excluding, programme.factor(chosen) if tick.limits else None, control(mu))


def changes(before: Explanation, now: Explanation) -> list[str]:
    """What is another in this tick than in the one before: rows, and shares of the estimates in those that count."""
    told, were = [], {row.name: row for row in before.rows}
    for row in now.rows:
        was = were.get(row.name, row)
        if row.state != was.state:
            told.append(f"{row.name}: {was.state or 'with room'} -> {row.state or 'with room'}")
        shares = np.array([was.estimated, row.estimated])
        if row.state and abs(np.diff(shares)[0]) > CHANGED * np.abs(shares).max() > TINY:
            told.append(f"{row.name}: estimates {number(was.estimated)} -> {number(row.estimated)}")
    return told


def number(value: float) -> str:
    """Three digits, or all before the point; a dash where there is none."""
    if np.isnan(value):
        return "-"
    return f"{value:.0f}" if 1000 <= abs(value) < 1e6 else "0" if abs(value) < TINY else f"{value:.3g}"


def meaning_of(name: str, words: Words) -> tuple[str, str]:
    """What a row is for, and its unit."""
    return words.get(name.split()[0], ("", ""))


def in_words(name: str, asks: str, words: Words) -> str:
    """A row in words, as in `B1, land before the far edge: at least 54.5 m/s²`."""
    meaning, unit = meaning_of(name, words)
    return f"{name}, {meaning}: {asks} {unit}" if meaning else f"{name}: {asks} {unit}".rstrip()


class _RowsOverMu:
    """`lower` <= `A` mu <= `upper` in the rows' own units; `bound`: the one that is finite; `norm` of each row."""

    def __init__(self, data: Values, inputs: int) -> None:
        size = data.row_scale
        self.A = np.linalg.solve(data.unroot.T, (data.A[:, :inputs] * size[:, None]).T).T
        bounds = np.array([data.lower, data.upper])
        self.lower, self.upper = np.where(np.abs(bounds) < UNBOUNDED, bounds * size, bounds * np.inf)
        self.bound = np.where(np.isinf(self.upper), self.lower, self.upper)
        self.norm = np.linalg.norm(self.A, axis=1)


def _constants(tick: Tick, x: Array, p: Array, rows: _RowsOverMu, measured: Array | None) -> tuple[Array, Array, Array]:
    """For each row a sign (k,) and what is to be added (k,), so that value = sign (A mu + constant) is told.

    Then the value (k,) of the `measured` quantities, NaN in a row that has none.

    The QP has what does not depend on mu in its bounds. Here a quantity's row has its whole value, and the sign that
    its first quantity has; a limit has u; a further constraint what mu moves.
    """
    n, nothing = len(tick.names), Rows((), ca.SX(0, len(tick.names)), ca.SX(0, 1), ca.SX(0, 1))
    blocks = [nothing, *tick.terms.rows(Affine(ca.SX.eye(n), ca.SX.zeros(n)))]
    stacked = {name: ca.vertcat(*(getattr(block, name) for block in blocks)) for name in ("A", "lower", "upper")}
    asked = NumpyFunction.of("asked", {"x": tick.system.x, "p": tick.system.p}, stacked, matrices=("A",))(x, p)
    first = np.array([row[np.flatnonzero(row)[:1]].sum() for row in asked.A])
    bound = np.tile(np.where(np.isinf(asked.upper), asked.lower, asked.upper), tick.cases)
    sign, constant = np.ones(len(rows.A)), np.zeros(len(rows.A))
    sign[: len(bound)] = np.tile(np.where(first < 0, -1, 1), tick.cases)
    constant[: len(bound)] = bound - rows.bound[: len(bound)]
    limits = slice(len(rows.A) - tick.limits, None)  # whose bounds on u are even
    constant[limits] = -(rows.lower + rows.upper)[limits] / 2
    did = np.full(len(rows.A), np.nan)
    if measured is not None:
        values = np.where(asked.A, asked.A * measured, 0).sum(axis=1)  # of those that count
        did[: len(bound)] = sign[: len(bound)] * np.tile(values, tick.cases)
    return sign, constant, did


def _told_apart(names: Sequence[str]) -> list[str]:
    """Rows that are there for several errors: `B1`, `B1 (2)`, ..."""
    seen = [names[: i + 1].count(name) for i, name in enumerate(names)]
    return [f"{name} ({count})" if count > 1 else name for name, count in zip(names, seen, strict=True)]


class _Feasibility:
    """Linear programmes over mu, in units of 1 + |mu|, and one more variable t >= 0; each row divided by its norm."""

    def __init__(self, rows: _RowsOverMu, mu: Array, limits: range) -> None:
        norm = np.where(rows.norm > TINY, rows.norm, 1.0)
        scale = norm * (1 + np.linalg.norm(mu))
        self.A, self.limits = rows.A / norm[:, None], limits
        self.lower, self.upper = rows.lower / scale, rows.upper / scale

    def least_set(self, chosen: list[int]) -> dict[int, int]:
        """Rows that exclude each other, and do not without any one of them; left out in this order, limits first.

        Of each 1 or -1: it is its upper or its lower bound that excludes.
        """
        gap, sides = self._gap(chosen)
        if gap <= GAP:
            return {}
        for i in sorted(chosen, key=lambda i: i not in self.limits):
            rest = [j for j in chosen if j != i]
            gap, of_rest = self._gap(rest)
            if gap > GAP:
                chosen, sides = rest, of_rest
        return {i: int(sides[chosen.index(i)]) for i in sorted(chosen)}

    def _gap(self, chosen: list[int]) -> tuple[float, Array]:
        return self._least([(i, self.lower[i], self.upper[i], 1.0) for i in chosen])

    def factor(self, chosen: list[int]) -> float:
        """The least f with which some mu meets the rows `chosen`, their limits times f; inf: there is none."""
        middle, half = (self.upper + self.lower) / 2, (self.upper - self.lower) / 2
        limits = [(i, middle[i], middle[i], half[i]) for i in self.limits]
        others = [(i, self.lower[i] - GAP, self.upper[i] + GAP, 0.0) for i in chosen if i not in self.limits]
        return self._least([*others, *limits])[0]

    def _least(self, rows: Sequence[tuple[int, float, float, float]]) -> tuple[float, Array]:
        """min t  subject to  lower - slope t <= A_i mu <= upper + slope t  of each (i, lower, upper, slope).

        inf where no t will do. Then of each row the sign of its multiplier, positive at the upper bound.
        """
        from scipy.optimize import linprog  # slow to import

        if not rows:
            return 0.0, np.zeros(0)
        i, lower, upper, slope = (np.array(column) for column in zip(*rows, strict=True))
        A = np.vstack([np.column_stack([self.A[i], -slope]), np.column_stack([-self.A[i], -slope])])
        b = np.concatenate([upper, -lower])
        kept, free = np.isfinite(b), [(None, None)] * self.A.shape[1]
        cost = np.eye(self.A.shape[1] + 1)[-1]
        result: Any = linprog(cost, A[kept], b[kept], bounds=[*free, (0, None)], method="highs")
        if not result.success:
            return np.inf, np.zeros(len(i))
        multipliers = np.zeros(len(b))
        multipliers[kept] = -result.ineqlin.marginals
        return float(result.fun), np.sign(np.subtract(*np.split(multipliers, 2)))

"""The same functions over N robots: `Function.map` of CasADi, so each row is to the bit what one robot gets."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cbf_clf_qp.answer import TOLERANCE, Answering
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Array, NumpyFunction, Values, one_at_a_time
from cbf_clf_qp.qp import Layout


class BatchValues:
    """The named arrays of N calls, each a view of `row` (N, size): (N, n), or (N, n, m) of a matrix."""

    def __init__(self, row: Array, one: NumpyFunction) -> None:
        self.row, self.places, self._one = row, one.places, one

    def __getattr__(self, name: str) -> Array:
        if name not in self.places:
            raise AttributeError(f"no value {name}: expected one of {', '.join(self.places)}")
        return self[name]

    def __getitem__(self, name: str) -> Array:
        place, shape = self.places[name]
        part = self.row[:, place]
        return part if len(shape) == 1 else part.reshape(len(part), *shape)

    def of(self, i: int) -> Values:
        """Those of one call."""
        return self._one.values(self.row[i])


class BatchFunction:
    """A `NumpyFunction` of which every input and output has a row for each of N robots."""

    def __init__(self, one: NumpyFunction) -> None:
        self.one = one
        self.size = one.function.numel_out()
        self._mapped: dict[int, tuple[list[Array], Array, Any, Any]] = {}  # by N

    def __call__(self, *values: Array, keep: bool = True) -> BatchValues:
        """Of values (N, ...), or (n,) that are the same for all; raises ValueError where one has another size.

        Without `keep` they are good until the next call, and need no memory of their own.
        """
        n = len(values[0])
        arguments, row, evaluate, _ = self._mapped.get(n) or self._map(n)
        for i, (argument, value) in enumerate(zip(arguments, values, strict=True)):
            if value.size != (argument.shape[1] if value.ndim == 1 else argument.size):
                name = self.one.function.name_in(i)
                raise ValueError(f"{name} has {value.size} numbers; expected {argument.shape[1]} for each of {n}")
            argument[...] = value if value.ndim <= 2 else value.reshape(n, -1)
        evaluate()
        return BatchValues(row.copy() if keep else row, self.one)

    @one_at_a_time
    def _map(self, n: int) -> tuple[list[Array], Array, Any, Any]:
        one = self.one.function
        buffer, evaluate = one.map(n).buffer()
        arguments, row = [np.zeros((n, one.numel_in(i))) for i in range(one.n_in())], np.zeros((n, one.numel_out()))
        for i, argument in enumerate(arguments):
            buffer.set_arg(i, argument.data)  # type: ignore[call-arg]  # casadi's stub is of C++
        buffer.set_res(0, row.data)  # type: ignore[call-arg]
        self._mapped[n] = arguments, row, evaluate, buffer
        return self._mapped[n]


@dataclass(frozen=True)
class BatchEstimates:
    """The `Estimates` of N robots: `alpha` (N, n, m), `beta` (N, n), `output_error` (N, m, m + 1); None: not known."""

    alpha: Array
    beta: Array
    output_error: Array | None

    @classmethod
    def of(cls, estimates: Sequence[Estimates]) -> "BatchEstimates":
        """From those of single robots."""
        errors = [each.output_error for each in estimates]
        known = None if any(error is None for error in errors) else np.array(errors)
        return cls(np.array([each.alpha for each in estimates]), np.array([each.beta for each in estimates]), known)

    def __add__(self, other: "BatchEstimates") -> "BatchEstimates":
        mine, others = self.output_error, other.output_error
        known = None if mine is None or others is None else mine + others
        return BatchEstimates(self.alpha + other.alpha, self.beta + other.beta, known)

    def __getitem__(self, i: int) -> Estimates:
        """Of robot `i`."""
        return Estimates(self.alpha[i], self.beta[i], None if self.output_error is None else self.output_error[i])


@dataclass
class BatchDecided:
    """What a tick decides for N robots, see `Decided`: `solved` (N,), lists `solver`, `status`; `seconds` a robot."""

    values: BatchValues
    layout: Layout
    solved: Array
    solver: list[str]
    status: list[str]
    seconds: float = 0.0


class BatchAnswering:
    """The answers to N programmes, each to the bit what `one` would give for a robot of its own.

    DAQP solves all in one call; OSQP, and each solver's guard, one after the other, with its own last answer.
    """

    def __init__(self, one: Answering, robots: int) -> None:
        self._programme, self._solve = BatchFunction(one.programme), BatchFunction(one.solving)
        self._reading, self._layout = BatchFunction(one.reading), one.layout
        self._ones = [one.another() for _ in range(robots)]
        self._by_daqp = one.solver == "daqp"

    def __call__(self, *inputs: Array) -> BatchDecided:
        """Of the inputs, a row a robot."""
        n, start = len(inputs[0]), time.perf_counter()
        if self._by_daqp:
            data = self._programme(*inputs, keep=False)
            answer = self._solve(data.row, keep=False)
            values = self._reading(data.row, answer.x, answer.y)
            solved = values.row[:, 0] < TOLERANCE
            decided = BatchDecided(values, self._layout, solved, ["daqp"] * n, ["solved"] * n)
        else:
            rows = BatchValues(np.empty((n, self._reading.size)), self._reading.one)
            decided = BatchDecided(rows, self._layout, np.zeros(n, dtype=bool), [""] * n, [""] * n)
        for i in (~decided.solved).nonzero()[0].tolist():
            one = self._ones[i](*(each[i] for each in inputs))
            decided.values.row[i], decided.solved[i] = one.values.row, one.solved
            decided.solver[i], decided.status[i] = one.solver, one.status
        decided.seconds = (time.perf_counter() - start) / n
        return decided

    def reset(self, i: int) -> None:
        """Forget the last programme of robot `i`."""
        self._ones[i].reset()

    def keep(self, rows: Sequence[int] | Array) -> None:
        """Go on with some of the robots, by number."""
        self._ones = [self._ones[i] for i in rows]

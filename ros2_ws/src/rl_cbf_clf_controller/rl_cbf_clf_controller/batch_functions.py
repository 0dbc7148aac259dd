"""Functions of N robots at once: arrays have a row for each, which has to the bit what the robot's own call gives.

Each instruction is done for all robots before the next one, which takes a seventh of the time of N calls.
"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import zip_longest
from time import perf_counter

import casadi as ca
import numpy as np
from cbf_clf_qp.answer import TOLERANCE, Answering, Decided, by_daqp
from cbf_clf_qp.functions import NumpyFunction, Values, one_at_a_time
from rabbit_description.state import Array


class BatchFunction:
    """A function, `alone`, of N calls at once. One object serves one thread.

    `of_n`: makes the CasADi function of n calls, of which inputs and output are (n, size).
    """

    def __init__(self, alone: NumpyFunction, of_n: Callable[[int], ca.Function] | None = None) -> None:
        self._alone, self._of_n = alone, of_n or partial(together, alone.function)
        self._functions = dict[int, NumpyFunction]()  # by n

    def __call__(self, *values: Array) -> Values:
        """The outputs of N calls, of values (N, ...), or (n,) the same for all; inputs left out are zero."""
        n = len(values[0])
        if n == 1:
            return self._alone.values(self._alone(*values).row[None])
        for value, (_, size, name) in zip(values, self._alone.arguments):  # noqa: B905
            if value.size != (size if value.ndim == 1 else n * size):
                raise ValueError(f"{name} has {value.size} numbers; expected {size} for each of {n}")
        room = 1 << (n - 1).bit_length()  # so that a few functions serve any n
        if room not in self._functions:
            self._functions[room] = self._made(room)
        function = self._functions[room]
        for value, (argument, *_) in zip_longest(values, function.arguments, fillvalue=np.zeros(1)):
            argument.reshape(-1, room)[:, :n] = value[:, None] if value.ndim == 1 else value.reshape(n, -1).T
        function.evaluate()
        return self._alone.values(function.row.reshape(-1, room)[:, :n].T.copy())

    @one_at_a_time
    def _made(self, n: int) -> NumpyFunction:
        return NumpyFunction(self._of_n(n), {})


def together(function: ca.Function, n: int) -> ca.Function:
    """n calls of a function of scalars: each of its instructions as one of columns (n,)."""
    given = [ca.MX.sym(function.name_in(i), n, function.numel_in(i)) for i in range(function.n_in())]
    columns, found = [ca.horzsplit(each) for each in given], [ca.MX()] * function.numel_out()
    work = dict[int, ca.MX]()
    for k in range(function.n_instructions()):
        operation, of = function.instruction_id(k), function.instruction_input(k)
        to = function.instruction_output(k)
        if operation == ca.OP_CONST:
            work[to[0]] = ca.MX(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            work[to[0]] = columns[of[0]][of[1]]
        elif operation == ca.OP_OUTPUT:
            found[to[1]] = work[of[0]] if work[of[0]].numel() == n else ca.repmat(work[of[0]], n, 1)
        elif len(of) == 1:
            work[to[0]] = ca.MX.unary(operation, work[of[0]])
        else:
            work[to[0]] = ca.MX.binary(operation, work[of[0]], work[of[1]])
    return ca.Function(function.name(), given, [ca.horzcat(*found)])


def batch_with_daqp(answering: Answering) -> BatchFunction:
    """Programme, DAQP and reading of N robots."""
    programme, reading = answering.programme, answering.reading.function

    def of_n(n: int) -> ca.Function:
        given = [ca.MX.sym(name, n, size) for _, size, name in programme.arguments]
        data = together(programme.function, n)(*given)
        x, y = by_daqp(data.T, programme.places)
        return ca.Function("decided", given, [together(reading, n)(data, x.T, y.T)])

    return BatchFunction(answering.with_daqp, of_n)


def answers(robots: Sequence[Answering], with_daqp: BatchFunction, *inputs: Array) -> Decided:
    """Those to N programmes, a row of each input a robot; each to the bit what the robot's own gives.

    DAQP solves all in one call; OSQP, and each solver's guard, one after the other, from its own last answer.
    """
    start, n, first = perf_counter(), len(robots), robots[0]
    values = with_daqp(*inputs)
    solved = (values.row[:, 0] < TOLERANCE) & (first.solver == "daqp")
    decided = Decided(values, first.layout, solved, ["daqp"] * n, ["solved"] * n, 0.0)
    for i in (~solved).nonzero()[0].tolist():
        one = robots[i](*(each[i] for each in inputs))
        values.row[i], solved[i] = one.values.row, one.solved
        decided.solver[i], decided.status[i] = one.solver, one.status
    decided.seconds = (perf_counter() - start) / n
    return decided

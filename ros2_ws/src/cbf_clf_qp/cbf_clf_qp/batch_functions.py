"""Functions of N robots at once: arrays have a row for each, which has to the bit what the robot's own call gives."""

from itertools import zip_longest

import numpy as np

from cbf_clf_qp.functions import Array, NumpyFunction, Values, one_at_a_time


class BatchFunction:
    """A function, `alone`, of N calls at once. One object serves one thread."""

    def __init__(self, alone: NumpyFunction) -> None:
        self._alone, self._n, self._of = alone, 1, alone.fastest
        self._made = alone

    def __call__(self, *values: Array) -> Values:
        """The outputs of N calls, of values (N, ...), or (n,) the same for all; inputs left out are zero."""
        n = len(values[0])
        if n == 1:
            return self._alone.values(self._alone(*values).row[None])
        for value, (_, size, name) in zip(values, self._alone.arguments):  # noqa: B905
            if value.size != (size if value.ndim == 1 else n * size):
                raise ValueError(f"{name} has {value.size} numbers; expected {size} for each of {n}")
        self._alone.count(n)
        if self._n != n or self._of is not self._alone.fastest:
            self._make(n)
        for value, (argument, *_) in zip_longest(values, self._made.arguments, fillvalue=np.zeros(1)):
            argument.reshape(n, -1)[...] = value if value.ndim == 1 else value.reshape(n, -1)
        self._made.evaluate()
        return self._alone.values(self._made.row.reshape(n, -1).copy())

    @one_at_a_time
    def _make(self, n: int) -> None:
        self._n, self._of = n, self._alone.fastest
        self._made = NumpyFunction(self._of.map(n), {})

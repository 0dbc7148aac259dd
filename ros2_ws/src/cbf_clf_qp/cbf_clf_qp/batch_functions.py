"""Functions of N robots at once: arrays have a row for each, which has to the bit what the robot's own call gives."""

from typing import Any

import numpy as np

from cbf_clf_qp.functions import Array, NumpyFunction, Values, one_at_a_time


class Bound:
    """A function of rows, bound to the arrays (N, ...) that it reads. Each call computes `row` (N, size)."""

    def __init__(self, function: NumpyFunction, *arrays: Array, row: Array | None = None) -> None:
        """`row`: where the outputs go, if not into a new array."""
        self._function, self._arrays = function, arrays
        self.row = np.zeros((len(arrays[0]), function.row.size)) if row is None else row
        self._fastest: Any = None  # bound at its first call

    @one_at_a_time
    def _bind(self) -> None:
        self._fastest, n = self._function.fastest, len(self.row)
        self._buffer, self._evaluate = (self._fastest if n == 1 else self._fastest.map(n)).buffer()
        for i, array in enumerate(self._arrays):
            self._buffer.set_arg(i, array.reshape(-1).data)
        self._buffer.set_res(0, self.row.reshape(-1).data)

    def __call__(self) -> Array:
        self._function.count(len(self.row))
        if self._function.fastest is not self._fastest:
            self._bind()
        self._evaluate()
        return self.row


class BatchFunction:
    """A function, `alone`, of N calls at once. One object serves one thread."""

    def __init__(self, alone: NumpyFunction) -> None:
        self._alone, self._n = alone, 0

    def __call__(self, *values: Array) -> Values:
        """The outputs of N calls, of values (N, ...), or (n,) the same for all; inputs left out are zero."""
        n, arguments = len(values[0]), self._alone.arguments
        if n != self._n:
            self._n, self._arrays = n, [np.zeros((n, size)) for _, size, _ in arguments]
            self._bound = Bound(self._alone, *self._arrays)
        for value, array, (_, size, name) in zip(values, self._arrays, arguments):  # noqa: B905  those left out are zero
            if value.size != (size if value.ndim == 1 else n * size):
                raise ValueError(f"{name} has {value.size} numbers; expected {size} for each of {n}")
            array[...] = value if value.ndim == 1 else value.reshape(n, -1)
        for array in self._arrays[len(values) :]:
            array[...] = 0
        return self._alone.values(self._bound().copy())

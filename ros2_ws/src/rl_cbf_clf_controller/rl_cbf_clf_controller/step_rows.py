"""The step of N robots: memory, readings and reports as arrays with a row for each; see `step.py`."""

from typing import Any

import numpy as np
from cbf_clf_qp.functions import NumpyFunction, one_at_a_time
from rabbit_description.state import Array

from rl_cbf_clf_controller.step import StepFunctions


class Bound:
    """A function of rows, bound to the arrays that it reads: a call computes `row` anew, (N, size)."""

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


class StepRows:
    """Of `n` robots. One object serves one thread."""

    def __init__(self, f: StepFunctions, first: Array, n: int) -> None:
        self.memory, self.reading = np.tile(first, (n, 1)), np.zeros((n, f.reading.size))
        self.settings, gaits = np.zeros((n, f.settings.size)), np.tile(f.gaits, (n, 1))
        arrays = self.memory, self.reading, self.settings
        self.stand = Bound(f.stand, *arrays)
        self.see = Bound(f.see, *arrays, gaits, self.stand.row)
        self.look = Bound(f.look, *arrays, gaits, row=self.see.row)
        self.step = Bound(f.step, *arrays, gaits)
        self.estimates = np.zeros((n, f.estimates.size))
        self.decide = Bound(f.decide, self.reading, self.settings, self.see.row, self.estimates)
        self.data = Bound(f.data, self.see.row, self.estimates)
        self.x, self.y, self.tolerance = (np.zeros((n, f.finish.function.numel_in(i))) for i in ("x", "y", "tolerance"))
        answer = self.data.row, self.x, self.y, self.tolerance
        self.finish = Bound(f.finish, self.reading, self.settings, self.see.row, *answer)

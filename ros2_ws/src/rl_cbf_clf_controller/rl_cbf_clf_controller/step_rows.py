"""The step of N robots: memory, readings and reports as arrays with a row for each; see `step.py`."""

import numpy as np
from cbf_clf_qp.batch_functions import Bound
from rabbit_description.state import Array

from rl_cbf_clf_controller.step import StepFunctions


class StepRows:
    """The rows of `n` robots. One object serves one thread."""

    def __init__(self, f: StepFunctions, first: Array, n: int) -> None:
        self.memory, self.reading = np.tile(first, (n, 1)), np.zeros((n, f.reading.size))
        self.settings, gaits = np.zeros((n, f.settings.size)), np.tile(f.gaits, (n, 1))
        arrays = self.memory, self.reading, self.settings
        self.look = Bound(f.look, *arrays, gaits)
        self.step = Bound(f.step, *arrays, gaits)
        self.estimates = np.zeros((n, f.estimates.size))
        self.decide = Bound(f.decide, self.reading, self.settings, self.look.row, self.estimates)
        self.data = Bound(f.data, self.look.row, self.estimates)
        self.x, self.y, self.tolerance = (np.zeros((n, f.finish.function.numel_in(i))) for i in ("x", "y", "tolerance"))
        answer = self.data.row, self.x, self.y, self.tolerance
        self.finish = Bound(f.finish, self.reading, self.settings, self.look.row, *answer)

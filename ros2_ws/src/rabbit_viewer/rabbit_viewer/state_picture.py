"""The picture of a task without `draw`: its state as a point in the plane of the first two coordinates.

A red line is where a barrier is zero, of each barrier that depends on no other component of the state. Both axes are
scaled so that the frame is [-1, 1] x [-1, 1]: twice the smallest box around the first states in which each of these
barriers changes its sign.
"""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np
from cbf_clf_qp.functions import Array
from contourpy import contour_generator
from rabbit_description.task import ControlTask, Disc, Line, Shape

ALONG = np.linspace(-1.0, 1.0, 41)
LEAST = 0.05  # of the box, half of a side, in the coordinate's unit
DOUBLINGS = 10
FRAME = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))


class StatePicture:
    """`shapes` of a state; `note`: lines that say which coordinates they show."""

    def __init__(self, task: ControlTask) -> None:
        system, count = task.system, min(2, task.system.x.numel())
        plane, rest = system.x[:count], system.x[count:]
        self._count = count
        drawn = [barrier.B for barrier in task.barriers if not ca.depends_on(barrier.B, rest)]
        self._B = ca.Function("B", [plane, system.p], [ca.vertcat(ca.SX(0, 1), *drawn)])
        low, high = np.asarray(task.start, dtype=float)[:, :count]
        self._middle = (low + high) / 2
        self._half = np.maximum((high - low) / 2, np.maximum(np.abs(self._middle), LEAST))
        p = task.parameters_at({}, task.beginning(0)[1](0.0, 0))
        for _ in range(DOUBLINGS):
            values = self._values(p)
            if all(B.min() < 0 < B.max() for B in values):
                break
            self._half = 2 * self._half
        self._half = 2 * self._half  # room to move
        across, *up = task.names_of_x[:count]
        axes = f"{across} to the right" + "".join(f", {name} up" for name in up)
        self.note = (axes, "another picture: by the task's draw")
        self._curves = lru_cache(maxsize=1)(self._curves_at)

    def shapes(self, x: Array, p: Array) -> Sequence[Shape]:
        """The shapes in the state `x` (n,) with the parameters `p` (k,)."""
        at = np.zeros(2)
        at[: self._count] = (x[: self._count] - self._middle) / self._half
        return [Line(np.array(FRAME, dtype=float), "gray", 1), *self._curves(tuple(p)), Disc(at, 0.03, "tab:blue")]

    def _values(self, p: Sequence[float] | Array) -> list[Array]:
        """The values of the drawn barriers over the box."""
        grid = np.array(np.meshgrid(ALONG, ALONG)).reshape(2, -1)[: self._count]
        values = np.array(self._B(self._middle[:, None] + self._half[:, None] * grid, np.asarray(p)))
        return [row.reshape(len(ALONG), -1) for row in values]

    def _curves_at(self, p: tuple[float, ...]) -> list[Shape]:
        curves = [line for B in self._values(p) for line in contour_generator(ALONG, ALONG, B).lines(0.0)]
        return [Line(np.asarray(curve), "tab:red", 2) for curve in curves]


@lru_cache(maxsize=4)
def state_picture(task: ControlTask) -> StatePicture:
    """The picture of a task, made once."""
    return StatePicture(task)

"""One robot's steps, for numpy: the functions of `step_begin.py`, and what is kept between them."""

from copy import copy

import casadi as ca
import numpy as np
from cbf_clf_qp.functions import NumpyFunction, Values, places_of
from rabbit_description.gait import Gaits
from rabbit_description.state import Array, StonePreview
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.robot_numbers import RobotNumbers
from rl_cbf_clf_controller.step_begin import kept_at_first, step_functions
from rl_cbf_clf_controller.step_paths import GaitExpressions, Shape, as_library, gait_row
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints

NO_STONE = np.full(3, np.nan)


class Steps:
    """Through a gait or a library, on the stones that are seen. One object, with `another`, serves one thread.

    `shape`: of the gaits; `place` (2,): of the stance foot in the world, m; `slope_change`: degrees that are added to
    the slopes that the speed's regulation chooses, to explore.
    """

    def __init__(self, gaits: Gaits, parameters: ControllerParameters, robot: RobotNumbers) -> None:
        self.shape, self.slope_change = Shape.of(gaits), 0.0
        first, begin = map(for_numpy, step_functions(self.shape, parameters.speed_regulation))
        numbers = gait_row(gaits)
        self._begin, self._at_first = begin, first(numbers)
        self._places = places_of(kept_at_first(GaitExpressions(self.shape), self.shape))
        self._constants = numbers, np.array([parameters.stone_aim]), robot.joints, robot.feet
        self._outputs = VirtualConstraints(as_library(gaits).gaits[0])
        self.first()

    def another(self) -> "Steps":
        """For another robot in the same thread, with the same functions."""
        return copy(self)

    @property
    def wanted(self) -> float:
        """Length of the present step, m; 0 of a single gait."""
        return float(self.kept("wanted")[0])

    @property
    def slope(self) -> float:
        """That the present step is made for, degrees."""
        return float(self.kept("slopes")[0])

    def kept(self, name: str) -> Array:
        """What is kept from step to step, see `kept_at_first`."""
        return self._kept[self._places[name][0]]

    def first(self) -> VirtualConstraints:
        """Outputs before any step of an episode has begun: of the gait that it begins with."""
        self.place = np.zeros(2)
        return self._follow(self._at_first)

    def begin(self, x: Array, seconds: float | None = None, stone: StonePreview | None = None) -> VirtualConstraints:
        """Outputs of the step that begins at `x` (14,), stance/swing order, towards the `stone` that is seen; `seconds`
        that the step before it took, None before the first."""
        seen = NO_STONE if stone is None else np.array([stone.l_min, stone.l_max, stone.height])
        numbers = np.array([[np.nan if seconds is None else seconds], [self.slope_change]])
        found = self._begin(x, seen, numbers[0], self._kept, *self._constants, numbers[1])
        self.place = found.place
        return self._follow(found)

    def _follow(self, found: Values) -> VirtualConstraints:
        self._kept = found.steps_after
        outputs = copy(self._outputs)
        outputs.row, outputs.scale = found.path, found.phase_scale
        return outputs


def for_numpy(function: ca.Function) -> NumpyFunction:
    """The same function, its outputs by name."""
    given = function.sx_in()
    names, outputs = (
        zip(function.name_in(), given, strict=True),
        zip(function.name_out(), function.call(given), strict=True),
    )
    return NumpyFunction.of(function.name(), dict(names), dict(outputs))

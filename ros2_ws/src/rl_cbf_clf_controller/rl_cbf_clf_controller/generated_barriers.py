"""The barriers of `stone_barriers.py`, computed by generated C."""

import ctypes
from collections.abc import Callable

from cbf_clf_qp.ecbf import Barriers
from rabbit_description.state import StonePreview

from rl_cbf_clf_controller.generated.layout import BARRIERS
from rl_cbf_clf_controller.generated.library import GeneratedFunction, load_library
from rl_cbf_clf_controller.nominal_model import Kinematics
from rl_cbf_clf_controller.stone_barriers import stone_barriers


class GeneratedStoneBarriers:
    """B1 and B2 of circles with radii R1, R2, m."""

    def __init__(self, library: ctypes.CDLL, R1: float, R2: float) -> None:
        self._function = GeneratedFunction(library, BARRIERS)
        self._function.arguments[self._function.argument_slices["radii"]] = R1, R2

    def __call__(self, feet: Kinematics, l_min: float, l_max: float) -> Barriers:
        """Of the swing foot, for a stone from `l_min` to `l_max`, m."""
        arguments = self._function.arguments
        arguments[:2], arguments[2:4] = feet.swing, feet.swing_rate
        arguments[4:18], arguments[18:20] = feet.swing_jacobian.ravel(), feet.swing_bias
        arguments[20], arguments[21] = l_min, l_max
        found = self._function()
        # as in layout.FUNCTIONS[BARRIERS]; a test compares
        return Barriers(found[:2], found[2:4], found[4:18].reshape(2, 7), found[18:])


def make_stone_barriers(R1: float, R2: float) -> Callable[[Kinematics, float, float], Barriers]:
    """Barriers of a swing foot for a stone's edges, m: generated code if it is built."""
    library = load_library()
    if library is None:
        return lambda feet, l_min, l_max: stone_barriers(feet, StonePreview(0, l_min, l_max), R1, R2)
    return GeneratedStoneBarriers(library, R1, R2)

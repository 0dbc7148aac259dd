"""The outputs of one step: a gait's own, or with a library those of a step from one length into another.

`step_paths.py` finds the path of a step from length A into length B: A is where the feet stand at the touchdown, B what
the previewed stone asks for. The touchdown leaves the joints beside the path, at y_0 and y_0'. So that the step begins
without error, the desired outputs are

    y_d(s) = path(s) + (1 - x)^3 (a + b x)    for x = (s - s_0) / w < 1,  s_0: the phase at the touchdown,  w: width

with a = y_0 and b = w y_0' / s_0' + 3 a: then y = y' = 0 at s_0, and y_d'' is continuous where the correction ends.
The correction is a Bézier polynomial of x; before s_0 its curvature fades as in `bezier.py`. At the first tick of a
step s is s_0 but for rounding, so nothing may jump there.

Ground that lies lower than expected is met late. A path that only went on along its end would lead the foot forward and
up again, for the body moves on. So beyond phase 1, where there are gaits for slopes, the foot goes straight down:

    y_d(s) = path(s) + D g(s - 1),    g(x) = x - 2 f + (x + 2 f) exp(-x / f) for x > 0, else 0,    f = FADING:

g, g' and g'' begin with 0, and g' goes to 1. `step_paths.descent` finds D.
"""

from copy import copy
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from rabbit_description.gait import Gait, GaitLibrary, Gaits
from rabbit_description.state import Array, StonePreview

from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.robot_numbers import Feet
from rl_cbf_clf_controller.speed_regulation import IntegralRegulation, SpeedRegulation
from rl_cbf_clf_controller.step_paths import descent, landing_at, speed_of, start_rate, step_path, within
from rl_cbf_clf_controller.virtual_constraints import RABBIT_ANGLES, Correction, VirtualConstraints

FADED = 0.5  # phase at which the correction ends
FADED_ON_SLOPES = 0.7  # of steps whose slope differs from the last one's: their corrections are larger
LEAST_WIDTH = 0.1  # of the phase, of a correction that begins late
HIGHER = 0.003  # m, above what a preview says: a foot that is met too early by its stone meets the stone's side
REGULATIONS = {"learned": SpeedRegulation, "integral": IntegralRegulation}
LEAST_RATE = 0.5  # 1/s; of a robot that hardly moves forward, y' is not made continuous


def corrected(
    outputs: VirtualConstraints, q_s: Array, dq_s: Array, faded: float = FADED, descent: Array | None = None
) -> VirtualConstraints:
    """The `outputs` of a path, made zero, with their rates, at the state that the step begins with.

    From the phase `faded` on they are the path's, and beyond 1 what `descent` (4,), rad, adds to it.
    """
    begun = outputs.evaluate(q_s, dq_s)
    width = max(faded - begun.phase, LEAST_WIDTH)
    a, b = begun.y, width * begun.dy / max(begun.phase_rate, LEAST_RATE) + 3 * begun.y
    coeffs = np.column_stack([a, (a + b) / 4, np.zeros((len(a), 3))])
    return outputs.with_correction(Correction(coeffs, begun.phase, width), descent)


@dataclass(frozen=True)
class Touchdown:
    """What a step begins with: the state `q_s`, `dq_s` (7,), stance/swing order; how far apart the feet stand, m; how
    long the step before it took, s, None before the first; and the next stone, where one is seen."""

    q_s: Array
    dq_s: Array
    length: float
    seconds: float | None = None
    stone: StonePreview | None = None


class SingleGait:
    """The same outputs in every step."""

    wanted: tuple[float, ...] = ()  # the step length, m, that a policy may see

    def __init__(self, gait: Gait) -> None:
        self._outputs = VirtualConstraints(gait)

    def first(self) -> VirtualConstraints:
        """Outputs before any step of an episode has begun: the gait's."""
        return self._outputs

    def begin(self, touchdown: Touchdown) -> VirtualConstraints:
        """Outputs of the step that begins there: the gait's."""
        return self._outputs

    def another(self) -> "SingleGait":
        """For another robot in the same thread: nothing is kept from step to step."""
        return self


class LibrarySteps:
    """Steps through a library: from where the feet stand to `aim`, a share of the stone's width, on the stone.

    With gaits for several slopes the speed is regulated by the slope that a step is made for. A step then ends at its
    stone's height; where the foot finds no ground there, it goes on straight down. `feet` are the robot's.
    """

    def __init__(
        self, library: GaitLibrary, aim: float, feet: Feet, regulation: type[SpeedRegulation] = SpeedRegulation
    ) -> None:
        self._library, self._aim, self._feet = library, aim, feet
        self.regulation = regulation(library.slopes[0], library.slopes[-1])
        self._has_slopes = len(library.slopes) > 1
        self._outputs = VirtualConstraints(library.gaits[0])
        self.wanted: tuple[float, ...] = (library.start_length,)

    def another(self) -> "LibrarySteps":
        """For another robot in the same thread, with the same functions."""
        other = copy(self)
        other.regulation = type(self.regulation)(self.regulation.least, self.regulation.most)
        return other

    @property
    def slope(self) -> float:
        """That the present step is made for, degrees."""
        return self.regulation.slope

    def first(self) -> VirtualConstraints:
        """Of the gait that an episode begins with."""
        self.regulation.reset()
        length = self._library.start_length
        self.wanted = (length,)
        return self._outputs.along(step_path(self._library, length, length, self.slope))

    def begin(self, touchdown: Touchdown) -> VirtualConstraints:
        """Towards the stone; where there is none, steps of the start's length."""
        stone, taken = touchdown.stone, touchdown.length
        if self._has_slopes and touchdown.seconds is not None:
            self._regulate(touchdown, touchdown.seconds)
        if stone is not None:
            wanted = stone.l_min + self._aim * (stone.l_max - stone.l_min)
            self.wanted = (within(self._library.lengths, wanted),)
        path = step_path(self._library, taken, self.wanted[0], self.slope)
        if not self._has_slopes:
            return corrected(self._outputs.along(path), touchdown.q_s, touchdown.dq_s)
        if stone is not None:
            path = landing_at(path, stone.height + HIGHER, self._feet)
        down = descent(path, self._feet)
        return corrected(self._outputs.along(path), touchdown.q_s, touchdown.dq_s, FADED_ON_SLOPES, down)

    def _regulate(self, touchdown: Touchdown, seconds: float) -> None:
        """The next step's slope, from the step that took so many `seconds`."""
        rate = float(RABBIT_ANGLES.phase_angle @ touchdown.dq_s)
        gait_s_rate = start_rate(self._library, touchdown.length, self.slope)
        speed, gait_s_speed = touchdown.length / seconds, speed_of(self._library, *self.wanted)
        self.regulation.after(gait_s_rate - rate, gait_s_speed - speed)


Steps = SingleGait | LibrarySteps


def has_lengths(gaits: Gaits) -> TypeGuard[GaitLibrary]:
    """A library in which steps have a length or a slope to choose; a library of one gait is that gait."""
    return isinstance(gaits, GaitLibrary) and len(gaits.gaits) > 1


def make_steps(gaits: Gaits, parameters: ControllerParameters, feet: Feet) -> Steps:
    """Of a gait, or of a library."""
    if has_lengths(gaits):
        return LibrarySteps(gaits, parameters.stone_aim, feet, REGULATIONS[parameters.speed_regulation])
    return SingleGait(gaits.gaits[0] if isinstance(gaits, GaitLibrary) else gaits)

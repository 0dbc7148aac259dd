"""What says how wrong the nominal quantities are, and what it reads of a tick: state, nominal model, sensors."""

from dataclasses import dataclass
from typing import Any

from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import NumpyFunction, Values
from rabbit_description.state import Array, Leg


class ControllerError(ValueError):
    """A state or policy that the controller refuses: names the field, its value and what was expected."""


@dataclass(slots=True)  # not frozen: that would take a tick 2 us
class Scene:
    """A state `x` = (q, q') (14,) in stance/swing order, and what is seen of it.

    `seen`: the tick's parameters `p` there and the nominal terms, see `recipes.reads`; `force` (2, 2), N, as the
    sensors averaged it over the last tick: rows stance, swing foot; columns tangential, normal; `observation` (14,),
    with a stone (15,), there with a gait library (16,), see `Problem.observation`; `tick` counts from the episode's
    start; `torque` (4,), N m, was applied in the last tick, NaN: unknown; `stance` is the leg that stands, since
    `step_time`, s, in step `step_index`. `model_error`: a function of (x, p, the parameters of another model), see
    `cbf_clf_qp.estimates`. Of N robots: arrays, and `seen`, have a row for each.
    """

    x: Array
    seen: Values
    force: Array
    observation: Array
    tick: Any  # int, or (N,), as what follows
    torque: Array
    stance: Any  # Leg
    step_index: Any  # int
    step_time: Any  # float
    model_error: NumpyFunction

    def __getitem__(self, i: int) -> "Scene":
        """The scene of robot `i` of N."""
        arrays = self.x[i], self.seen[i], self.force[i], self.observation[i], int(self.tick[i]), self.torque[i]
        of_step = Leg(int(self.stance[i])), int(self.step_index[i]), float(self.step_time[i])
        return Scene(*arrays, *of_step, self.model_error)

    @property
    def p(self) -> Array:
        """The tick's parameters."""
        return self.seen.p

    @property
    def LgV(self) -> Array:
        """V-dot's slope over mu (4,)."""
        return self.seen.LgV

    def error_of(self, robot: Array) -> Estimates:
        """By how much the quantities of another `robot`, its numbers as a row, differ from the nominal ones."""
        true = self.p.copy()
        true[: robot.size] = robot
        error = self.model_error(self.x, self.p, true)
        return Estimates(error.alpha, error.beta, error.output_error)

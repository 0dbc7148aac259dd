"""What the quantities and estimators read of a state: outputs, feet, barriers, sensors. No mass enters here."""

import math
from dataclasses import dataclass, field

import numpy as np
from cbf_clf_qp.ecbf import Barriers
from rabbit_description.state import Array

from rl_cbf_clf_controller.pinned_robot import Kinematics
from rl_cbf_clf_controller.virtual_constraints import Outputs


class ControllerError(ValueError):
    """A state or policy that the controller refuses: names the field, its value and what was expected."""


@dataclass(frozen=True)
class Scene:
    """A state in stance/swing order, `q_s`, `dq_s` (7,), and its kinematics; `barriers` is None where no stone is.

    `force` (2, 2), N, as the sensors averaged it over the last tick: rows stance, swing foot; columns tangential,
    normal; `observation` (14,), with a stone (15,), there with a gait library (16,), see `Problem.observation`;
    `LgV` (4,); `tick` counts from the episode's start; `torque` (4,), N m, was applied in the last tick, NaN: unknown;
    `stance` is 0 where the left leg stands, 1 where the right one does.
    """

    q_s: Array
    dq_s: Array
    feet: Kinematics
    outputs: Outputs
    barriers: Barriers | None
    force: Array
    observation: Array
    LgV: Array
    tick: int = 0
    torque: Array = field(default_factory=lambda: np.full(4, np.nan))
    stance: int = 0


def is_finite(values: Array) -> bool:
    """Whether all of a few numbers are, and their sum; numpy's own way takes ten times as long."""
    return math.isfinite(sum(values.tolist()))

"""What the quantities read of a state: outputs, feet, the stone's barriers. Nothing here depends on masses."""

from dataclasses import dataclass

from cbf_clf_qp.ecbf import Barriers
from rabbit_description.state import Array

from rl_cbf_clf_controller.nominal_model import Kinematics
from rl_cbf_clf_controller.virtual_constraints import Outputs


@dataclass(frozen=True)
class Scene:
    """A state in stance/swing order, `q_s`, `dq_s` (7,), and its kinematics; `barriers` is None where no stone is.

    `force` (2,) of the stance foot, tangential and normal, N, as the sensor averaged it over the last tick;
    `observation` (14,), with a stone (15,), there with a gait library (16,), see `Problem.observation`; `LgV` (4,).
    """

    q_s: Array
    dq_s: Array
    feet: Kinematics
    outputs: Outputs
    barriers: Barriers | None
    force: Array
    observation: Array
    LgV: Array

"""RABBIT as a controller sees it, in symbols: pinned robot, outputs, stone, gains. Quantities are made of these.

Everything that may change while the robot walks is a parameter of the `system`: the robot itself, the path of this
step, the stone, the force that was measured, and each gain of `ControllerParameters` in `GAINS`.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.system import System

from rl_cbf_clf_controller.planar_robot import RABBIT, PinnedRobot, Structure
from rl_cbf_clf_controller.virtual_constraints import OutputExpressions

GAINS = (
    *("eps", "slack_weight", "torque_change_weight", "barrier_pole_1", "barrier_pole_2", "R1", "R2", "stone_margin"),
    *("friction_coeff", "friction_margin", "min_normal_force", "torque_limit", "robust_scale_min", "robust_scale_max"),
)


@dataclass(frozen=True)
class Stone:
    """The one in sight, as it was previewed: edges from the stance foot, and height over it; m. Margins are not off."""

    l_min: ca.SX
    l_max: ca.SX
    height: ca.SX


class Walking:
    """Symbols and expressions; `gains` has the `GAINS` by name, `force` (2,) is the measured (F_T, F_N), N.

    `held` (4,) is the torque that has been applied since the last tick, N m.
    """

    def __init__(self, structure: Structure = RABBIT) -> None:
        self.robot = PinnedRobot(structure)
        self.outputs = OutputExpressions(self.robot.q, self.robot.dq)
        self.stone = Stone(*(ca.SX.sym(name) for name in ("l_min", "l_max", "height")))
        self.gains = {name: ca.SX.sym(name) for name in GAINS}
        self.force, self.held = ca.SX.sym("force", 2), ca.SX.sym("held", structure.motors)
        self.step_length = ca.SX.sym("step_length")  # m, that a gait library chose for the stone

    @cached_property
    def system(self) -> System:
        """The system with the state (q, q') in stance/swing order and the torque as its input."""
        further = {**self.outputs.parameters, **vars(self.stone), "force": self.force, "step_length": self.step_length}
        return self.robot.system({**further, "held": self.held, **self.gains}, self.outputs.rates)

    @cached_property
    def output_dynamics(self) -> Affine:
        """y'' (m,), affine in the torque."""
        return self.system.affine(self.system.derivatives("outputs", self.outputs.y, 2)[-1])

    @cached_property
    def eta(self) -> ca.SX:
        """(y, y')."""
        return ca.vertcat(self.outputs.y, self.system.derivative(self.outputs.y))

    @property
    def observation(self) -> ca.SX:
        """What a policy may read, see `uncertainty.py`: outputs, hip, phase, their rates, near edge, step length."""
        hip, phase = self.robot.hip, self.outputs.phase
        of_state = self.eta, hip, phase, self.robot.rate(hip), self.outputs.phase_rate
        return ca.vertcat(*of_state, self.stone.l_min, self.step_length)
